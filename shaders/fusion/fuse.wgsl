// What the kernels of an integration know of the picture.
// Constant: FUSE_NEAREST_M, nearer to the camera's plane nothing is seen.
#import fusion/rays

struct FuseUniform {
    view: ViewFromVoxel,
    voxel_m: f32,
    truncation_m: f32,
    max_weight: f32,
    free_weight: f32,
    // blocks a side
    grid: u32,
    // slots, with slot 0
    capacity: u32,
    // the share of a depth by which its neighbours may differ to be interpolated
    edge: f32,
    pad: u32,
}

// An entry of the list of blocks to integrate: the block's number, and whether its slot is new.
const FRESH = 0x80000000u;
