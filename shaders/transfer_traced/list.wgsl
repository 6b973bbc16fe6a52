// Lists the points that send rays, so that no invocation is idle beside those that do; points of a tile stay
// together, whose rays go the same way.
// Constant: KNOWN_TOO, whether points are listed whose rays through the volume are known.
#import transfer_traced/points

@group(0) @binding(1) var<storage, read> how: array<u32>;
// numbers of points plus one; zeros before
@group(0) @binding(2) var<storage, read_write> list: array<u32>;
// workgroups that the list makes, words of directions, 1, length of the list
@group(0) @binding(3) var<storage, read_write> groups: array<atomic<u32>>;

var<workgroup> count: atomic<u32>;
var<workgroup> first: u32;

@compute @workgroup_size(8, 8)
fn main(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    var is_listed = false;
    var rank = 0u;
    if all(id.xy < params.points) {
        let way = how[point_index(id.xy)];
        is_listed = way == TRACED || (KNOWN_TOO && way == KNOWN);
        if is_listed {
            rank = atomicAdd(&count, 1u);
        }
    }
    workgroupBarrier();
    if local == 0u {
        let listed = atomicLoad(&count);
        first = atomicAdd(&groups[3], listed);
        if listed > 0u {
            atomicMax(&groups[0], (first + listed + LISTED_TOGETHER - 1u) / LISTED_TOGETHER);
        }
    }
    workgroupBarrier();
    if is_listed {
        list[first + rank] = point_index(id.xy) + 1u;
    }
}
