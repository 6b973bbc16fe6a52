// From the nearest triangle at each sample to what a pixel shows. What is seen at the centre goes into
// the geometry buffer; the share of samples that show a virtual surface is the coverage.
// Constants: SAMPLES, and those of the imports.
#import shared/view
#import raster/scene
#import raster/color
#import raster/visible

struct ResolveUniform {
    view: View,
    // of the samples from the pixel's centre, pixels, two a column
    offsets: mat4x4f,
    first_pixel: vec2u,
    pixels: vec2u,
    parts: u32,
    pad0: u32,
    pad1: u32,
    pad2: u32,
}

const VIRTUAL = 3u;

@group(0) @binding(0) var<uniform> params: ResolveUniform;
@group(0) @binding(1) var numbers: texture_2d_array<u32>;
@group(0) @binding(2) var<storage, read> vertices: array<Vertex>;
@group(0) @binding(3) var<storage, read> triangles: array<u32>;
@group(0) @binding(4) var<storage, read> parts: array<Part>;
@group(0) @binding(5) var<storage, read> texels: array<u32>;
@group(0) @binding(6) var<storage, read> real: array<vec4f>;
// hold the real scene; virtual pixels are replaced
@group(0) @binding(7) var<storage, read_write> surface: array<vec4f>;
@group(0) @binding(8) var<storage, read_write> origin: array<u32>;
// base colour and coverage, zero
@group(0) @binding(9) var<storage, read_write> layer: array<vec4f>;

fn sample_offset(sample: u32) -> vec2f {
    let two = params.offsets[sample / 2u];
    return select(two.xy, two.zw, sample % 2u == 1u);
}

fn is_perspective() -> bool {
    return params.view.perspective == 1u;
}

fn sight_of_sample(face: Face, pixel: vec2u, sample: u32) -> Sight {
    return sight(face, is_perspective(), vec2f(pixel) + sample_offset(sample));
}

// Samples of the same triangle share one comparison.
fn visible_samples(pixel: vec2u, drawn: array<u32, SAMPLES>) -> u32 {
    var number = drawn;
    var open = 0u;
    for (var s = 0u; s < SAMPLES; s++) {
        open |= u32(number[s] != 0u) << s;
    }
    if open == 0u {
        return 0u;
    }
    let around = neighbourhood(pixel);
    var visible = 0u;
    while open != 0u {
        let first = countTrailingZeros(open);
        let face = face_of(number[first], params.parts);
        let at = sight_of_sample(face, pixel, first);
        let gaps = gaps_around(face, at, sample_offset(first), around);
        for (var s = first; s < SAMPLES; s++) {
            if number[s] == number[first] {
                visible |= u32(interpolated(gaps, sample_offset(s)) > 0.0) << s;
                open &= ~(1u << s);
            }
        }
    }
    return visible;
}

fn normalized_or(v: vec3f, otherwise: vec3f) -> vec3f {
    let length2 = dot(v, v);
    let is_long = length2 > SMALLEST_NORMAL;
    return select(otherwise, v / sqrt(select(1.0, length2, is_long)), is_long);
}

// Of any length; scaled first, so that squares of short edges are no zeros.
fn normal_of_face(indices: vec3u) -> vec3f {
    let a = vertices[indices.x].position;
    let ab = vertices[indices.y].position - a;
    let ac = vertices[indices.z].position - a;
    let largest = max(abs(ab), abs(ac));
    let unit = 1.0 / max(max(largest.x, max(largest.y, largest.z)), SMALLEST_NORMAL);
    return normalized_or(cross(ab * unit, ac * unit), vec3f(0.0));
}

// Interpolated world normal, on the side that is seen.
fn normal_of(face: Face, s: Sight, pixel: vec2u) -> vec3f {
    let to_eye_in_view =
        select(vec3f(0.0, 0.0, -1.0), -unproject(params.view, vec2f(pixel), 1.0), is_perspective());
    let to_eye = (params.view.world_from_view * vec4f(to_eye_in_view, 0.0)).xyz;
    let eye = normalize(to_eye);
    if !s.is_valid {
        return eye;
    }
    let is_mirrored = params.view.scale.x * params.view.scale.y < 0.0;
    let is_front = (dot(s.edges, s.w) < 0.0) != is_mirrored;
    let weights = inside(s);
    let smoothed = vertices[face.indices.x].normal * weights.x
        + vertices[face.indices.y].normal * weights.y
        + vertices[face.indices.z].normal * weights.z;
    let has_normal = dot(smoothed, smoothed) > SMALLEST_NORMAL;
    let in_object = select(normal_of_face(face.indices), smoothed, has_normal);
    let turned = (parts[face.part].world_from_object * vec4f(in_object, 0.0)).xyz;
    let normal = normalized_or(turned * select(-1.0, 1.0, is_front), eye);
    if dot(normal, to_eye) >= 0.0 {
        return normal;
    }
    // a smooth normal may turn away before the silhouette is reached: it stops at the horizon
    return normalized_or(normal - eye * dot(normal, eye), eye);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.pixels) {
        return;
    }
    let pixel = params.first_pixel + id.xy;
    var drawn: array<u32, SAMPLES>;
    for (var s = 0u; s < SAMPLES; s++) {
        drawn[s] = textureLoad(numbers, pixel, s, 0).r;
    }
    let visible = visible_samples(pixel, drawn);
    if visible == 0u {
        return;
    }
    // the centre if it is seen, else any sample that is: never a place off the surface
    let sample = countTrailingZeros(visible);
    let face = face_of(drawn[sample], params.parts);
    let at = sight_of_sample(face, pixel, sample);
    let color = color_of(face, at).rgb;
    let albedo = select(vec3f(0.0), min(color, vec3f(1.0)), color > vec3f(0.0));
    let index = pixel.y * params.view.size.x + pixel.x;
    layer[index] = vec4f(albedo, f32(countOneBits(visible)) / f32(SAMPLES));
    if sample == 0u {
        surface[index] = vec4f(normal_of(face, at, pixel), depth_of(face, at));
        origin[index] = VIRTUAL;
    }
}
