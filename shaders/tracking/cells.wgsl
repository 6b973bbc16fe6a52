// Means of intensity and depth over a grid of cells: what a keyframe is recognised by.
// Constants: COLUMNS and ROWS of the grid; MIN_CELL_DEPTH, the share of a cell's pixels beyond which it has
// depth.

struct CellsUniform {
    size: vec2u,
}

const CELLS = COLUMNS * ROWS;
const INFINITY_BITS = 0x7f800000u;

@group(0) @binding(0) var<uniform> params: CellsUniform;
// bits of colour and intensity
@group(0) @binding(1) var<storage, read> color: array<vec4u>;
@group(0) @binding(2) var<storage, read> depth_bits: array<u32>;
// intensity of all cells, then depth
@group(0) @binding(3) var<storage, read_write> means: array<f32>;

struct Mean {
    sum: f32,
    count: f32,
}

// With one more value, given as bits: it counts or does not.
fn with_value(mean: Mean, bits: u32, counts: bool) -> Mean {
    let value = bitcast<f32>(select(0u, bits, counts));
    return Mean(mean.sum + value, mean.count + f32(counts));
}

fn value(mean: Mean, more_than: f32) -> f32 {
    return select(0.0, mean.sum / max(mean.count, 1.0), mean.count > more_than);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= CELLS {
        return;
    }
    let grid = vec2u(COLUMNS, ROWS);
    let cell = vec2u(id.x % COLUMNS, id.x / COLUMNS);
    let first = cell * params.size / grid;
    let end = max((cell + 1u) * params.size / grid, first + 1u);
    var intensity = Mean(0.0, 0.0);
    var depth = Mean(0.0, 0.0);
    for (var y = first.y; y < end.y; y++) {
        for (var x = first.x; x < end.x; x++) {
            let at = y * params.size.x + x;
            let steps = color[at].w;
            let metres = depth_bits[at];
            intensity = with_value(intensity, steps, (steps & INFINITY_BITS) != INFINITY_BITS);
            depth = with_value(depth, metres, metres > 0u && metres < INFINITY_BITS);
        }
    }
    let pixels = f32((end.x - first.x) * (end.y - first.y));
    means[id.x] = value(intensity, 0.0);
    means[CELLS + id.x] = value(depth, MIN_CELL_DEPTH * pixels);
}
