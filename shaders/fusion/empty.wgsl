// Empty bricks, octants and blocks of a volume, and the way past them. Uses the binding `crossings`, and
// `params.grid`.
// Constant: NUDGE, voxels past the border of an empty cube.
#import fusion/blocks

// Side of the largest of the cubes of 8, 4 and 2 voxels around a voxel that hold no surface; 0 where
// the smallest may hold some.
fn empty_side(voxel: vec3u) -> u32 {
    let bricks = crossings[block_index(voxel >> vec3u(3u), params.grid)];
    if all(bricks == vec2u(0u)) {
        return 8u;
    }
    let brick = (voxel >> vec3u(1u)) & vec3u(3u);
    // two planes a word
    let planes = bricks[brick.z >> 1u];
    if ((planes >> ((brick.z & 1u) * 16u + brick.y * 4u + brick.x)) & 1u) == 1u {
        return 0u;
    }
    let octant = (planes >> ((brick.y & 2u) * 4u + (brick.x & 2u))) & FIRST_OCTANT;
    return select(4u, 2u, octant != 0u);
}

// Depth just past the cube around a voxel whose side is a power of two, and past a margin around it.
fn leave(origin: vec3f, inverse: vec3f, voxel: vec3u, side: u32, margin: u32) -> f32 {
    // a voxel's share of space ends half a voxel from its centre
    let low = vec3f(voxel & ~vec3u(side - 1u)) - 0.5;
    let after = low + f32(side) + f32(margin) + NUDGE;
    let end = select(low - f32(margin) - NUDGE, after, inverse > vec3f(0.0));
    let depth = (end - origin) * inverse;
    return min(min(depth.x, depth.y), depth.z);
}
