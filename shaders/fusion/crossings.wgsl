// Which bricks of 2x2x2 voxels may hold surface: those that have both sides within themselves and the 26
// around them. A cell with a zero crossing has both sides among its corners, so every brick that such
// a cell reaches into is marked: no crossing lies closer than half a voxel to an unmarked one.
#import fusion/blocks

@group(0) @binding(0) var<uniform> params: GridUniform;
@group(0) @binding(1) var<storage, read> table: array<u32>;
@group(0) @binding(2) var<storage, read> sides: array<vec4u>;
// a bit for each of a block's 4x4x4 bricks, x fastest, two planes a word
@group(0) @binding(3) var<storage, read_write> crossings: array<vec2u>;

const FIRST_X = 0x11111111u;
const FIRST_Y = 0x000f000fu;

// Front in xy and behind in zw, as they are stored; blocks outside and without storage have no sides.
fn sides_at(block: vec3i) -> vec4u {
    if any(block < vec3i(0)) || any(block >= vec3i(i32(params.grid))) {
        return vec4u(0u);
    }
    return sides[block_index(vec3u(block), params.grid)];
}

// Bricks of the block in the middle, and those one step along an axis before and after them. Steps
// along x and y stay within a plane, and so within a word.
fn spread(stride: u32, first: u32, before: vec4u, middle: vec4u, after: vec4u) -> vec4u {
    let across = vec4u(3u * stride);
    let step = vec4u(stride);
    let last = vec4u(first) << across;
    return middle
        | ((middle & ~last) << step)
        | ((middle & ~vec4u(first)) >> step)
        | ((before & last) >> across)
        | ((after & vec4u(first)) << across);
}

// Along z, half words are planes.
fn spread_z(before: vec4u, middle: vec4u, after: vec4u) -> vec4u {
    let half = vec4u(16u);
    let low = vec4u(before.y, middle.x, before.w, middle.z);
    let high = vec4u(middle.y, after.x, middle.w, after.z);
    return middle | (middle << half) | (middle >> half) | (low >> half) | (high << half);
}

fn along_x(block: vec3i) -> vec4u {
    let step = vec3i(1, 0, 0);
    return spread(1u, FIRST_X, sides_at(block - step), sides_at(block), sides_at(block + step));
}

fn along_y(block: vec3i) -> vec4u {
    let step = vec3i(0, 1, 0);
    return spread(4u, FIRST_Y, along_x(block - step), along_x(block), along_x(block + step));
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let index = id.x;
    if index >= params.grid * params.grid * params.grid {
        return;
    }
    if table[index] == EMPTY {
        crossings[index] = vec2u(0u);
        return;
    }
    let block = vec3i(block_coords(index, params.grid));
    let step = vec3i(0, 0, 1);
    let both = spread_z(along_y(block - step), along_y(block), along_y(block + step));
    crossings[index] = both.xy & both.zw;
}
