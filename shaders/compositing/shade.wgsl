// R, R' and the bounce at the grid points of the transfer, and which of them virtual objects change.
// Constants: COEFFICIENTS, of a point's transfer; PLANES; MAX_VISIBILITY; VISIBILITY, whether virtual points
// get the part of the light that arrives in place of R'.
#import compositing/planes
#import compositing/lamp

struct ShadeUniform {
    lamp: Lamp,
    grid: vec2u,
    image: vec2u,
    step: u32,
    pad0: u32,
    pad1: u32,
    pad2: u32,
}

const INFINITY_BITS = 0x7f800000u;

@group(0) @binding(0) var<uniform> params: ShadeUniform;
@group(0) @binding(1) var<storage, read> real_transfer: array<f32>;
@group(0) @binding(2) var<storage, read> merged_transfer: array<f32>;
@group(0) @binding(3) var<storage, read> indirect: array<vec4f>;
@group(0) @binding(4) var<storage, read> surface: array<vec4f>;
@group(0) @binding(5) var<storage, read> origin: array<u32>;
@group(0) @binding(6) var<storage, read_write> planes: array<vec4f>;

// Not below the floor; what is no number gives the floor.
fn raised(shading: vec3f) -> vec3f {
    let floor = vec3f(params.lamp.floor);
    let is_nan = (bitcast<vec3u>(shading) & vec3u(0x7fffffffu)) > vec3u(INFINITY_BITS);
    return select(max(shading, floor), floor, is_nan);
}

// From 0 to LARGEST, 0 for what is no number. Bits of positive numbers are ordered as the numbers; negatives and NaN have
// greater ones than infinity.
fn tamed(light: vec3f) -> vec3f {
    let bits = bitcast<vec3u>(light);
    let inside = bitcast<vec3f>(min(bits, vec3u(bitcast<u32>(LARGEST))));
    return select(inside, vec3f(0.0), bits > vec3u(INFINITY_BITS));
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.grid) {
        return;
    }
    let point = id.y * params.grid.x + id.x;
    let points = params.grid.x * params.grid.y;
    let pixel = grid_pixel(id.xy, params.step, params.image);
    let at = pixel.y * params.image.x + pixel.x;
    let kind = kind_of(origin[at], surface[at].w);

    var real = vec3f(0.0);
    var merged = vec3f(0.0);
    var differing = 0u;
    for (var k = 0u; k < COEFFICIENTS; k++) {
        let light = params.lamp.coefficients[k].rgb;
        let without = real_transfer[point * COEFFICIENTS + k];
        let with_objects = merged_transfer[point * COEFFICIENTS + k];
        real += without * light;
        merged += with_objects * light;
        differing |= bitcast<u32>(without) ^ bitcast<u32>(with_objects);
    }
    real = raised(real);
    // The same transfer is the same shading, whatever the driver makes of the two sums.
    merged = select(raised(merged), real, differing == 0u);

    var is_changed = kind == VIRTUAL || any(real != merged);
    if VISIBILITY && kind == VIRTUAL {
        merged = visibility(merged, unoccluded(surface[at].xyz));
    }
    if HAS_BOUNCE {
        let light = tamed(indirect[point].rgb);
        is_changed = is_changed || any(light != vec3f(0.0));
        planes[bounce_of(point, points)] = vec4f(light, 0.0);
    }
    planes[real_of(point)] = vec4f(real, kind);
    planes[merged_of(point, points)] = vec4f(merged, select(0.0, 1.0, is_changed));
}
