// Takes the storage of blocks that hold free space only. Blocks near this picture's depth are kept, and
// blocks beside a surface, whose cells need their voxels.
// Constant: FREE, the distance above which there is free space.
#import fusion/blocks

@group(0) @binding(0) var<uniform> params: GridUniform;
@group(0) @binding(1) var<storage, read> marks: array<u32>;
// of blocks that lost their storage FREE or more, of those that never had any 0
@group(0) @binding(2) var<storage, read> lowest: array<i32>;
@group(0) @binding(3) var<storage, read_write> table: array<u32>;
@group(0) @binding(4) var<storage, read_write> sides: array<vec4u>;
@group(0) @binding(5) var<storage, read_write> free: array<u32>;
@group(0) @binding(6) var<storage, read_write> counters: Counters;

fn is_beside_surface(index: u32) -> bool {
    let block = block_coords(index, params.grid);
    let first = max(block, vec3u(1u)) - 1u;
    let last = min(block + 1u, vec3u(params.grid - 1u));
    for (var z = first.z; z <= last.z; z++) {
        for (var y = first.y; y <= last.y; y++) {
            for (var x = first.x; x <= last.x; x++) {
                if lowest[block_index(vec3u(x, y, z), params.grid)] < 0 {
                    return true;
                }
            }
        }
    }
    return false;
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let index = id.x;
    if index >= params.grid * params.grid * params.grid {
        return;
    }
    let slot = table[index];
    let is_marked = ((marks[index / 32u] >> (index % 32u)) & 1u) == 1u;
    if slot == EMPTY || is_marked || lowest[index] < i32(FREE) || is_beside_surface(index) {
        return;
    }
    table[index] = EMPTY;
    sides[index] = vec4u(0u);
    let kept = counters.free - min(counters.free, atomicLoad(&counters.taken));
    free[kept + atomicAdd(&counters.released, 1u)] = slot;
}
