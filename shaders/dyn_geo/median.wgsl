// D'' with a guide, D''' without (Gruber et al. 2015, Eq. 4 and 5).
#import shared/median

struct MedianUniform {
    size: vec2u,
    intensity_threshold: f32,
    pad: u32,
}

@group(0) @binding(0) var<uniform> params: MedianUniform;
@group(0) @binding(1) var<storage, read> taps: array<vec2i>;
@group(0) @binding(2) var<storage, read> color: array<vec4f>;
@group(0) @binding(3) var<storage, read> depth_m: array<f32>;
@group(0) @binding(4) var<storage, read_write> filtered_m: array<f32>;

fn window_depth(pixel: vec2i) -> f32 {
    return depth_m[index(pixel)];
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.size) {
        return;
    }
    let pixel = vec2i(id.xy);
    filtered_m[index(pixel)] = lower_median(pixel, open_window(pixel));
}
