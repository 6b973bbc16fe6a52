// Blocks of 8x8x8 voxels, numbered x fastest by their place in the volume; those with storage have a
// slot in the pool.

// Slot of all blocks without storage: its voxels are unseen, so that a reader may follow any entry.
const EMPTY = 0u;
const BLOCK_VOXELS = 512u;

struct Counters {
    // slots that were ever given away; slot 0 is not counted
    used: u32,
    // slots in the list of those that came back
    free: u32,
    // in this integration: slots asked for, and slots that came back
    taken: atomic<u32>,
    released: atomic<u32>,
    // blocks that got no slot, ever
    refused: u32,
    // of this integration's picture
    max_depth_bits: atomic<u32>,
}

struct GridUniform {
    // blocks a side
    grid: u32,
    // slots, with slot 0
    capacity: u32,
}

fn block_index(block: vec3u, grid: u32) -> u32 {
    return (block.z * grid + block.y) * grid + block.x;
}

fn block_coords(index: u32, grid: u32) -> vec3u {
    let row = index / grid;
    return vec3u(index % grid, row % grid, row / grid);
}
