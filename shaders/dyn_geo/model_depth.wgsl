// The model's depth alone, where nothing is merged into it.

struct ModelDepthUniform {
    pixels: u32,
    pad: u32,
}

@group(0) @binding(0) var<uniform> params: ModelDepthUniform;
@group(0) @binding(1) var<storage, read> model: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> depth_m: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if id.x < params.pixels {
        depth_m[id.x] = model[id.x].w;
    }
}
