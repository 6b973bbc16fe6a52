// What of the real pass holds with virtual objects: rays through the volume where a point shows the same
// surface, and everything where no object is near.
#import transfer_traced/surfaces
#import transfer_traced/triangles

@group(0) @binding(1) var<storage, read> surface: array<vec4f>;
@group(0) @binding(2) var<storage, read> surface_before: array<vec4f>;
@group(0) @binding(3) var<storage, read> how_before: array<u32>;
@group(0) @binding(4) var<storage, read> instances: array<Instance>;
@group(0) @binding(5) var<storage, read_write> how: array<u32>;

fn is_reached(position: vec3f) -> bool {
    for (var i = 0u; i < params.instances; i++) {
        let sphere = instances[i].sphere;
        if distance(position, sphere.xyz) <= sphere.w + params.reach_m + params.object_lift_m {
            return true;
        }
    }
    return false;
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.points) {
        return;
    }
    let at = point_index(id.xy);
    if how[at] != TRACED || how_before[at] != TRACED {
        return;
    }
    let pixel = grid_pixel(id.xy, params.step);
    let index = pixel_index(pixel);
    if any(bitcast<vec4u>(surface[index]) != bitcast<vec4u>(surface_before[index])) {
        return;
    }
    how[at] = select(UNCHANGED, KNOWN, is_reached(surface_at(pixel).position));
}
