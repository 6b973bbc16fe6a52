// Blurs planes along one axis by a Gaussian; the border is continued. In w: whether one of the pixels was
// changed.
// Constants: ALONG_X; TAPS, an odd number.

struct BlurUniform {
    size: vec2u,
}

@group(0) @binding(0) var<uniform> params: BlurUniform;
@group(0) @binding(1) var<storage, read> kernel: array<f32>;
@group(0) @binding(2) var<storage, read> planes: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> blurred: array<vec4f>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.size) {
        return;
    }
    let first = id.z * params.size.x * params.size.y;
    let direction = select(vec2i(0, 1), vec2i(1, 0), ALONG_X);
    let last = vec2i(params.size) - 1;
    var sum = vec3f(0.0);
    var flag = 0.0;
    for (var k = 0u; k < TAPS; k++) {
        let offset = i32(k) - i32(TAPS / 2u);
        let there = vec2u(clamp(vec2i(id.xy) + offset * direction, vec2i(0), last));
        let value = planes[first + there.y * params.size.x + there.x];
        sum += kernel[k] * value.rgb;
        flag = max(flag, value.w);
    }
    blurred[first + id.y * params.size.x + id.x] = vec4f(sum, flag);
}
