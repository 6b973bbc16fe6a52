// What a depth picture says of a voxel. Uses the bindings `params` and `depth_bits`.
#import fusion/fuse

struct Seen {
    is_valid: bool,
    // signed, from the voxel to the surface along the view's axis
    distance_m: f32,
    // the nearest one
    pixel: u32,
}

const NOT_SEEN = Seen(false, 0.0, 0u);

// Missing (0.0) where it is negative, infinite or no number.
fn depth_at(at: u32) -> f32 {
    let bits = depth_bits[at];
    return bitcast<f32>(select(0u, bits, bits < 0x7f800000u));
}

// A voxel of the block, from 0 to 7 along each axis. Steps are added in the order of the CPU's, which
// handles two rows at once.
fn position_in_view(block: vec3u, voxel: vec3u) -> vec3f {
    let row = voxel.y & 1u;
    let first = into_view(params.view, vec3f(block * 8u + vec3u(0u, voxel.y - row, voxel.z)));
    return first + f32(voxel.x) * params.view.x.xyz + f32(row) * params.view.y.xyz;
}

fn look_up(block: vec3u, voxel: vec3u) -> Seen {
    let view = params.view;
    let p = position_in_view(block, voxel);
    if !(p.z > FUSE_NEAREST_M) {
        return NOT_SEEN;
    }
    let w = select(1.0, p.z, view.perspective == 1u);
    let last = vec2f(view.size - 1u);
    let exact = p.xy * view.scale / w + view.centre;
    if !(all(exact >= vec2f(-0.5)) && all(exact <= last + 0.5)) {
        return NOT_SEEN;
    }
    let place = clamp(exact, vec2f(0.0), last);
    let base = vec2u(place);
    let fraction = place - vec2f(base);
    let step_x = select(0u, 1u, base.x + 1u < view.size.x);
    let step_y = select(0u, view.size.x, base.y + 1u < view.size.y);
    let at = base.y * view.size.x + base.x;
    let pixel = at + select(0u, step_x, fraction.x >= 0.5) + select(0u, step_y, fraction.y >= 0.5);

    let a = depth_at(at);
    let b = depth_at(at + step_x);
    let c = depth_at(at + step_y);
    let d = depth_at(at + step_x + step_y);
    let low = min(min(a, b), min(c, d));
    let high = max(max(a, b), max(c, d));
    var depth_m = depth_at(pixel);
    if low > 0.0 && high - low <= params.edge * low {
        let top = a + (b - a) * fraction.x;
        let bottom = c + (d - c) * fraction.x;
        depth_m = top + (bottom - top) * fraction.y;
    }
    let distance_m = depth_m - p.z;
    return Seen(depth_m > 0.0 && distance_m >= -params.truncation_m, distance_m, pixel);
}
