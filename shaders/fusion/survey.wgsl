// Takes one more axis into distances between blocks: the largest of the axes counts, so that axes can be
// taken one after the other.
// Constants: AXIS; FARTHEST, beyond which distances are not followed.
#import fusion/blocks

@group(0) @binding(0) var<uniform> params: GridUniform;
@group(0) @binding(1) var<storage, read> narrow: array<u32>;
@group(0) @binding(2) var<storage, read_write> distances: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let index = id.x;
    if index >= params.grid * params.grid * params.grid {
        return;
    }
    let place = block_coords(index, params.grid)[AXIS];
    var step = vec3u(0u);
    step[AXIS] = 1u;
    let stride = block_index(step, params.grid);
    var nearest = narrow[index];
    for (var i = 1u; i < FARTHEST && i < nearest; i++) {
        // at the border its last block counts, which is no farther
        let before = narrow[index - stride * min(i, place)];
        let after = narrow[index + stride * min(i, params.grid - 1u - place)];
        nearest = min(nearest, max(i, min(before, after)));
    }
    distances[index] = nearest;
}
