// G_r: filtered depth with the model's normal where the model has this surface, else with that of the
// depth map itself.
// Constants: REACH, pixels to the neighbours that span a normal; MAX_SLOPE, of depth over the sideways step.
#import shared/view

struct NormalsUniform {
    view: View,
    same_surface_m: f32,
    pad0: u32,
    pad1: u32,
    pad2: u32,
}

const NO_SURFACE = 0u;
const MODEL = 1u;
const SENSOR = 2u;

@group(0) @binding(0) var<uniform> params: NormalsUniform;
@group(0) @binding(1) var<storage, read> depth_m: array<f32>;
@group(0) @binding(2) var<storage, read> model: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> surface: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> origin: array<u32>;

struct Side {
    // pixels from the centre: REACH, 1, or 0 where the surface ends at once
    steps: f32,
    depth_m: f32,
}

fn depth_at(pixel: vec2i) -> f32 {
    if any(pixel < vec2i(0)) || any(pixel >= vec2i(params.view.size)) {
        return 0.0;
    }
    return depth_m[u32(pixel.y) * params.view.size.x + u32(pixel.x)];
}

fn w(depth_m: f32) -> f32 {
    return select(1.0, depth_m, params.view.perspective == 1u);
}

fn farthest_on_surface(pixel: vec2i, own_m: f32, direction: vec2i) -> Side {
    let focal = abs(select(params.view.scale.y, params.view.scale.x, direction.x != 0));
    let gate = MAX_SLOPE / focal * w(own_m);
    let near_m = depth_at(pixel + direction);
    let far_m = depth_at(pixel + i32(REACH) * direction);
    if !(near_m > 0.0 && abs(near_m - own_m) <= gate) {
        return Side(0.0, own_m);
    }
    if far_m > 0.0 && abs(far_m - own_m) <= gate * f32(REACH) {
        return Side(f32(REACH), far_m);
    }
    return Side(1.0, near_m);
}

// In the view's axes.
fn point(pixel: vec2i, step: vec2f, depth_m: f32) -> vec3f {
    let at = (vec2f(pixel) - params.view.centre) / params.view.scale + step / params.view.scale;
    return vec3f(at * w(depth_m), depth_m);
}

// Unit normal in world axes, facing the view: the cross product of differences between the two
// sides. Zero where depth stands alone.
fn normal_of_depth(pixel: vec2i, own_m: f32) -> vec3f {
    let left = farthest_on_surface(pixel, own_m, vec2i(-1, 0));
    let right = farthest_on_surface(pixel, own_m, vec2i(1, 0));
    let up = farthest_on_surface(pixel, own_m, vec2i(0, -1));
    let down = farthest_on_surface(pixel, own_m, vec2i(0, 1));
    let across = point(pixel, vec2f(right.steps, 0.0), right.depth_m)
        - point(pixel, vec2f(-left.steps, 0.0), left.depth_m);
    let along = point(pixel, vec2f(0.0, down.steps), down.depth_m)
        - point(pixel, vec2f(0.0, -up.steps), up.depth_m);
    // x right, y down: along x across points back at the viewer
    let n = cross(along, across);
    let length2 = dot(n, n);
    if length2 <= 0.0 {
        return vec3f(0.0);
    }
    let toward = point(pixel, vec2f(0.0), own_m);
    let away = select(n.z, dot(n, toward), params.view.perspective == 1u);
    let scale = select(1.0, -1.0, away > 0.0) / sqrt(length2);
    return (params.view.world_from_view * vec4f(n, 0.0)).xyz * scale;
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.view.size) {
        return;
    }
    let pixel = vec2i(id.xy);
    let at = id.y * params.view.size.x + id.x;
    let own_m = depth_m[at];
    if !(own_m > 0.0) {
        surface[at] = vec4f(0.0);
        origin[at] = NO_SURFACE;
        return;
    }
    let known = model[at];
    let is_same = known.w > 0.0 && abs(own_m - known.w) <= params.same_surface_m;
    if is_same && dot(known.xyz, known.xyz) > 0.5 {
        surface[at] = vec4f(known.xyz, own_m);
        origin[at] = MODEL;
    } else {
        surface[at] = vec4f(normal_of_depth(pixel, own_m), own_m);
        origin[at] = SENSOR;
    }
}
