// Outgoing radiance of the pixels of a view without colour: all but virtual surfaces is dark.
#import exitant/reflected

@group(0) @binding(0) var<uniform> params: ExitantUniform;
@group(0) @binding(1) var<storage, read> surface: array<vec4f>;
@group(0) @binding(2) var<storage, read> origin: array<u32>;
@group(0) @binding(3) var<storage, read> layer: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> radiance: array<vec4f>;

@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let at = id.x;
    if at >= params.pixels {
        return;
    }
    var out = vec3f(0.0);
    if origin[at] == VIRTUAL {
        out = reflected(at);
    }
    radiance[at] = vec4f(out, 0.0);
}
