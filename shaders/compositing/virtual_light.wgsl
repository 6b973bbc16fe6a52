// Of each pixel the linear light of the virtual object that it shows, -1 where it shows none, and the share
// that virtual objects cover; R' of virtual pixels, from the part of the light that arrives.
// Constants: PLANES; MAX_VISIBILITY; VISIBILITY, whether R' is stored as that part; ANTIALIAS; SHOULDER, the
// brightness from which on light is compressed.
#import compositing/planes
#import compositing/lamp

struct VirtualLightUniform {
    lamp: Lamp,
    size: vec2u,
    mean_albedo: f32,
    pad: u32,
}

@group(0) @binding(0) var<uniform> params: VirtualLightUniform;
@group(0) @binding(1) var<storage, read> surface: array<vec4f>;
@group(0) @binding(2) var<storage, read> origin: array<u32>;
// linear albedo, and coverage
@group(0) @binding(3) var<storage, read> layer: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> planes: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> virtual_light: array<vec4f>;

// Keeps pixels that are brighter than white from being cut off: x / (1 + x) above the shoulder (Reinhard
// et al. 2002), with a continuous slope. Channels keep their proportions.
fn soften(rgb: vec3f) -> vec3f {
    let brightest = max(max(rgb.r, rgb.g), rgb.b);
    if brightest <= SHOULDER {
        return rgb;
    }
    let room = 1.0 - SHOULDER;
    let above = (brightest - SHOULDER) / room;
    return rgb * ((SHOULDER + room * (1.0 - 1.0 / (1.0 + above))) / brightest);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.size) {
        return;
    }
    let at = id.y * params.size.x + id.x;
    let points = params.size.x * params.size.y;
    let is_virtual = origin[at] == VIRTUAL_ORIGIN;
    let texel = layer[at];
    let covered = select(select(0.0, 1.0, is_virtual), clamp(texel.a, 0.0, 1.0), ANTIALIAS);
    if !is_virtual {
        virtual_light[at] = vec4f(vec3f(-1.0), covered);
        return;
    }
    var shading = planes[merged_of(at, points)];
    if VISIBILITY {
        shading = vec4f(shading_from(shading.rgb, unoccluded(surface[at].xyz)), shading.w);
        planes[merged_of(at, points)] = shading;
    }
    // albedo (R' / mean albedo + R_i): the light is known times the mean albedo
    var light = shading.rgb / params.mean_albedo;
    if HAS_BOUNCE {
        light += planes[bounce_of(at, points)].rgb;
    }
    let radiance = clamp(texel.rgb * light, vec3f(0.0), vec3f(LARGEST));
    virtual_light[at] = vec4f(soften(radiance), covered);
}
