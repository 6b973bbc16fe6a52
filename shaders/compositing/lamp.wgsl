// The light of a frame; the main file's `params.lamp`.
// Constant: MAX_VISIBILITY.
struct Lamp {
    // RGB of each coefficient, zero beyond the light's bands
    coefficients: array<vec4f, 36>,
    // shading of an unoccluded surface as a polynomial of its normal
    polynomial: array<vec4f, 9>,
    floor: f32,
    visibility_offset: f32,
    pad0: u32,
    pad1: u32,
}

// Shading of an unoccluded surface, not negative.
fn unoccluded(n: vec3f) -> vec3f {
    var terms = array<f32, 9>(
        1.0,
        n.y,
        n.z,
        n.x,
        n.x * n.y,
        n.y * n.z,
        3.0 * n.z * n.z - 1.0,
        n.x * n.z,
        n.x * n.x - n.y * n.y,
    );
    var sum = vec3f(0.0);
    for (var i = 0u; i < 9u; i++) {
        sum += terms[i] * params.lamp.polynomial[i].rgb;
    }
    return max(sum, vec3f(0.0));
}

// Part of the unoccluded light that arrives.
fn visibility(shading: vec3f, unoccluded: vec3f) -> vec3f {
    let offset = params.lamp.visibility_offset;
    return min((shading + offset) / (unoccluded + offset), vec3f(MAX_VISIBILITY));
}

// Inverse of `visibility`.
fn shading_from(visibility: vec3f, unoccluded: vec3f) -> vec3f {
    let offset = params.lamp.visibility_offset;
    return max(visibility * (unoccluded + offset) - offset, vec3f(params.lamp.floor));
}
