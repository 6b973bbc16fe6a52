// D' (Gruber et al. 2015, Eq. 3): the model's depth where the sensor agrees with it, else the
// sensor's; holes are filled by the model where most of their surroundings agree with it, else by the
// median of what is measured around.
#import shared/median

struct MergeUniform {
    size: vec2u,
    intensity_threshold: f32,
    close_m: f32,
}

@group(0) @binding(0) var<uniform> params: MergeUniform;
@group(0) @binding(1) var<storage, read> taps: array<vec2i>;
@group(0) @binding(2) var<storage, read> color: array<vec4f>;
@group(0) @binding(3) var<storage, read> sensor_m: array<f32>;
@group(0) @binding(4) var<storage, read> model: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> merged_m: array<f32>;

fn window_depth(pixel: vec2i) -> f32 {
    return sensor_m[index(pixel)];
}

// Eq. 2: gathered depths near the model's at the same pixel.
fn count_close(pixel: vec2i) -> u32 {
    var count = 0u;
    for (var tap = 0u; tap < TAPS; tap++) {
        let bits = value(tap, pixel);
        if bits != NO_VALUE {
            let model_m = model[index(pixel + taps[tap])].w;
            let is_close = abs(bitcast<f32>(bits) - model_m) <= params.close_m;
            count += u32(model_m > 0.0 && is_close);
        }
    }
    return count;
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.size) {
        return;
    }
    let pixel = vec2i(id.xy);
    let at = index(pixel);
    let sensor = sensor_m[at];
    let model_m = model[at].w;
    if sensor > 0.0 {
        let is_close = model_m > 0.0 && abs(sensor - model_m) <= params.close_m;
        merged_m[at] = select(sensor, model_m, is_close);
        return;
    }
    let count = open_window(pixel);
    let by_model = model_m > 0.0 && 2u * count_close(pixel) >= count;
    merged_m[at] = select(lower_median(pixel, count), model_m, by_model);
}
