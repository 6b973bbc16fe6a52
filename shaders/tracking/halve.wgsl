// The next coarser level: the mean inverse depth of those of each 2x2 pixels that are within an edge of the nearest of
// them, which is exact on planes.

struct HalveUniform {
    // of the coarse level
    size: vec2u,
    fine_width: u32,
    edge_m: f32,
}

@group(0) @binding(0) var<uniform> params: HalveUniform;
@group(0) @binding(1) var<storage, read> fine_m: array<f32>;
@group(0) @binding(2) var<storage, read_write> coarse_m: array<f32>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.size) {
        return;
    }
    let first = 2u * (id.y * params.fine_width + id.x);
    let below = first + params.fine_width;
    let block = array(fine_m[first], fine_m[first + 1u], fine_m[below], fine_m[below + 1u]);
    var nearest = max(max(block[0], block[1]), max(block[2], block[3]));
    for (var i = 0; i < 4; i++) {
        nearest = select(nearest, min(nearest, block[i]), block[i] > 0.0);
    }
    var sum = 0.0;
    var count = 0.0;
    for (var i = 0; i < 4; i++) {
        let is_same = block[i] > 0.0 && block[i] - nearest < params.edge_m;
        sum += select(0.0, 1.0 / block[i], is_same);
        count += f32(is_same);
    }
    coarse_m[id.y * params.size.x + id.x] = select(0.0, count / sum, count > 0.0);
}
