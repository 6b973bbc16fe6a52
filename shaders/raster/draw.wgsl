// Which triangle is nearest at one sample of every pixel: writes the triangles' numbers. The picture is
// shifted so that the sample lies where the rasteriser looks, in the middle of the pixel.
// Constants: NEAR_M; MASKED, whether any part has holes.
#import raster/scene
#import raster/color

struct DrawUniform {
    // 2 / pixels of the picture
    clip_from_pixels: vec2f,
    // from the pixel's centre, pixels
    sample_offset: vec2f,
    // of orthographic views: nothing lies beyond
    far_m: f32,
    perspective: u32,
    pad0: u32,
    pad1: u32,
}

@group(0) @binding(0) var<uniform> params: DrawUniform;
@group(0) @binding(1) var<storage, read> vertices: array<Vertex>;
@group(0) @binding(2) var<storage, read> triangles: array<u32>;
@group(0) @binding(3) var<storage, read> parts: array<Part>;
@group(0) @binding(4) var<storage, read> texels: array<u32>;

struct Drawn {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat) number: u32,
    @location(1) @interpolate(flat) part: u32,
}

// Depth is nearness, 1 at the near plane: NEAR_M / z in a perspective view, which is linear on the
// screen and as fine as floating point far away, where it is near zero.
@vertex
fn vertex_main(@builtin(vertex_index) index: u32, @builtin(instance_index) part: u32) -> Drawn {
    let p = on_screen(part, triangles[index]);
    let is_perspective = params.perspective == 1u;
    let w = select(1.0, p.z, is_perspective);
    // pixel centres are whole numbers
    let from_corner = p.xy + (0.5 - params.sample_offset) * w;
    let clip = from_corner * params.clip_from_pixels - w;
    let linear = (params.far_m - p.z) / (params.far_m - NEAR_M);
    let number = parts[part].first_number + (index / 3u - parts[part].first_triangle);
    let position = vec4f(clip.x, -clip.y, select(linear, NEAR_M, is_perspective), w);
    return Drawn(position, number, part);
}

@fragment
fn fragment_main(drawn: Drawn) -> @location(0) u32 {
    if MASKED {
        if parts[drawn.part].is_masked == 1u {
            // a hole is asked for at the pixel's centre, for all its samples
            let face = face_of_part(drawn.number, drawn.part);
            let at = sight(face, params.perspective == 1u, floor(drawn.position.xy));
            if color_of(face, at).a < parts[drawn.part].alpha_cutoff {
                discard;
            }
        }
    }
    return drawn.number;
}
