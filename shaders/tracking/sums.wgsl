// Projective data association and the sums of point-to-plane alignment (Newcombe et al. 2011, Eq. 14-20),
// in the axes of the model's view; one partial sum for each workgroup.
// Constants: ITEMS, pixels that an invocation adds up; LANES, invocations of a workgroup, at least TERMS,
// the numbers of a sum and a multiple of 4; NOISE_FLOOR_M, NOISE_GROWTH and NOISE_NEAREST_M, noise of depth.
#import tracking/lens

struct SumsUniform {
    model_from_camera: mat4x4f,
    model_from_world: mat4x4f,
    frame: Lens,
    model: Lens,
    max_distance_m: f32,
    min_cosine: f32,
    // residuals beyond this many standard deviations of the depth noise weigh less
    huber_sigmas: f32,
    pad: u32,
}

// an odd number of words from one invocation's terms to the next's
const STRIDE = TERMS + 1u;

@group(0) @binding(0) var<uniform> params: SumsUniform;
// normal in camera axes, zero where missing, and depth
@group(0) @binding(1) var<storage, read> frame: array<vec4f>;
// bits of world normal and depth, which may be no numbers
@group(0) @binding(2) var<storage, read> model: array<vec4u>;
@group(0) @binding(3) var<storage, read_write> partials: array<f32>;

// Upper triangle of A by rows, b, residual squared; depth, partners, seen, valid. Rotation comes first.
var<private> sums: array<vec4f, TERMS / 4u>;
var<workgroup> scratch: array<f32, LANES * STRIDE>;

fn turned(by: mat4x4f, v: vec3f) -> vec3f {
    return by[0].xyz * v.x + by[1].xyz * v.y + by[2].xyz * v.z;
}

fn are_numbers(bits: vec4u) -> bool {
    return all((bits & vec4u(0x7f800000u)) != vec4u(0x7f800000u));
}

fn depth_sigma_m(depth_m: f32) -> f32 {
    let beyond = depth_m - NOISE_NEAREST_M;
    return NOISE_FLOOR_M + NOISE_GROWTH * beyond * beyond;
}

// Adds w J^T J and w J^T r. A small motion (w, t) moves the point by w x p + t, so the row of the
// Jacobian is (p x n, n).
fn add_partner(point: vec3f, n: vec3f, residual: f32, depth_m: f32) {
    let sigma = depth_sigma_m(depth_m);
    let limit = params.huber_sigmas * sigma;
    let distance = abs(residual);
    let huber = select(1.0, limit / max(distance, limit), distance > limit);
    let relative = depth_sigma_m(NOISE_NEAREST_M) / sigma;
    let weight = huber * relative * relative;
    let c = vec3f(
        point.y * n.z - point.z * n.y,
        point.z * n.x - point.x * n.z,
        point.x * n.y - point.y * n.x,
    );
    let wc = weight * c;
    let wn = weight * n;
    sums[0] += vec4f(wc.x * c, wc.x * n.x);
    sums[1] += vec4f(wc.x * n.yz, wc.y * c.yz);
    sums[2] += vec4f(wc.y * n, wc.z * c.z);
    sums[3] += vec4f(wc.z * n, wn.x * n.x);
    sums[4] += vec4f(wn.x * n.yz, wn.y * n.yz);
    sums[5] += vec4f(wn.z * n.z, wc * residual);
    sums[6] += vec4f(wn * residual, residual * residual);
    sums[7] += vec4f(depth_m, 1.0, 0.0, 0.0);
}

// Finds the partner of a pixel, if it has one.
fn add_pixel(index: u32) {
    let own = frame[index];
    if !(dot(own.xyz, own.xyz) > 0.0) {
        return;
    }
    sums[7].w += 1.0;
    let pixel = vec2f(vec2u(index % params.frame.size.x, index / params.frame.size.x));
    let ray = (pixel - params.frame.centre) * params.frame.inverse_scale;
    let point = turned(params.model_from_camera, vec3f(ray * own.w, own.w))
        + params.model_from_camera[3].xyz;
    if !(point.z > 0.0) {
        return;
    }
    let place = point.xy * (1.0 / point.z) * params.model.scale + params.model.centre + 0.5;
    if !(all(place >= vec2f(0.0)) && all(place < vec2f(params.model.size))) {
        return;
    }
    let partner = min(vec2u(place), params.model.size - 1u);
    let bits = model[partner.y * params.model.size.x + partner.x];
    if !are_numbers(bits) {
        return;
    }
    let there = bitcast<vec4f>(bits);
    let n = turned(params.model_from_world, there.xyz);
    if !(there.w > 0.0 && dot(n, n) > 0.5) {
        return;
    }
    sums[7].z += 1.0;
    let model_ray = (vec2f(partner) - params.model.centre) * params.model.inverse_scale;
    let to_model = vec3f(model_ray * there.w, there.w) - point;
    let cosine = dot(n, turned(params.model_from_camera, own.xyz));
    let is_near = dot(to_model, to_model) <= params.max_distance_m * params.max_distance_m;
    if is_near && cosine >= params.min_cosine {
        add_partner(point, n, dot(n, to_model), own.w);
    }
}

@compute @workgroup_size(LANES)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    let pixels = params.frame.size.x * params.frame.size.y;
    let first = group.x * LANES * ITEMS + lane;
    for (var item = 0u; item < ITEMS; item++) {
        let index = first + item * LANES;
        if index < pixels {
            add_pixel(index);
        }
    }
    for (var i = 0u; i < TERMS; i++) {
        scratch[lane * STRIDE + i] = sums[i / 4u][i % 4u];
    }
    workgroupBarrier();
    if lane < TERMS {
        var total = 0.0;
        for (var other = 0u; other < LANES; other++) {
            total += scratch[other * STRIDE + lane];
        }
        partials[group.x * TERMS + lane] = total;
    }
}
