// Writes an even choice of the samples, packed for the way to the host, in any order.
// Constants: SAMPLES that are wanted, MOST_SAMPLES that there is room for; RANK_STEP_X, RANK_STEP_Y; COEFFICIENTS of a transfer; SAMPLE_WORDS; SAME_DEPTH, relative, of one surface in two pictures.
#import light_samples/candidates
#import shared/color

@group(0) @binding(0) var<uniform> params: SamplesUniform;
@group(0) @binding(1) var<storage, read> usable: array<u32>;
@group(0) @binding(2) var<storage, read> surface: array<vec4f>;
@group(0) @binding(3) var<storage, read> color: array<vec4f>;
@group(0) @binding(4) var<storage, read> transfer: array<f32>;
// depth and luminance of the picture that was kept last
@group(0) @binding(5) var<storage, read> last: array<vec2f>;
@group(0) @binding(6) var<storage, read_write> picked: array<atomic<u32>>;

// Luminance of a point in the last picture, 0 where that does not show it.
fn luminance_then(point_in_world: vec3f) -> f32 {
    if params.has_last == 0u {
        return 0.0;
    }
    let seen = project(params.last_view, point_in_world);
    let pixel = floor(seen.pixel + 0.5);
    let size = params.last_view.size;
    if !(seen.is_before && all(pixel >= vec2f(0.0)) && all(pixel < vec2f(size))) {
        return 0.0;
    }
    let then = last[u32(pixel.y) * size.x + u32(pixel.x)];
    return select(0.0, then.y, abs(then.x - seen.depth_m) <= SAME_DEPTH * seen.depth_m);
}

// Onto an octahedron, whose lower half is folded outwards; two values of 16 bits.
fn packed_normal(n: vec3f) -> u32 {
    let on_octahedron = n / max(abs(n.x) + abs(n.y) + abs(n.z), 1e-20);
    let folded = (1.0 - abs(on_octahedron.yx)) * select(vec2f(-1.0), vec2f(1.0), n.xy >= vec2f(0.0));
    return pack2x16snorm(select(folded, on_octahedron.xy, n.z >= 0.0));
}

fn coefficient(row: u32, k: u32) -> f32 {
    if k >= COEFFICIENTS {
        return 0.0;
    }
    return transfer[row + k];
}

// The highest rank of a sample: floor(2^32 SAMPLES / used), a digit of 8 bits after the other.
fn last_rank(used: u32) -> u32 {
    if used <= SAMPLES {
        return 0xffffffffu;
    }
    var quotient = 0u;
    var rest = SAMPLES;
    for (var digit = 0u; digit < 4u; digit++) {
        rest *= 256u;
        quotient = quotient * 256u + rest / used;
        rest %= used;
    }
    return quotient;
}

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= params.candidates || usable[id.x] == 0u {
        return;
    }
    let rank = id.x % params.columns * RANK_STEP_X + id.x / params.columns * RANK_STEP_Y;
    if rank > last_rank(atomicLoad(&picked[USED])) {
        return;
    }
    let slot = atomicAdd(&picked[PICKED], 1u);
    if slot >= MOST_SAMPLES {
        return;
    }
    let point = grid_point(id.x);
    let pixel = pixel_of(point);
    let at = index(pixel);
    let shown = surface[at];
    let rgb = color[at].rgb;
    let then = luminance_then(unproject_to_world(params.view, vec2f(pixel), shown.w));
    let first = HEADER + slot * SAMPLE_WORDS;
    atomicStore(&picked[first], at);
    atomicStore(&picked[first + 1u], bitcast<u32>(shown.w));
    atomicStore(&picked[first + 2u], bitcast<u32>(rgb.r));
    atomicStore(&picked[first + 3u], bitcast<u32>(rgb.g));
    atomicStore(&picked[first + 4u], bitcast<u32>(rgb.b));
    atomicStore(&picked[first + 5u], packed_normal(shown.xyz));
    atomicStore(&picked[first + 6u], bitcast<u32>(then));
    let row = (point.y * params.grid.x + point.x) * COEFFICIENTS;
    for (var k = 0u; k < COEFFICIENTS; k += 2u) {
        // below 1: |Y| is below 0.94 in 6 bands, and the unoccluded part less in high bands
        let pair = vec2f(coefficient(row, k), coefficient(row, k + 1u));
        atomicStore(&picked[first + 7u + k / 2u], pack2x16snorm(pair));
    }
}
