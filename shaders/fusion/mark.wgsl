// Marks every block that the band of one truncation length around the depth passes through, and
// finds the largest depth.
// Constant: FAR_AWAY, blocks.
#import fusion/blocks
#import fusion/rays

struct MarkUniform {
    rays: Rays,
    truncation_m: f32,
    grid: u32,
    pad0: u32,
    pad1: u32,
}

@group(0) @binding(0) var<uniform> params: MarkUniform;
// bits, since shaders may take NaN and infinity for anything
@group(0) @binding(1) var<storage, read> depth_bits: array<u32>;
// a bit for each block
@group(0) @binding(2) var<storage, read_write> marks: array<atomic<u32>>;
@group(0) @binding(3) var<storage, read_write> counters: Counters;

const INFINITY_BITS = 0x7f800000u;

var<workgroup> max_bits: atomic<u32>;

fn mark(block: vec3i) {
    if any(block < vec3i(0)) || any(block >= vec3i(i32(params.grid))) {
        return;
    }
    let index = block_index(vec3u(block), params.grid);
    let bit = 1u << (index % 32u);
    if (atomicLoad(&marks[index / 32u]) & bit) == 0u {
        atomicOr(&marks[index / 32u], bit);
    }
}

// Every block from a to b (Amanatides and Woo, "A fast voxel traversal algorithm", 1987). Rounding
// may order two crossings wrongly but each axis is crossed as often as it must be.
fn mark_segment(a: vec3f, b: vec3f) {
    var block = vec3i(floor(a));
    let end = vec3i(floor(b));
    let step = sign(end - block);
    let direction = select(b - a, vec3f(1.0), step == vec3i(0));
    let crossing = vec3f(block + max(step, vec3i(0)));
    var next = (crossing - a) / direction;
    let each = abs(1.0 / direction);
    var left = abs(end - block);
    let crossings = left.x + left.y + left.z;
    mark(block);
    for (var i = 0; i < crossings; i++) {
        var axis = 0u;
        var is_found = false;
        for (var other = 0u; other < 3u; other++) {
            if left[other] > 0 && (!is_found || next[other] < next[axis]) {
                axis = other;
                is_found = true;
            }
        }
        block[axis] += step[axis];
        left[axis] -= 1;
        next[axis] += each[axis];
        mark(block);
    }
}

fn mark_band(pixel: vec2u, depth_m: f32) {
    let ray = ray_at(params.rays, vec2f(pixel));
    let near = max(depth_m - params.truncation_m, 0.0);
    let far = depth_m + params.truncation_m;
    // block b holds voxel coordinates 8 b - 1/2 to 8 b + 15/2
    let a = (ray.origin + ray.direction * near + 0.5) / 8.0;
    let b = (ray.origin + ray.direction * far + 0.5) / 8.0;
    let reach = max(abs(a), abs(b));
    if max(max(reach.x, reach.y), reach.z) <= FAR_AWAY {
        mark_segment(a, b);
    }
}

@compute @workgroup_size(8, 8)
fn main(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    if all(id.xy < params.rays.size) {
        let bits = depth_bits[id.y * params.rays.size.x + id.x];
        if bits > 0u && bits < INFINITY_BITS {
            mark_band(id.xy, bitcast<f32>(bits));
        }
        if bits <= INFINITY_BITS {
            atomicMax(&max_bits, min(bits, INFINITY_BITS - 1u));
        }
    }
    workgroupBarrier();
    if local == 0u {
        atomicMax(&counters.max_depth_bits, atomicLoad(&max_bits));
    }
}
