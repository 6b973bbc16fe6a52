// The pixels that are looked at for samples: every n-th point of the transfer's grid, row by row.
#import shared/view

struct SamplesUniform {
    view: View,
    // the picture that was kept last
    last_view: View,
    grid: vec2u,
    step: u32,
    // grid points between candidates
    every: u32,
    // of candidates
    columns: u32,
    candidates: u32,
    // 8-bit steps
    brightest: f32,
    darkest: f32,
    min_cosine: f32,
    model_only: u32,
    has_last: u32,
    pad: u32,
}

const WORKGROUP = 256u;
// Words before the samples: counts of pixels by what became of them, and of samples.
const USED = 0u;
const NO_SURFACE = 1u;
const GRAZING = 2u;
const DARK = 3u;
const SATURATED = 4u;
const PICKED = 5u;
const HEADER = 8u;

fn grid_point(candidate: u32) -> vec2u {
    return params.every * vec2u(candidate % params.columns, candidate / params.columns);
}

// Grid points stand in the middle of their step, clamped to the image.
fn pixel_of(point: vec2u) -> vec2u {
    return min(point * params.step + params.step / 2u, params.view.size - 1u);
}

fn index(pixel: vec2u) -> u32 {
    return pixel.y * params.view.size.x + pixel.x;
}
