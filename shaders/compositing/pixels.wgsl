// Display pixels: the camera's bytes, changed where virtual objects cover or influence a pixel.
// Constants: PLANES; DIFFERENCE, whether Eq. 13 is taken as printed; MAX_RATIO; BEGINS and CODES, where these
// tables start; BUCKETS, of the table of codes.
#import compositing/planes

struct PixelsUniform {
    size: vec2u,
    // least R
    floor: f32,
    mean_albedo: f32,
}

const WORKGROUP = 256u;

@group(0) @binding(0) var<uniform> params: PixelsUniform;
// three bytes a pixel, without padding
@group(0) @binding(1) var<storage, read> color_srgb: array<u32>;
@group(0) @binding(2) var<storage, read> planes: array<vec4f>;
@group(0) @binding(3) var<storage, read> virtual_light: array<vec4f>;
// linear light of the 256 codes, where each code begins, code at the start of each bucket
@group(0) @binding(4) var<storage, read> tables: array<f32>;
@group(0) @binding(5) var<storage, read> means: array<vec4f, 2>;
// as color_srgb
@group(0) @binding(6) var<storage, read_write> display: array<u32>;

var<workgroup> codes: array<u32, WORKGROUP>;

// What the scene with virtual objects does to a real pixel.
struct Change {
    gain: vec3f,
    bounce: vec3f,
    // R, which albedo is told from
    real: vec3f,
}

fn points() -> u32 {
    return params.size.x * params.size.y;
}

// The three bytes of a pixel in the picture.
fn recorded(at: u32) -> u32 {
    let word = 3u * at / 4u;
    let shift = 8u * (3u * at % 4u);
    var bytes = color_srgb[word] >> shift;
    if shift > 8u {
        bytes |= color_srgb[word + 1u] << (32u - shift);
    }
    return bytes & 0xffffffu;
}

fn decode(bytes: u32) -> vec3f {
    return vec3f(
        tables[bytes & 0xffu],
        tables[(bytes >> 8u) & 0xffu],
        tables[(bytes >> 16u) & 0xffu],
    );
}

fn encode(linear: f32) -> u32 {
    let inside = clamp(linear, 0.0, 1.0);
    let code = u32(tables[CODES + u32(inside * f32(BUCKETS))]);
    return code + u32(inside >= tables[BEGINS + code + 1u]);
}

fn is_virtual(at: u32) -> bool {
    return virtual_light[at].x >= 0.0;
}

fn bounce_at(at: u32) -> vec3f {
    if HAS_BOUNCE {
        return planes[bounce_of(at, points())].rgb;
    }
    return vec3f(0.0);
}

// Nothing virtual covers or influences the pixel.
fn is_quiet(at: u32) -> bool {
    let real = planes[real_of(at)];
    let merged = planes[merged_of(at, points())];
    let is_shaded = merged.w > 0.0 && any(real.rgb != merged.rgb);
    let is_lit = any(bounce_at(at) != vec3f(0.0));
    return !(is_shaded || is_lit || virtual_light[at].w > 0.0 || is_virtual(at));
}

// Reinhard's x / (1 + x) with the exposure of R for both terms, so that R' = R is no change.
fn tone(shading: vec3f) -> vec3f {
    let scaled = shading * means[0].w;
    return scaled / (1.0 + scaled);
}

fn change_of(at: u32) -> Change {
    // Bicubic weights may undershoot the floor that the grid keeps.
    let real = max(planes[real_of(at)].rgb, vec3f(params.floor));
    let merged = max(planes[merged_of(at, points())].rgb, vec3f(params.floor));
    var gain: vec3f;
    if DIFFERENCE {
        gain = max(1.0 + tone(merged) - tone(real), vec3f(0.0));
    } else {
        gain = min(merged / real, vec3f(MAX_RATIO));
    }
    return Change(gain, bounce_at(at), real);
}

// gain I + A R_i, with the pixel's albedo A from I = A R / mean albedo.
fn apply(change: Change, camera: vec3f) -> vec3f {
    let albedo = clamp(params.mean_albedo * camera / change.real, vec3f(0.0), vec3f(1.0));
    return camera * change.gain + albedo * change.bounce;
}

// The light of a virtual pixel, or the mean of its virtual neighbours; w is 0 where there is none.
fn virtual_light_near(at: u32, pixel: vec2i) -> vec4f {
    if is_virtual(at) {
        return vec4f(virtual_light[at].rgb, 1.0);
    }
    var sum = vec4f(0.0);
    for (var y = max(pixel.y - 1, 0); y <= min(pixel.y + 1, i32(params.size.y) - 1); y++) {
        for (var x = max(pixel.x - 1, 0); x <= min(pixel.x + 1, i32(params.size.x) - 1); x++) {
            let light = virtual_light[u32(y) * params.size.x + u32(x)];
            if light.x >= 0.0 {
                sum += vec4f(light.rgb, 1.0);
            }
        }
    }
    return sum / max(sum.w, 1.0);
}

// The camera's light as virtual objects change it. Behind a virtual edge pixel, the change is the mean
// of those of the real pixels beside it.
fn real_light(at: u32, pixel: vec2i, camera: vec3f) -> vec3f {
    if !is_virtual(at) {
        return apply(change_of(at), camera);
    }
    var sum = Change();
    var count = 0.0;
    for (var y = max(pixel.y - 1, 0); y <= min(pixel.y + 1, i32(params.size.y) - 1); y++) {
        for (var x = max(pixel.x - 1, 0); x <= min(pixel.x + 1, i32(params.size.x) - 1); x++) {
            let near = u32(y) * params.size.x + u32(x);
            if !is_virtual(near) {
                let change = change_of(near);
                sum.gain += change.gain;
                sum.bounce += change.bounce;
                sum.real += change.real;
                count += 1.0;
            }
        }
    }
    if count == 0.0 {
        return camera;
    }
    return apply(Change(sum.gain / count, sum.bounce / count, sum.real / count), camera);
}

// Three bytes.
fn pixel_of(at: u32) -> u32 {
    let bytes = recorded(at);
    if is_quiet(at) {
        return bytes;
    }
    let pixel = vec2i(vec2u(at % params.size.x, at / params.size.x));
    let camera = decode(bytes);
    var light = vec4f(0.0);
    if virtual_light[at].w > 0.0 {
        light = virtual_light_near(at, pixel);
    }
    // An edge pixel without a virtual neighbour shows nothing virtual.
    let covered = select(0.0, virtual_light[at].w, light.w > 0.0);
    var out = camera;
    if covered < 1.0 {
        out = real_light(at, pixel, camera);
    }
    out += covered * (light.rgb - out);
    return encode(out.r) | (encode(out.g) << 8u) | (encode(out.b) << 16u);
}

// 256 pixels fill 192 words.
@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(local_invocation_index) local: u32,
    @builtin(workgroup_id) group: vec3u,
) {
    var bytes = 0u;
    if id.x < points() {
        bytes = pixel_of(id.x);
    }
    codes[local] = bytes;
    workgroupBarrier();
    let word = group.x * (WORKGROUP / 4u * 3u) + local;
    if local < WORKGROUP / 4u * 3u && word < (3u * points() + 3u) / 4u {
        let first = 4u * local / 3u;
        let skipped = local % 3u;
        display[word] = (codes[first] >> (8u * skipped)) | (codes[first + 1u] << (24u - 8u * skipped));
    }
}
