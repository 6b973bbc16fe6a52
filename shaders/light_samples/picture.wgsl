// Depth and luminance of a frame, to compare later ones with.
#import shared/color

struct PictureUniform {
    pixels: u32,
    pad: u32,
}

@group(0) @binding(0) var<uniform> params: PictureUniform;
@group(0) @binding(1) var<storage, read> surface: array<vec4f>;
@group(0) @binding(2) var<storage, read> color: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> picture: array<vec2f>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if id.x < params.pixels {
        picture[id.x] = vec2f(surface[id.x].w, luminance(color[id.x].rgb));
    }
}
