// Normals of a level, in camera axes, from differences of inverse depth: a plane a.p = 1 has inverse
// depth q = a.(x/z, y/z, 1), linear in the pixel, so the differences give the plane exactly. -a faces the
// camera, since a.p = 1 at the pixel itself.
#import tracking/lens

struct LevelUniform {
    lens: Lens,
    edge_m: f32,
    pad0: u32,
    pad1: u32,
    pad2: u32,
}

@group(0) @binding(0) var<uniform> params: LevelUniform;
@group(0) @binding(1) var<storage, read> depth_m: array<f32>;
// normal, zero where missing, and depth
@group(0) @binding(2) var<storage, read_write> surface: array<vec4f>;

struct Tap {
    inverse_m: f32,
    // pixels from the centre; a neighbour across an edge is the pixel itself
    steps: f32,
}

fn depth_at(pixel: vec2i) -> f32 {
    if any(pixel < vec2i(0)) || any(pixel >= vec2i(params.lens.size)) {
        return 0.0;
    }
    return depth_m[u32(pixel.y) * params.lens.size.x + u32(pixel.x)];
}

fn tap(pixel: vec2i, own_m: f32) -> Tap {
    let d = depth_at(pixel);
    if d > 0.0 && abs(d - own_m) < params.edge_m {
        return Tap(1.0 / d, 1.0);
    }
    return Tap(1.0 / own_m, 0.0);
}

fn normal(pixel: vec2i, own_m: f32) -> vec3f {
    let left = tap(pixel - vec2i(1, 0), own_m);
    let right = tap(pixel + vec2i(1, 0), own_m);
    let up = tap(pixel - vec2i(0, 1), own_m);
    let down = tap(pixel + vec2i(0, 1), own_m);
    let steps = vec2f(left.steps + right.steps, up.steps + down.steps);
    if any(steps == vec2f(0.0)) {
        return vec3f(0.0);
    }
    let rise = vec2f(right.inverse_m - left.inverse_m, down.inverse_m - up.inverse_m);
    let slope = rise / steps;
    let from_centre = vec2f(pixel) - params.lens.centre;
    let q = 1.0 / own_m - from_centre.x * slope.x - from_centre.y * slope.y;
    let plane = vec3f(params.lens.scale * slope, q);
    let length2 = dot(plane, plane);
    if !(length2 > 0.0) {
        return vec3f(0.0);
    }
    return plane * (-1.0 / sqrt(length2));
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.lens.size) {
        return;
    }
    let at = id.y * params.lens.size.x + id.x;
    let own_m = depth_m[at];
    var n = vec3f(0.0);
    if own_m > 0.0 {
        n = normal(vec2i(id.xy), own_m);
    }
    surface[at] = vec4f(n, own_m);
}
