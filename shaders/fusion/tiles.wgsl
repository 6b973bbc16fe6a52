// Where along a ray surfaces can lie at all: depth ranges of square tiles of pixels, drawn from the boxes
// of octants of blocks that hold surface, an invocation for each (after Kaehler et al., "Very high frame
// rate volumetric integration of depth images on mobile devices", 2015).
// Constants: TILE, pixels a side of a tile; TILE_NEAREST_M, boxes nearer may cover the whole picture;
// OCTANT, voxels a side of an octant; MARGIN, voxels that a box reaches beyond its voxels' centres;
// MAX_STEP, voxels.
#import fusion/blocks
#import fusion/rays

struct TilesUniform {
    view: ViewFromVoxel,
    voxel_m: f32,
    grid: u32,
    pad0: u32,
    pad1: u32,
}

@group(0) @binding(0) var<uniform> params: TilesUniform;
@group(0) @binding(1) var<storage, read> crossings: array<vec2u>;
// two words a tile: the bits of the near end inverted, so that zero is none and the largest is the
// nearest, and the bits of the far end
@group(0) @binding(2) var<storage, read_write> ranges: array<atomic<u32>>;

// Of a cube of side 1, x fastest.
fn corner(i: u32) -> vec3f {
    return vec3f(vec3u(i, i >> 1u, i >> 2u) & vec3u(1u));
}

fn draw_box(low: vec3f) {
    let view = params.view;
    let is_perspective = view.perspective == 1u;
    var near = 1e38;
    var far = -1e38;
    var least = vec2f(1e38);
    var most = vec2f(-1e38);
    for (var i = 0u; i < 8u; i++) {
        let p = into_view(view, low + corner(i) * (OCTANT + 2.0 * MARGIN - 1.0));
        near = min(near, p.z);
        far = max(far, p.z);
        let w = select(1.0, max(p.z, TILE_NEAREST_M), is_perspective);
        let pixel = p.xy * view.scale / w + view.centre;
        least = min(least, pixel);
        most = max(most, pixel);
    }
    let size = vec2f(view.size);
    if is_perspective && near <= TILE_NEAREST_M {
        least = vec2f(0.0);
        most = size;
    }
    // one pixel more against rounding
    if far <= TILE_NEAREST_M || any(most < vec2f(-1.0)) {
        return;
    }
    let tiles = (view.size + (TILE - 1u)) / TILE;
    let first = vec2u(clamp(least - 1.0, vec2f(0.0), size + f32(TILE))) / TILE;
    let last = min((vec2u(clamp(most, vec2f(0.0), size)) + 1u) / TILE, tiles - 1u);
    let near_bits = ~bitcast<u32>(max(near, 0.0));
    let far_bits = bitcast<u32>(far + MAX_STEP * params.voxel_m);
    for (var y = first.y; y <= last.y; y++) {
        for (var x = first.x; x <= last.x; x++) {
            let tile = 2u * (y * tiles.x + x);
            atomicMax(&ranges[tile], near_bits);
            atomicMax(&ranges[tile + 1u], far_bits);
        }
    }
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let index = id.x / 8u;
    let octant = id.x % 8u;
    if index >= params.grid * params.grid * params.grid {
        return;
    }
    let shift = (octant & 1u) * 2u + ((octant >> 1u) & 1u) * 8u;
    let planes = crossings[index][octant >> 2u] >> shift;
    if (planes & FIRST_OCTANT) != 0u {
        let place = vec3f(block_coords(index, params.grid)) * 8.0 + corner(octant) * OCTANT;
        draw_box(place - MARGIN);
    }
}
