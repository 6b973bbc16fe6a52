// Views in a volume's voxel coordinates, whose integers are voxel centres.

// Rays of pixels: origin + direction * depth_m, for both projections.
struct Rays {
    eye: vec4f,
    // voxels along the view's axes per metre
    x: vec4f,
    y: vec4f,
    z: vec4f,
    centre: vec2f,
    per_pixel: vec2f,
    size: vec2u,
    perspective: u32,
    pad: u32,
}

struct Ray {
    origin: vec3f,
    direction: vec3f,
}

fn ray_at(rays: Rays, pixel: vec2f) -> Ray {
    let offset = (pixel - rays.centre) * rays.per_pixel;
    let aside = rays.x.xyz * offset.x + rays.y.xyz * offset.y;
    if rays.perspective == 1u {
        return Ray(rays.eye.xyz, aside + rays.z.xyz);
    }
    return Ray(rays.eye.xyz + aside, rays.z.xyz);
}

// Linear map from voxel coordinates to a view's axes, metres, and on to its pixels.
struct ViewFromVoxel {
    origin: vec4f,
    x: vec4f,
    y: vec4f,
    z: vec4f,
    scale: vec2f,
    centre: vec2f,
    size: vec2u,
    perspective: u32,
    pad: u32,
}

fn into_view(view: ViewFromVoxel, p: vec3f) -> vec3f {
    return view.origin.xyz + view.x.xyz * p.x + view.y.xyz * p.y + view.z.xyz * p.z;
}
