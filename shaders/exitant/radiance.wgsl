// Outgoing radiance of the pixels of a view: virtual surfaces reflect the dominant light diffusely by their
// albedo, real ones radiate what the camera saw of them, or nothing where it was not the camera that looked.

struct ExitantUniform {
    towards_light: vec4f,
    // irradiance on a surface that faces the light, over pi and the mean albedo; zero without a light
    radiance: vec4f,
    pixels: u32,
    // whether `color` is the camera's
    is_seen: u32,
    pad0: u32,
    pad1: u32,
}

@group(0) @binding(0) var<uniform> params: ExitantUniform;
@group(0) @binding(1) var<storage, read> surface: array<vec4f>;
@group(0) @binding(2) var<storage, read> origin: array<u32>;
@group(0) @binding(3) var<storage, read> layer: array<vec4f>;
@group(0) @binding(4) var<storage, read> color: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> radiance: array<vec4f>;

const MODEL = 1u;
const SENSOR = 2u;
const VIRTUAL = 3u;

fn reflected(at: u32) -> vec3f {
    let cosine = max(dot(surface[at].xyz, params.towards_light.xyz), 0.0);
    return layer[at].rgb * params.radiance.rgb * cosine;
}

@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let at = id.x;
    if at >= params.pixels {
        return;
    }
    var out = vec3f(0.0);
    switch origin[at] {
        case VIRTUAL: { out = reflected(at); }
        case MODEL, SENSOR: {
            if params.is_seen == 1u {
                out = color[at].rgb;
            }
        }
        default: {}
    }
    radiance[at] = vec4f(out, 0.0);
}
