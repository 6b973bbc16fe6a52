// What a pixel with a virtual surface radiates: the dominant light, reflected diffusely by its albedo.
// The importing shader declares `params`, `surface` and `layer`.

struct ExitantUniform {
    towards_light: vec4f,
    // irradiance on a surface that faces the light, over pi and the mean albedo; zero without a light
    radiance: vec4f,
    pixels: u32,
    pad0: u32,
    pad1: u32,
    pad2: u32,
}

const MODEL = 1u;
const SENSOR = 2u;
const VIRTUAL = 3u;

fn reflected(at: u32) -> vec3f {
    let cosine = max(dot(surface[at].xyz, params.towards_light.xyz), 0.0);
    return layer[at].rgb * params.radiance.rgb * cosine;
}
