// A depth picture enters the listed blocks, a workgroup for each: weighted running average of truncated
// projective distances (Curless and Levoy 1996; Newcombe et al., "KinectFusion", 2011, Eq. 6-13).
#import fusion/blocks
#import fusion/look_up
#import fusion/voxels

@group(0) @binding(0) var<uniform> params: FuseUniform;
@group(0) @binding(1) var<storage, read> depth_bits: array<u32>;
@group(0) @binding(2) var<storage, read> table: array<u32>;
@group(0) @binding(3) var<storage, read> work: array<u32>;
@group(0) @binding(4) var<storage, read_write> voxels: array<u32>;
// by block: the smallest seen distance, ONE where nothing was seen
@group(0) @binding(5) var<storage, read_write> lowest: array<i32>;
// by block: bricks of 2x2x2 voxels with one in front of a surface, and with one on it or behind it
@group(0) @binding(6) var<storage, read_write> sides: array<vec4u>;

var<workgroup> least: atomic<i32>;
var<workgroup> bricks: array<atomic<u32>, 4>;

fn average(word: u32, distance_m: f32) -> u32 {
    let one = f32(ONE);
    let is_free = distance_m > params.truncation_m;
    let seen = clamp(distance_m * (one / params.truncation_m), -one, one);
    let old = f32(stored_distance(word));
    let known = f32(stored_weight(word));
    let weight = select(known, min(known, params.free_weight), is_free);
    // An unseen voxel has weight 0: `old` cancels. Rounded to the nearest, ties to even.
    let mean = clamp(round(old + (seen - old) / (weight + 1.0)), -one, one);
    return voxel_word(i32(mean), u32(min(weight + 1.0, params.max_weight)));
}

@compute @workgroup_size(8, 8, 4)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(local_invocation_id) local: vec3u,
    @builtin(local_invocation_index) number: u32,
) {
    if number == 0u {
        atomicStore(&least, i32(ONE));
    }
    workgroupBarrier();

    let index = work[group.x] & ~FRESH;
    let is_fresh = (work[group.x] & FRESH) != 0u;
    let first = table[index] * BLOCK_VOXELS;
    let block = block_coords(index, params.grid);
    var nearest = i32(ONE);
    var has_front = false;
    var has_behind = false;
    // two voxels of one brick
    for (var i = 0u; i < 2u; i++) {
        let voxel = vec3u(local.xy, 2u * local.z + i);
        let at = first + (voxel.z * 8u + voxel.y) * 8u + voxel.x;
        var word = 0u;
        if !is_fresh {
            word = voxels[at];
        }
        let seen = look_up(block, voxel);
        if seen.is_valid {
            word = average(word, seen.distance_m);
        }
        if seen.is_valid || is_fresh {
            voxels[at] = word;
        }
        let distance = stored_distance(word);
        if distance != UNSEEN {
            nearest = min(nearest, distance);
            has_front = has_front || distance > 0;
            has_behind = has_behind || distance <= 0;
        }
    }
    atomicMin(&least, nearest);
    let bit = 1u << ((local.z & 1u) * 16u + (local.y >> 1u) * 4u + (local.x >> 1u));
    if has_front {
        atomicOr(&bricks[local.z >> 1u], bit);
    }
    if has_behind {
        atomicOr(&bricks[2u + (local.z >> 1u)], bit);
    }
    workgroupBarrier();

    if number == 0u {
        lowest[index] = atomicLoad(&least);
        sides[index] = vec4u(
            atomicLoad(&bricks[0]),
            atomicLoad(&bricks[1]),
            atomicLoad(&bricks[2]),
            atomicLoad(&bricks[3]),
        );
    }
}
