// Which candidates tell something about the light: counts them by what became of them.
// Constant: COEFFICIENTS of a transfer.
#import light_samples/candidates
#import shared/color

@group(0) @binding(0) var<uniform> params: SamplesUniform;
@group(0) @binding(1) var<storage, read> surface: array<vec4f>;
@group(0) @binding(2) var<storage, read> origin: array<u32>;
@group(0) @binding(3) var<storage, read> color_srgb: array<u32>;
@group(0) @binding(4) var<storage, read> color: array<vec4f>;
@group(0) @binding(5) var<storage, read> transfer: array<f32>;
@group(0) @binding(6) var<storage, read_write> usable: array<u32>;
@group(0) @binding(7) var<storage, read_write> picked: array<atomic<u32>>;

const MODEL = 1u;
const SENSOR = 2u;
const INFINITE_BITS = 0x7f800000u;

var<workgroup> counts: array<atomic<u32>, HEADER>;

// Neither infinite nor no number.
fn is_finite(value: f32) -> bool {
    return (bitcast<u32>(value) & 0x7fffffffu) < INFINITE_BITS;
}

fn is_positive(value: f32) -> bool {
    let bits = bitcast<u32>(value);
    return bits > 0u && bits < INFINITE_BITS;
}

fn has_surface(at: u32, row: u32) -> bool {
    let is_real = origin[at] == MODEL || (origin[at] == SENSOR && params.model_only == 0u);
    var energy = 0.0;
    for (var k = 0u; k < COEFFICIENTS; k++) {
        energy += transfer[row + k] * transfer[row + k];
    }
    return is_real && is_positive(surface[at].w) && is_positive(energy);
}

fn brightest_channel(at: u32) -> f32 {
    var most = 0u;
    for (var byte = 3u * at; byte < 3u * at + 3u; byte++) {
        most = max(most, (color_srgb[byte / 4u] >> (8u * (byte % 4u))) & 255u);
    }
    return f32(most);
}

// -1 where there is no normal.
fn cosine_to_eye(pixel: vec2u, at: u32) -> f32 {
    var towards_eye = vec3f(0.0, 0.0, -1.0);
    if params.view.perspective == 1u {
        towards_eye = -normalize(unproject(params.view, vec2f(pixel), 1.0));
    }
    let cosine = dot(surface[at].xyz, (params.view.world_from_view * vec4f(towards_eye, 0.0)).xyz);
    return select(-1.0, cosine, is_finite(cosine));
}

fn verdict(point: vec2u) -> u32 {
    let pixel = pixel_of(point);
    let at = index(pixel);
    if !has_surface(at, (point.y * params.grid.x + point.x) * COEFFICIENTS) {
        return NO_SURFACE;
    }
    let brightest = brightest_channel(at);
    if brightest > params.brightest {
        return SATURATED;
    }
    if brightest < params.darkest || !is_finite(luminance(color[at].rgb)) {
        return DARK;
    }
    return select(USED, GRAZING, cosine_to_eye(pixel, at) < params.min_cosine);
}

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) local: u32) {
    if id.x < params.candidates {
        let found = verdict(grid_point(id.x));
        usable[id.x] = u32(found == USED);
        atomicAdd(&counts[found], 1u);
    }
    workgroupBarrier();
    if local < HEADER {
        atomicAdd(&picked[local], atomicLoad(&counts[local]));
    }
}
