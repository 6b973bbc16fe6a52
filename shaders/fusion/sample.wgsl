// Distances between voxels. Uses the bindings `table` and `voxels`, and `params.grid`.
#import fusion/blocks
#import fusion/voxels

// Of a voxel in the volume.
fn distance_at(voxel: vec3u) -> i32 {
    let slot = table[block_index(voxel >> vec3u(3u), params.grid)];
    let local = voxel & vec3u(7u);
    return stored_distance(voxels[slot * BLOCK_VOXELS + (local.z * 8u + local.y) * 8u + local.x]);
}

// The eight distances around a point, x fastest, and the point's place between them.
struct Cell {
    corners: array<f32, 8>,
    fraction: vec3f,
    // whether all were seen
    is_known: bool,
}

fn highest_voxel() -> u32 {
    return params.grid * 8u - 1u;
}

// Around a point in the volume; `base` is the lowest corner, below the highest voxel.
fn cell_at(point: vec3f, base: vec3u) -> Cell {
    var cell: Cell;
    cell.fraction = point - vec3f(base);
    cell.is_known = true;
    for (var i = 0u; i < 8u; i++) {
        let distance = distance_at(base + (vec3u(i, i >> 1u, i >> 2u) & vec3u(1u)));
        cell.corners[i] = f32(distance);
        cell.is_known = cell.is_known && distance != UNSEEN;
    }
    return cell;
}

// In stored steps.
fn value_in(cell: Cell) -> f32 {
    let c = cell.corners;
    let f = cell.fraction;
    let x00 = c[0] + (c[1] - c[0]) * f.x;
    let x10 = c[2] + (c[3] - c[2]) * f.x;
    let x01 = c[4] + (c[5] - c[4]) * f.x;
    let x11 = c[6] + (c[7] - c[6]) * f.x;
    let y0 = x00 + (x10 - x00) * f.y;
    let y1 = x01 + (x11 - x01) * f.y;
    return y0 + (y1 - y0) * f.z;
}

// Derivative of the trilinear value per voxel.
fn gradient_in(cell: Cell) -> vec3f {
    let c = cell.corners;
    let f = cell.fraction;
    let x = bilinear(c[1] - c[0], c[3] - c[2], c[5] - c[4], c[7] - c[6], f.yz);
    let y = bilinear(c[2] - c[0], c[3] - c[1], c[6] - c[4], c[7] - c[5], f.xz);
    let z = bilinear(c[4] - c[0], c[5] - c[1], c[6] - c[2], c[7] - c[3], f.xy);
    return vec3f(x, y, z);
}

fn bilinear(a: f32, b: f32, c: f32, d: f32, f: vec2f) -> f32 {
    let low = a + (b - a) * f.x;
    let high = c + (d - c) * f.x;
    return low + (high - low) * f.y;
}

// Zero where a voxel was not seen that a difference reads.
fn central_gradient(point: vec3f) -> vec3f {
    let base = vec3u(point);
    let f = point - vec3f(base);
    if any(base < vec3u(1u)) || any(base + 2u > vec3u(highest_voxel())) {
        return vec3f(0.0);
    }
    var sum = vec3f(0.0);
    for (var i = 0u; i < 8u; i++) {
        let side = vec3u(i, i >> 1u, i >> 2u) & vec3u(1u);
        let at = base + side;
        let share = select(vec3f(1.0) - f, f, side == vec3u(1u));
        for (var axis = 0u; axis < 3u; axis++) {
            var step = vec3u(0u);
            step[axis] = 1u;
            let after = distance_at(at + step);
            let before = distance_at(at - step);
            if after == UNSEEN || before == UNSEEN {
                return vec3f(0.0);
            }
            sum[axis] += share.x * share.y * share.z * f32(after - before);
        }
    }
    return sum;
}
