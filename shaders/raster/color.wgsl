// Base colour of a face. Constant: MAX_TAPS along the longer axis of a pixel's footprint.
// The importing shader declares `texels`: the linear light of the 256 sRGB codes as bits, then the
// levels of all textures, one after the other, four bytes a texel.

const CODES = 256u;
const REPEAT = 0u;
const MIRRORED_REPEAT = 1u;
// beyond these, squares or casts would overflow
const LARGEST_STEP = 1e18;
const LARGEST_PLACE = 1e9;

struct Level {
    first_texel: u32,
    size: vec2u,
}

fn level_of(part: u32, number: u32) -> Level {
    var level = Level(parts[part].first_texel, parts[part].texture_size);
    for (var i = 0u; i < number; i++) {
        level.first_texel += level.size.x * level.size.y;
        level.size = (level.size + 1u) / 2u;
    }
    return level;
}

// `i` is at most one texel outside of the period.
fn fold(i: i32, period: i32) -> i32 {
    return i + select(0, period, i < 0) - select(0, period, i >= period);
}

fn wrapped(i: i32, n: i32, wrap: u32) -> u32 {
    switch wrap {
        case REPEAT: { return u32(fold(i, n)); }
        case MIRRORED_REPEAT: {
            let at = fold(i, 2 * n);
            return u32(min(at, 2 * n - 1 - at));
        }
        default: { return u32(clamp(i, 0, n - 1)); }
    }
}

struct Taps {
    first: u32,
    second: u32,
    // weight of the second
    t: f32,
}

// The two texels around a coordinate. Texel centres are at (i + 1/2) / n.
fn taps_at(coordinate: f32, n: u32, wrap: u32) -> Taps {
    var periodic = clamp(coordinate, 0.0, 1.0);
    switch wrap {
        case REPEAT: { periodic = coordinate - floor(coordinate); }
        case MIRRORED_REPEAT: { periodic = coordinate - 2.0 * floor(0.5 * coordinate); }
        default: {}
    }
    let x = clamp(periodic * f32(n) - 0.5, -1.0, LARGEST_PLACE);
    let below = floor(x);
    let first = i32(below);
    return Taps(wrapped(first, i32(n), wrap), wrapped(first + 1, i32(n), wrap), x - below);
}

fn texel(index: u32) -> vec4f {
    let codes = (vec4u(texels[index]) >> vec4u(0u, 8u, 16u, 24u)) & vec4u(255u);
    return vec4f(
        bitcast<f32>(texels[codes.r]),
        bitcast<f32>(texels[codes.g]),
        bitcast<f32>(texels[codes.b]),
        f32(codes.a) * (1.0 / 255.0),
    );
}

fn bilinear(part: u32, level: Level, uv: vec2f) -> vec4f {
    let x = taps_at(uv.x, level.size.x, parts[part].wrap_u);
    let y = taps_at(uv.y, level.size.y, parts[part].wrap_v);
    let row0 = level.first_texel + y.first * level.size.x;
    let row1 = level.first_texel + y.second * level.size.x;
    return (1.0 - x.t) * (1.0 - y.t) * texel(row0 + x.first)
        + x.t * (1.0 - y.t) * texel(row0 + x.second)
        + (1.0 - x.t) * y.t * texel(row1 + x.first)
        + x.t * y.t * texel(row1 + x.second);
}

// What a pixel shows of a texture: the ellipse that a disc as wide as the pixel comes from, covered by
// a row of round taps along its long axis (Heckbert 1989; McCormack et al. 1999).
struct Footprint {
    // of the ellipse's full length, texels
    long_axis: vec2f,
    taps: u32,
    tap_width: f32,
}

// From the steps in texels to the next pixel in x and y.
fn footprint_of(du: vec2f, dv: vec2f) -> Footprint {
    let xx = du.x * du.x + dv.x * dv.x;
    let yy = du.y * du.y + dv.y * dv.y;
    let xy = du.x * du.y + dv.x * dv.y;
    let middle = 0.5 * (xx + yy);
    let half = 0.5 * (xx - yy);
    let spread = length(vec2f(half, xy));
    let long = sqrt(middle + spread);
    let area = abs(du.x * dv.y - du.y * dv.x);
    let width = select(0.0, area / max(long, SMALLEST_NORMAL), long > 0.0);
    // of two parallel forms the one whose sum does not cancel
    let direction = select(vec2f(xy, spread - half), vec2f(half + spread, xy), half >= 0.0);
    let reach = length(direction);
    let axis = select(vec2f(0.0), direction / max(reach, SMALLEST_NORMAL), reach > SMALLEST_NORMAL);
    let tap_width = max(max(width, long / f32(MAX_TAPS)), 1.0);
    let taps = clamp(ceil(long / tap_width - 0.25), 1.0, f32(MAX_TAPS));
    return Footprint(axis * long, u32(taps), tap_width);
}

fn mean_of_taps(part: u32, level: Level, first: vec2f, step: vec2f, count: u32) -> vec4f {
    var sum = vec4f(0.0);
    for (var tap = 0u; tap < count; tap++) {
        sum += bilinear(part, level, first + step * f32(tap));
    }
    return sum / f32(count);
}

// Linear RGB and alpha, the mean over what a pixel shows; `du` and `dv` lead to the next pixel.
fn sample_texture(part: u32, uv: vec2f, du: vec2f, dv: vec2f) -> vec4f {
    let texels_of = vec2f(parts[part].texture_size);
    let coarsest = parts[part].levels - 1u;
    let steps = abs(vec4f(du * texels_of, dv * texels_of));
    if !(max(max(steps.x, steps.y), max(steps.z, steps.w)) < LARGEST_STEP) {
        return bilinear(part, level_of(part, coarsest), uv);
    }
    let footprint = footprint_of(du * texels_of, dv * texels_of);
    let step = footprint.long_axis / (texels_of * f32(footprint.taps));
    let first = uv - step * (0.5 * (f32(footprint.taps) - 1.0));
    let lod = clamp(log2(footprint.tap_width), 0.0, f32(coarsest));
    let fine = u32(lod);
    let t = lod - f32(fine);
    let a = mean_of_taps(part, level_of(part, fine), first, step, footprint.taps);
    // less than one step of an 8-bit texel
    if t < 1.0 / 256.0 {
        return a;
    }
    let b = mean_of_taps(part, level_of(part, fine + 1u), first, step, footprint.taps);
    return a + (b - a) * t;
}

fn uv_of(face: Face, weights: vec3f) -> vec2f {
    let a = vec2f(vertices[face.indices.x].u, vertices[face.indices.x].v);
    let b = vec2f(vertices[face.indices.y].u, vertices[face.indices.y].v);
    let c = vec2f(vertices[face.indices.z].u, vertices[face.indices.z].v);
    return a * weights.x + b * weights.y + c * weights.z;
}

// Linear RGBA: base colour times vertex colour times texture.
fn color_of(face: Face, s: Sight) -> vec4f {
    let weights = select(vec3f(1.0 / 3.0), inside(s), s.is_valid);
    var color = parts[face.part].base_color;
    color *= vertices[face.indices.x].color * weights.x
        + vertices[face.indices.y].color * weights.y
        + vertices[face.indices.z].color * weights.z;
    if parts[face.part].levels > 0u {
        var du = vec2f(0.0);
        var dv = vec2f(0.0);
        if s.is_valid {
            let steps = weight_steps(s);
            du = uv_of(face, steps.u);
            dv = uv_of(face, steps.v);
        }
        color *= sample_texture(face.part, uv_of(face, weights), du, dv);
    }
    return color;
}
