// Gives marked blocks storage, and lists the blocks that the picture may change.
#import fusion/blocks
#import fusion/fuse

@group(0) @binding(0) var<uniform> params: FuseUniform;
@group(0) @binding(1) var<storage, read> marks: array<u32>;
// slots that came back
@group(0) @binding(2) var<storage, read> free: array<u32>;
@group(0) @binding(3) var<storage, read_write> table: array<u32>;
@group(0) @binding(4) var<storage, read_write> counters: Counters;
// how many blocks are listed, 1, 1
@group(0) @binding(5) var<storage, read_write> groups: array<atomic<u32>>;
@group(0) @binding(6) var<storage, read_write> work: array<u32>;

// EMPTY where the pool is full.
fn take_slot() -> u32 {
    let number = atomicAdd(&counters.taken, 1u);
    if number < counters.free {
        return free[counters.free - 1u - number];
    }
    let slot = 1u + counters.used + (number - counters.free);
    return select(EMPTY, slot, slot < params.capacity);
}

// Whether positions along an axis reach between the picture's borders: half-spaces u >= -1/2 and
// u <= pixels - 1/2, multiplied by w.
fn is_inside(position: f32, depth_m: f32, scale: f32, centre: f32, pixels: u32, radius: f32) -> bool {
    let by_depth = f32(params.view.perspective);
    let low = centre + 0.5;
    let high = f32(pixels) - 0.5 - centre;
    let w = by_depth * depth_m + (1.0 - by_depth);
    let low_reach = radius * length(vec2f(scale, low * by_depth));
    let high_reach = radius * length(vec2f(scale, high * by_depth));
    return position * scale + low * w >= -low_reach && high * w - position * scale >= -high_reach;
}

// Whether the block's bounding sphere reaches into the frustum, and in front of the farthest surface.
fn sees(block: vec3u) -> bool {
    let radius = 3.5 * sqrt(3.0) * params.voxel_m;
    let p = into_view(params.view, vec3f(block) * 8.0 + 3.5);
    let farthest_m = bitcast<f32>(atomicLoad(&counters.max_depth_bits)) + params.truncation_m;
    if p.z + radius < FUSE_NEAREST_M || p.z - radius > farthest_m {
        return false;
    }
    let view = params.view;
    return is_inside(p.x, p.z, view.scale.x, view.centre.x, view.size.x, radius)
        && is_inside(p.y, p.z, view.scale.y, view.centre.y, view.size.y, radius);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let index = id.x;
    if index >= params.grid * params.grid * params.grid {
        return;
    }
    var slot = table[index];
    var entry = index;
    if slot == EMPTY && ((marks[index / 32u] >> (index % 32u)) & 1u) == 1u {
        slot = take_slot();
        table[index] = slot;
        entry |= FRESH;
    }
    if slot != EMPTY && ((entry & FRESH) != 0u || sees(block_coords(index, params.grid))) {
        work[atomicAdd(&groups[0], 1u)] = entry;
    }
}
