// How alike two surfaces are, by tangent plane and normal; the main file's `params` is an EdgeAwareUniform.
//
// The point at pixel (u, v) is o + d (z + u x + v y), with x and y the steps of one pixel at depth 1, so a
// neighbour lies n.z' (d' - d) + d' (du n.x + dv n.y) off the plane, z' = z + u x + v y.
struct EdgeAwareUniform {
    step_x: vec4f,
    step_y: vec4f,
    step_z: vec4f,
    grid: vec2u,
    image: vec2u,
    // of the grid, pixels
    step: u32,
    plane_tolerance: f32,
    normal_exponent: f32,
    // 1: also where virtual objects change nothing
    everywhere: u32,
}

// Tangent plane of the surface at a pixel.
struct TangentPlane {
    pixel: vec2f,
    depth_m: f32,
    // 0 where depth is missing
    inverse_depth: f32,
    normal: vec3f,
    // the normal along one step in x and y, and along the ray
    along: vec2f,
    along_ray: f32,
}

fn tangent_plane(pixel: vec2u, surface: vec4f) -> TangentPlane {
    let n = surface.xyz;
    let at = vec2f(pixel);
    let along = vec2f(dot(n, params.step_x.xyz), dot(n, params.step_y.xyz));
    let along_ray = dot(n, params.step_z.xyz) + (at.x * along.x + at.y * along.y);
    let has_depth = surface.w > 0.0;
    let inverse_depth = select(0.0, 1.0 / select(1.0, surface.w, has_depth), has_depth);
    return TangentPlane(at, surface.w, inverse_depth, n, along, along_ray);
}

// Of another pixel's surface from the tangent plane, metres.
fn distance_m(plane: TangentPlane, pixel: vec2u, depth_m: f32) -> f32 {
    let d = vec2f(pixel) - plane.pixel;
    return plane.along_ray * (depth_m - plane.depth_m)
        + depth_m * (d.x * plane.along.x + d.y * plane.along.y);
}

// 1 for the same plane, 0 beyond the tolerance; the cosine of the normals to about the exponent's power, as
// (1 - p/8 (1 - cos))^8.
fn likeness(plane: TangentPlane, pixel: vec2u, surface: vec4f) -> f32 {
    let relative = distance_m(plane, pixel, surface.w) * plane.inverse_depth;
    let off = relative / params.plane_tolerance;
    let near = max(1.0 - off * off, 0.0);
    let cosine = dot(plane.normal, surface.xyz);
    let eighth = clamp(1.0 - params.normal_exponent * 0.125 * (1.0 - cosine), 0.0, 1.0);
    let fourth = eighth * eighth;
    let half = fourth * fourth;
    return near * near * half * half;
}
