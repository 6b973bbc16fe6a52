// Points of a grid of pixels.
// Constant: BANDS.

const COEFFICIENTS = BANDS * BANDS;
const QUADS = (COEFFICIENTS + 3u) / 4u;
// Values of a direction: itself, then its spherical harmonics, zero beyond the bands.
const ROW = 1u + QUADS;

// Points of a workgroup that sends the rays of a list.
const LISTED_TOGETHER = 64u;

// How a point gets its transfer.
const NO_SURFACE = 0u;
const INTERPOLATED = 1u;
const TRACED = 2u;
// by rays, but those through the volume are known
const KNOWN = 3u;
// it has that of the real pass
const UNCHANGED = 4u;

struct TracedUniform {
    world_from_view: mat4x4f,
    // of Y_lm of the unoccluded transfer, by 6 l + m
    lobe: array<vec4f, 9>,
    inverse_scale: vec2f,
    centre: vec2f,
    image: vec2u,
    perspective: u32,
    directions: u32,
    // Points of the grid that is treated, and of the coarse one.
    points: vec2u,
    step: u32,
    coarse_step: u32,
    coarse: vec2u,
    // least cosine and largest distance, metres, between points of a smooth surface
    smooth_cosine: f32,
    smooth_m: f32,
    // Of the volume: its lowest corner in the world, metres; highest voxel coordinate; blocks a side.
    min_corner: vec4f,
    last: f32,
    // voxels per stored step
    scale: f32,
    voxel_m: f32,
    grid: u32,
    // of a ray, more than any takes
    most_steps: u32,
    instances: u32,
    reach_m: f32,
    // Rays start this far off their surface, through voxels and against triangles.
    lift_m: f32,
    object_lift_m: f32,
    pad0: u32,
    pad1: u32,
    pad2: u32,
}

@group(0) @binding(0) var<uniform> params: TracedUniform;

// Grid points stand in the middle of their step, clamped to the image.
fn grid_pixel(at: vec2u, step: u32) -> vec2u {
    return min(at * step + step / 2u, params.image - 1u);
}

fn pixel_index(pixel: vec2u) -> u32 {
    return pixel.y * params.image.x + pixel.x;
}

fn point_index(at: vec2u) -> u32 {
    return at.y * params.points.x + at.x;
}

// Where a point keeps what hides it: words of 32 directions, one after the other, all points in each.
fn hits_index(at: vec2u, word: u32) -> u32 {
    return word * params.points.x * params.points.y + point_index(at);
}
