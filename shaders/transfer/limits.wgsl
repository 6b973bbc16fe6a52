// Depth beyond which samples are hidden by what a view of the real scene shows.
#import transfer/farthest

@group(0) @binding(0) var<uniform> params: LimitsUniform;
@group(0) @binding(1) var<storage, read> surface: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> limits_m: array<f32>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.view.size) {
        return;
    }
    let at = id.y * params.view.size.x + id.x;
    limits_m[params.first + at] = hidden_beyond(id.xy, surface[at]);
}
