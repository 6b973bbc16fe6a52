// How many blocks away along x the nearest one is that may hold surface.
// Constant: FARTHEST, beyond which distances are not followed.
#import fusion/blocks

@group(0) @binding(0) var<uniform> params: GridUniform;
@group(0) @binding(1) var<storage, read> crossings: array<vec2u>;
@group(0) @binding(2) var<storage, read_write> distances: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let index = id.x;
    if index >= params.grid * params.grid * params.grid {
        return;
    }
    let x = index % params.grid;
    var distance = 0u;
    for (; distance < FARTHEST; distance++) {
        let before = crossings[index - min(distance, x)];
        let after = crossings[index + min(distance, params.grid - 1u - x)];
        if any((before | after) != vec2u(0u)) {
            break;
        }
    }
    distances[index] = distance;
}
