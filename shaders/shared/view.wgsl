// Where a picture is taken from. View axes are x right, y down, z forward; depth is z in metres.
struct View {
    world_from_view: mat4x4f,
    view_from_world: mat4x4f,
    // u = x * scale / w + centre; w is depth in a perspective view and 1 in an orthographic one
    scale: vec2f,
    centre: vec2f,
    size: vec2u,
    perspective: u32,
    pad: u32,
}

struct Projected {
    pixel: vec2f,
    // z in the view's axes, metres
    depth_m: f32,
    // at or behind a perspective camera there is no pixel
    is_before: bool,
}

fn project(view: View, point_in_world: vec3f) -> Projected {
    let p = (view.view_from_world * vec4f(point_in_world, 1.0)).xyz;
    let w = select(1.0, p.z, view.perspective == 1u);
    let is_before = w > 0.0;
    let pixel = p.xy * view.scale / select(1.0, w, is_before) + view.centre;
    return Projected(pixel, p.z, is_before);
}

// In the view's axes.
fn unproject(view: View, pixel: vec2f, depth_m: f32) -> vec3f {
    let w = select(1.0, depth_m, view.perspective == 1u);
    return vec3f((pixel - view.centre) / view.scale * w, depth_m);
}

fn unproject_to_world(view: View, pixel: vec2f, depth_m: f32) -> vec3f {
    return (view.world_from_view * vec4f(unproject(view, pixel, depth_m), 1.0)).xyz;
}
