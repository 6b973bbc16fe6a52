// Interpolates planes along one axis by Catmull-Rom cubics. In w: whether one of the four was changed.
// Constants: PLANES; ALONG_X; FILL, whether points without a surface count as the mean of those that have
// one. Their R' counts as R: where there is no surface at all, both must be the same.
#import compositing/planes
#import compositing/between

struct BicubicUniform {
    before: vec2u,
    after: vec2u,
}

@group(0) @binding(0) var<uniform> params: BicubicUniform;
@group(0) @binding(1) var<storage, read> axis: array<Between>;
@group(0) @binding(2) var<storage, read> means: array<vec4f, 2>;
@group(0) @binding(3) var<storage, read> planes: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> wider: array<vec4f>;

// Interpolating cubic weights at t between the two middle points.
fn catmull_rom(t: f32) -> vec4f {
    let t2 = t * t;
    let t3 = t2 * t;
    return 0.5 * vec4f(
        -t3 + 2.0 * t2 - t,
        3.0 * t3 - 5.0 * t2 + 2.0,
        -3.0 * t3 + 4.0 * t2 + t,
        t3 - t2,
    );
}

fn value(point: vec2u, plane: u32) -> vec4f {
    let at = point.y * params.before.x + point.x;
    let own = planes[plane * params.before.x * params.before.y + at];
    if FILL && planes[real_of(at)].w == NOTHING {
        return vec4f(means[plane / 2u].rgb, own.w);
    }
    return own;
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.after) {
        return;
    }
    var along = id.y;
    var last = params.before.y - 1u;
    if ALONG_X {
        along = id.x;
        last = params.before.x - 1u;
    }
    let weights = catmull_rom(axis[along].share);
    var sum = vec3f(0.0);
    var flag = 0.0;
    for (var k = 0u; k < 4u; k++) {
        // the second and third tap are the two points themselves
        let tap = min(max(axis[along].first + k, 1u) - 1u, last);
        let there = value(select(vec2u(id.x, tap), vec2u(tap, id.y), ALONG_X), id.z);
        sum += weights[k] * there.rgb;
        flag = max(flag, there.w);
    }
    let points = params.after.x * params.after.y;
    wider[id.z * points + id.y * params.after.x + id.x] = vec4f(sum, flag);
}
