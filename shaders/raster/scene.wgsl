// Triangles of virtual objects, and how a triangle is seen from a place of the picture.
// The importing shader declares `vertices`, `triangles` (three indices each) and `parts`.

struct Vertex {
    position: vec3f,
    u: f32,
    // unit vector, or zero where the face's own is to be used
    normal: vec3f,
    v: f32,
    color: vec4f,
}

// One part of one object in one view: what its triangles have in common.
struct Part {
    // to homogeneous pixel coordinates (u w, v w) and z in metres; w is z in a perspective view, else 1
    screen_from_object: mat4x4f,
    // rotation alone
    world_from_object: mat4x4f,
    base_color: vec4f,
    // the number that its first triangle is drawn with; 0 is no triangle's
    first_number: u32,
    first_triangle: u32,
    // of the finest level; levels: 0 where there is no texture
    texture_size: vec2u,
    first_texel: u32,
    levels: u32,
    wrap_u: u32,
    wrap_v: u32,
    // where alpha is smaller there is no surface
    alpha_cutoff: f32,
    is_masked: u32,
    pad0: u32,
    pad1: u32,
}

struct Face {
    part: u32,
    indices: vec3u,
    // homogeneous pixel coordinates of the three corners
    u: vec3f,
    v: vec3f,
    z: vec3f,
}

fn on_screen(part: u32, vertex: u32) -> vec3f {
    let p = vertices[vertex].position;
    let x = parts[part].screen_from_object[0].xyz * p.x;
    let y = parts[part].screen_from_object[1].xyz * p.y;
    let z = parts[part].screen_from_object[2].xyz * p.z;
    return x + y + z + parts[part].screen_from_object[3].xyz;
}

fn face_of_part(number: u32, part: u32) -> Face {
    let first = 3u * (parts[part].first_triangle + (number - parts[part].first_number));
    let indices = vec3u(triangles[first], triangles[first + 1u], triangles[first + 2u]);
    let a = on_screen(part, indices.x);
    let b = on_screen(part, indices.y);
    let c = on_screen(part, indices.z);
    return Face(part, indices, vec3f(a.x, b.x, c.x), vec3f(a.y, b.y, c.y), vec3f(a.z, b.z, c.z));
}

// The part that a triangle belongs to: the last of `count` that begins at or before its number.
fn face_of(number: u32, count: u32) -> Face {
    var low = 0u;
    var high = count;
    while high - low > 1u {
        let middle = (low + high) / 2u;
        if parts[middle].first_number <= number {
            low = middle;
        } else {
            high = middle;
        }
    }
    return face_of_part(number, low);
}

// A face at one place of the picture, by homogeneous edge functions (Olano and Greer 1997).
struct Sight {
    // corners relative to the place, times their w
    u: vec3f,
    v: vec3f,
    w: vec3f,
    edges: vec3f,
    // of the edges' sum
    inverse: f32,
    // barycentric coordinates; may be outside the face
    weights: vec3f,
    // not where the face is seen edge-on
    is_valid: bool,
}

const SMALLEST_NORMAL = 1.17549435e-38;
const LARGEST_WEIGHT = 1e30;

fn sight(face: Face, is_perspective: bool, pixel: vec2f) -> Sight {
    let w = select(vec3f(1.0), face.z, is_perspective);
    let u = face.u - pixel.x * w;
    let v = face.v - pixel.y * w;
    let edges = u.yzx * v.zxy - v.yzx * u.zxy;
    let sum = edges.x + edges.y + edges.z;
    let is_area = abs(sum) > SMALLEST_NORMAL;
    let inverse = 1.0 / select(1.0, sum, is_area);
    let weights = edges * inverse;
    let is_valid = is_area && all(abs(weights) < vec3f(LARGEST_WEIGHT));
    return Sight(u, v, w, edges, inverse, weights, is_valid);
}

struct WeightSteps {
    u: vec3f,
    v: vec3f,
}

// Change of the barycentric coordinates to the next pixel in x and in y.
fn weight_steps(s: Sight) -> WeightSteps {
    let u = s.w.zxy * s.v.yzx - s.w.yzx * s.v.zxy;
    let v = s.w.yzx * s.u.zxy - s.w.zxy * s.u.yzx;
    return WeightSteps(
        (u - s.weights * (u.x + u.y + u.z)) * s.inverse,
        (v - s.weights * (v.x + v.y + v.z)) * s.inverse,
    );
}

// Barycentric coordinates of the nearest place within the face.
fn inside(s: Sight) -> vec3f {
    let weights = max(s.weights, vec3f(0.0));
    return weights / (weights.x + weights.y + weights.z);
}

// Metres; always before the viewer.
fn depth_of(face: Face, s: Sight) -> f32 {
    let weights = select(vec3f(1.0 / 3.0), inside(s), s.is_valid);
    return max(dot(weights, face.z), NEAR_M);
}
