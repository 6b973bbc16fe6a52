// Depth beyond which a pixel of a geometry buffer hides samples. The main file declares `params` with `view`,
// `bias_m` and `first`.
#import shared/view

// Hides nothing: no sample lies as far away.
const NOTHING_M = 3.0e38;
// Surfaces beyond this depth are taken as missing, so that nothing overflows.
const FARTHEST_M = 1.0e9;
const LONGEST_NORMAL = 1.0e25;

struct LimitsUniform {
    view: View,
    bias_m: f32,
    // of the view's pixels among those of all views
    first: u32,
    // of the view's extent among those of all views
    extent: u32,
    pad: u32,
}

// False for what is no number, too: its bits are above those of every number.
fn is_between(value: f32, low: f32, high: f32) -> bool {
    let bits = bitcast<u32>(value);
    return bits > bitcast<u32>(low) && bits < bitcast<u32>(high);
}

// Depth is taken where the tangent plane is farthest inside the pixel: a plane never hides what is in
// front of it, seen from however far and however flat.
fn hidden_beyond(pixel: vec2u, surface: vec4f) -> f32 {
    let z = surface.w;
    if !is_between(z, 0.0, FARTHEST_M) {
        return NOTHING_M;
    }
    let n = (params.view.view_from_world * vec4f(surface.xyz, 0.0)).xyz;
    if all(n == vec3f(0.0)) {
        // without a normal there is no plane to extend
        return z + params.bias_m;
    }
    if !is_between(abs(n.x) + abs(n.y) + abs(n.z), 0.0, LONGEST_NORMAL) {
        return NOTHING_M;
    }
    let half_pixel = 0.5 / params.view.scale;
    let across = abs(n.x) * half_pixel.x + abs(n.y) * half_pixel.y;
    var far_m = 0.0;
    if params.view.perspective == 1u {
        // the plane n.p = const: inverse depth is linear in the pixel
        let ray = (vec2f(pixel) - params.view.centre) / params.view.scale;
        let along = abs(n.x * ray.x + n.y * ray.y + n.z);
        if !(along > across) {
            // seen edge on within the pixel
            return NOTHING_M;
        }
        far_m = z * along / (along - across);
    } else {
        // depth itself is linear
        if !(abs(n.z) > 1e-20) {
            return NOTHING_M;
        }
        far_m = z + across / abs(n.z);
    }
    return min(far_m + params.bias_m, NOTHING_M);
}
