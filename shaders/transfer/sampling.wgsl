// Visibility of a point of the grid: samples y = x + r w, looked up in every view.
// Constants: BANDS; VIEWS, the main one and those at its side. The main file declares `directions`, `distances_m`
// and `limits_m`.

const COEFFICIENTS = BANDS * BANDS;
const QUADS = (COEFFICIENTS + 3u) / 4u;
// Values of a direction: itself, then its spherical harmonics, zero beyond the bands.
const ROW = 1u + QUADS;

// Cosine of a direction that no surface hides.
const NOT_HIDDEN = -2.0;
const NO_PIXEL = 0xffffffffu;
const FARTHEST_POINT_M = 1.0e9;

struct TransferView {
    view_from_main: mat4x4f,
    view_from_world: mat4x4f,
    world_from_view: mat4x4f,
    scale: vec2f,
    inverse_scale: vec2f,
    centre: vec2f,
    size: vec2u,
    // of its pixels among those of all views
    first: u32,
    perspective: u32,
    pad0: u32,
    pad1: u32,
}

struct TransferUniform {
    views: array<TransferView, 8>,
    // of Y_lm of the unoccluded transfer, by 6 l + m
    lobe: array<vec4f, 9>,
    grid: vec2u,
    step: u32,
    tile: u32,
    directions: u32,
    samples: u32,
    chi: f32,
    bias_m: f32,
    // no sample lies further away
    farthest_m: f32,
    // of the bounce
    strength: f32,
    pad0: u32,
    pad1: u32,
}

@group(0) @binding(0) var<uniform> params: TransferUniform;

// A surface point that samples start from.
struct Point {
    is_valid: bool,
    // world normal
    n: vec3f,
    // in main-view axes, lifted off the surface along the normal
    x: vec3f,
    n_in_main: vec3f,
}

// The surface that fits a direction best.
struct Fit {
    // largest t.w of a surface that hides a sample
    cosine: f32,
    view: u32,
    // among those of all views
    pixel: u32,
}

// The point and its normal in the axes of each view.
var<private> point_in_view: array<vec3f, VIEWS>;
var<private> normal_in_view: array<vec3f, VIEWS>;

fn turned(a: mat4x4f, v: vec3f) -> vec3f {
    return (a * vec4f(v, 0.0)).xyz;
}

fn moved(a: mat4x4f, p: vec3f) -> vec3f {
    return (a * vec4f(p, 1.0)).xyz;
}

// Grid points stand in the middle of their step, clamped to the image.
fn grid_pixel(at: vec2u) -> vec2u {
    return min(at * params.step + params.step / 2u, params.views[0].size - 1u);
}

fn point_of(pixel: vec2u, surface: vec4f) -> Point {
    let depth = bitcast<u32>(surface.w);
    let squared = bitcast<u32>(dot(surface.xyz, surface.xyz));
    // bits are compared, as they tell what is no number from what is
    let is_valid = depth > 0u && depth < bitcast<u32>(FARTHEST_POINT_M)
        && squared > bitcast<u32>(0.25) && squared < bitcast<u32>(4.0);
    if !is_valid {
        return Point(false, vec3f(0.0), vec3f(0.0), vec3f(0.0));
    }
    let w = select(1.0, surface.w, params.views[0].perspective == 1u);
    let at = (vec2f(pixel) - params.views[0].centre) * params.views[0].inverse_scale;
    let n_in_main = turned(params.views[0].view_from_world, surface.xyz);
    let x = vec3f(at * w, surface.w) + params.bias_m * n_in_main;
    return Point(true, surface.xyz, x, n_in_main);
}

fn show_to_views(point: Point) {
    for (var v = 0u; v < VIEWS; v++) {
        point_in_view[v] = moved(params.views[v].view_from_main, point.x);
        normal_in_view[v] = turned(params.views[v].view_from_main, point.n_in_main);
    }
}

fn first_distance(at: vec2u) -> u32 {
    let cell = at % params.tile;
    return (cell.y * params.tile + cell.x) * params.directions * params.samples;
}

// The nearest pixel of a view to a point in its axes; `inverse` is 1 / z in a perspective view, else 1.
fn pixel_of(v: u32, y: vec3f, inverse: f32) -> u32 {
    // one pixel of border, and a half for rounding by truncation
    let padded = y.xy * params.views[v].scale * inverse + (params.views[v].centre + 1.5);
    let size = params.views[v].size;
    if !(all(padded >= vec2f(1.0)) && all(padded < vec2f(size) + 1.0)) {
        return NO_PIXEL;
    }
    let pixel = vec2u(padded) - 1u;
    return params.views[v].first + pixel.y * size.x + pixel.x;
}

// t.w of the surface at depth `surface_m` (Eq. 7), where it is not below the horizon of the point.
fn fit_of(v: u32, w: vec3f, r: f32, y: vec3f, inverse: f32, surface_m: f32) -> f32 {
    let x = point_in_view[v];
    let is_perspective = params.views[v].perspective == 1u;
    let sideward = select(r * w.xy, y.xy * (surface_m * inverse) - x.xy, is_perspective);
    let t = vec3f(sideward, surface_m - x.z);
    // a surface at x itself has no direction
    let length = max(sqrt(dot(t, t)), 1e-20);
    return select(NOT_HIDDEN, dot(t, w) / length, dot(t, normal_in_view[v]) > 0.0);
}

// Looks along a direction in all views.
fn look(w_in_world: vec3f, distances: u32) -> Fit {
    var best = Fit(NOT_HIDDEN, 0u, 0u);
    for (var v = 0u; v < VIEWS; v++) {
        let w = turned(params.views[v].view_from_world, w_in_world);
        let is_perspective = params.views[v].perspective == 1u;
        for (var s = 0u; s < params.samples; s++) {
            let r = distances_m[distances + s];
            let y = point_in_view[v] + r * w;
            // what hides lies before the sample and in front of the eye
            if !(y.z > 1e-20) {
                continue;
            }
            let inverse = select(1.0, 1.0 / y.z, is_perspective);
            let pixel = pixel_of(v, y, inverse);
            if pixel == NO_PIXEL {
                continue;
            }
            let limit_m = limits_m[pixel];
            if !(y.z > limit_m) {
                continue;
            }
            let cosine = fit_of(v, w, r, y, inverse, limit_m - params.bias_m);
            if cosine > best.cosine {
                best = Fit(cosine, v, pixel);
            }
        }
    }
    return best;
}

// 1 - K of Eq. 8.
fn hiddenness(cosine: f32) -> f32 {
    return clamp((cosine - (1.0 - params.chi)) / params.chi, 0.0, 1.0);
}

fn sum_of_cosines(n: vec3f) -> f32 {
    var sum = 0.0;
    for (var d = 0u; d < params.directions; d++) {
        sum += max(dot(n, directions[d * ROW].xyz), 0.0);
    }
    return sum;
}
