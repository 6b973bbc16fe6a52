// What rays through the volume have in common. Uses the bindings `table`, `crossings` and `voxels`, and of
// `params` the `grid`, the highest voxel coordinate `last`, and `scale`, voxels per stored step.
// Constants: LEAST_COMPONENT of a direction; MIN_STEP, STEP_SHARE, STEP_BEYOND, MAX_STEP, in voxels.
#import fusion/empty
#import fusion/rays
#import fusion/sample

// In voxels.
struct Distance {
    value: f32,
    is_known: bool,
}

// Kept in the volume.
fn point_at(ray: Ray, t: f32) -> vec3f {
    return clamp(ray.origin + ray.direction * t, vec3f(0.0), vec3f(params.last));
}

fn trilinear(point: vec3f) -> Distance {
    let base = min(vec3u(point), vec3u(highest_voxel() - 1u));
    let cell = cell_at(point, base);
    return Distance(value_in(cell) * params.scale, cell.is_known);
}

// How far to go from a point at this distance from a surface, in voxels.
fn step_at(distance: Distance) -> f32 {
    let wanted = abs(distance.value) * STEP_SHARE + STEP_BEYOND;
    return select(MIN_STEP, clamp(wanted, MIN_STEP, MAX_STEP), distance.is_known);
}

// A ray along an axis never crosses the planes of the others: far away, not 0/0.
fn away_from_zero(direction: vec3f) -> vec3f {
    return select(direction, vec3f(LEAST_COMPONENT), abs(direction) < vec3f(LEAST_COMPONENT));
}
