// Bilateral filter of the depth picture (Newcombe et al. 2011, Eq. 2), of inverse depth as on the CPU: exact on planes.
// Constants: RADIUS, in pixels; GROUP, pixels a side of a workgroup; TILED, whether what it looks at fits
// its memory.

struct BilateralUniform {
    size: vec2u,
    // depth that is usable, as bits: positive numbers are ordered as their bits are, and NaN, infinity
    // and negatives all have greater ones
    min_bits: u32,
    end_bits: u32,
    range_scale: f32,
    pad0: u32,
    pad1: u32,
    pad2: u32,
}

const SIDE = 2u * RADIUS + 1u;
const TILE = GROUP + 2u * RADIUS;

@group(0) @binding(0) var<uniform> params: BilateralUniform;
// SIDE x SIDE weights
@group(0) @binding(1) var<storage, read> spatial: array<f32>;
@group(0) @binding(2) var<storage, read> depth_bits: array<u32>;
@group(0) @binding(3) var<storage, read_write> filtered_m: array<f32>;

var<workgroup> tile: array<f32, select(1u, TILE * TILE, TILED)>;

// Inverse depth, 0 where there is none.
fn picture(pixel: vec2i) -> f32 {
    if any(pixel < vec2i(0)) || any(pixel >= vec2i(params.size)) {
        return 0.0;
    }
    let bits = depth_bits[u32(pixel.y) * params.size.x + u32(pixel.x)];
    let is_usable = bits >= params.min_bits && bits < params.end_bits;
    return select(0.0, 1.0 / bitcast<f32>(bits), is_usable);
}

// What the workgroup's pixels and their surroundings show.
fn load_tile(group: vec2u, local: u32) {
    for (var i = local; i < TILE * TILE; i += GROUP * GROUP) {
        tile[i] = picture(vec2i(group * GROUP + vec2u(i % TILE, i / TILE)) - i32(RADIUS));
    }
}

// Inverse depth at a tap of the window around a pixel.
fn tap(pixel: vec2u, local: vec2u, column: u32, row: u32) -> f32 {
    if TILED {
        return tile[(local.y + row) * TILE + local.x + column];
    }
    return picture(vec2i(pixel + vec2u(column, row)) - i32(RADIUS));
}

// The range weight exp(-t) is taken as max(0, 1 - t/8)^8, as on the CPU: exactly zero beyond four
// standard deviations.
fn filtered_depth_m(pixel: vec2u, local: vec2u, centre: f32) -> f32 {
    // of inverse depth: a metre at this depth is 1 / z^2
    let scale = params.range_scale / (centre * centre * (centre * centre));
    var offset = 0.0;
    var weight = 0.0;
    for (var row = 0u; row < SIDE; row++) {
        for (var column = 0u; column < SIDE; column++) {
            let inverse = tap(pixel, local, column, row);
            let difference = inverse - centre;
            let t = max(1.0 - difference * difference * scale, 0.0);
            let t2 = t * t;
            let t4 = t2 * t2;
            let w = select(0.0, spatial[row * SIDE + column] * (t4 * t4), inverse > 0.0);
            offset += w * difference;
            weight += w;
        }
    }
    // the centre's own weight is 1
    return 1.0 / (centre + offset / weight);
}

@compute @workgroup_size(GROUP, GROUP)
fn main(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(workgroup_id) group: vec3u,
    @builtin(local_invocation_id) local: vec3u,
    @builtin(local_invocation_index) local_index: u32,
) {
    if TILED {
        load_tile(group.xy, local_index);
        workgroupBarrier();
    }
    if all(id.xy < params.size) {
        let centre = tap(id.xy, local.xy, RADIUS, RADIUS);
        var out_m = 0.0;
        if centre > 0.0 {
            out_m = filtered_depth_m(id.xy, local.xy, centre);
        }
        filtered_m[id.y * params.size.x + id.x] = out_m;
    }
}
