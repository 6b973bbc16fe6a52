// From recorded bytes to noise-filtered linear light, and encoded luma in 8-bit steps.
// Constant: ROOTS, intervals of the intensity curve.
#import shared/color

struct ColorUniform {
    size: vec2u,
    smoothing: u32,
    pad: u32,
}

const GAUSSIAN = 1u;
const MEDIAN = 2u;

@group(0) @binding(0) var<uniform> params: ColorUniform;
// linear light of the 256 codes, then encoded intensity over the root of luminance
@group(0) @binding(1) var<storage, read> tables: array<f32>;
@group(0) @binding(2) var<storage, read> color_srgb: array<u32>;
@group(0) @binding(3) var<storage, read_write> color: array<vec4f>;

// At the border the picture is continued by its last pixel.
fn codes(pixel: vec2i) -> vec3u {
    let inside = vec2u(clamp(pixel, vec2i(0), vec2i(params.size) - 1));
    let first = 3u * (inside.y * params.size.x + inside.x);
    let byte = vec3u(first, first + 1u, first + 2u);
    let words = vec3u(color_srgb[byte.x / 4u], color_srgb[byte.y / 4u], color_srgb[byte.z / 4u]);
    return (words >> (8u * (byte % 4u))) & vec3u(255u);
}

fn linear(code: vec3u) -> vec3f {
    return vec3f(tables[code.x], tables[code.y], tables[code.z]);
}

// 3x3 binomial filter. Sums are ordered so that a constant stays exactly what it was.
fn gaussian(pixel: vec2i) -> vec3f {
    var columns: array<vec3f, 3>;
    for (var i = 0; i < 3; i++) {
        let at = pixel + vec2i(i - 1, 0);
        let ends = linear(codes(at - vec2i(0, 1))) + linear(codes(at + vec2i(0, 1)));
        columns[i] = ends + 2.0 * linear(codes(at));
    }
    return ((columns[0] + columns[2]) + 2.0 * columns[1]) * (1.0 / 16.0);
}

// Sorts three columns of three; the median is that of the largest minimum, the middle median and the
// smallest maximum. The sRGB curve rises, so the median of codes is the median of light.
fn median(pixel: vec2i) -> vec3u {
    var low = vec3u(0u);
    var high = vec3u(255u);
    var middle: array<vec3u, 3>;
    for (var i = 0; i < 3; i++) {
        let at = pixel + vec2i(i - 1, 0);
        let a = codes(at - vec2i(0, 1));
        let b = codes(at);
        let c = codes(at + vec2i(0, 1));
        low = max(low, min(min(a, b), c));
        high = min(high, max(max(a, b), c));
        middle[i] = middle_of(a, b, c);
    }
    return middle_of(low, middle_of(middle[0], middle[1], middle[2]), high);
}

fn middle_of(a: vec3u, b: vec3u, c: vec3u) -> vec3u {
    return max(min(a, b), min(max(a, b), c));
}

fn steps(light: vec3f) -> f32 {
    let place = min(sqrt(luminance(light)), 1.0) * f32(ROOTS);
    let below = u32(place);
    let first = 256u + below;
    return tables[first] + (place - f32(below)) * (tables[first + 1u] - tables[first]);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.size) {
        return;
    }
    let pixel = vec2i(id.xy);
    var light: vec3f;
    switch params.smoothing {
        case GAUSSIAN: { light = gaussian(pixel); }
        case MEDIAN: { light = linear(median(pixel)); }
        default: { light = linear(codes(pixel)); }
    }
    color[id.y * params.size.x + id.x] = vec4f(light, steps(light));
}
