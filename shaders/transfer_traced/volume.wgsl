// What the volume hides from points: a ray for every direction above the horizon, until it meets a surface or
// ends. One invocation has 32 directions of a point, so that neighbours look in the same direction.
// Constants: those of `fusion/walk`.
#import transfer_traced/surfaces
#import fusion/walk

@group(0) @binding(1) var<storage, read> surface: array<vec4f>;
@group(0) @binding(2) var<storage, read> directions: array<vec4f>;
@group(0) @binding(3) var<storage, read> table: array<u32>;
@group(0) @binding(4) var<storage, read> crossings: array<vec2u>;
@group(0) @binding(5) var<storage, read> voxels: array<u32>;
// of blocks to the nearest one that may hold surface
@group(0) @binding(6) var<storage, read> distances: array<u32>;
// numbers of points plus one, zero where there is none
@group(0) @binding(7) var<storage, read> list: array<u32>;
@group(0) @binding(8) var<storage, read_write> hits: array<u32>;

// Voxels around an empty cube that are empty too: where it is a block, the blocks around it count.
fn margin_of(voxel: vec3u, side: u32) -> u32 {
    if side < 8u {
        return 0u;
    }
    // a block without surface is one away from the nearest at least
    return (max(distances[block_index(voxel >> vec3u(3u), params.grid)], 1u) - 1u) * 8u;
}

// A ray is stopped by the first distance not above zero that it meets after it has been outside: in front of a
// surface, or further than the truncation band from any. Until then it is leaving its own surface. What
// lies beyond the volume stops nothing.
fn meets(origin: vec3f, w: vec3f) -> bool {
    let ray = Ray(origin, away_from_zero(w / params.voxel_m));
    let inverse = 1.0 / ray.direction;
    let a = -ray.origin * inverse;
    let b = (vec3f(params.last) - ray.origin) * inverse;
    let enter = min(a, b);
    let exit = max(a, b);
    let near = max(max(max(enter.x, enter.y), enter.z), 0.0);
    let far = min(min(min(exit.x, exit.y), exit.z), params.reach_m);
    let per_voxel = 1.0 / sqrt(dot(ray.direction, ray.direction));
    var t = near;
    var was_outside = near > 0.0;
    for (var i = 0u; i < params.most_steps && t <= far; i++) {
        let point = point_at(ray, t);
        let voxel = vec3u(point + 0.5);
        let side = empty_side(voxel);
        if side != 0u {
            let end = leave(ray.origin, inverse, voxel, side, margin_of(voxel, side));
            t = max(end, t + NUDGE * per_voxel);
            was_outside = true;
            continue;
        }
        let found = trilinear(point);
        if found.is_known {
            if was_outside && found.value <= 0.0 {
                return true;
            }
            was_outside = was_outside || found.value > 0.0;
        }
        t += step_at(found) * per_voxel;
    }
    return false;
}

@compute @workgroup_size(LISTED_TOGETHER)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let number = list[id.x];
    if number == 0u {
        return;
    }
    let point = vec2u((number - 1u) % params.points.x, (number - 1u) / params.points.x);
    let shown = surface_at(grid_pixel(point, params.step));
    let lifted = shown.position + params.lift_m * shown.normal;
    let origin = (lifted - params.min_corner.xyz) / params.voxel_m - 0.5;
    let first = id.y * 32u;
    var found = 0u;
    for (var d = first; d < min(first + 32u, params.directions); d++) {
        let w = directions[d * ROW].xyz;
        if dot(shown.normal, w) > 0.0 && meets(origin, w) {
            found |= 1u << (d - first);
        }
    }
    hits[hits_index(point, id.y)] = found;
}
