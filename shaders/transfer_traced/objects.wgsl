// Adds what virtual objects hide from points, where nothing else does. Triangles stop rays from both sides.
#import transfer_traced/surfaces
#import transfer_traced/triangles

@group(0) @binding(1) var<storage, read> surface: array<vec4f>;
@group(0) @binding(2) var<storage, read> directions: array<vec4f>;
@group(0) @binding(3) var<storage, read> instances: array<Instance>;
@group(0) @binding(4) var<storage, read> nodes: array<Node>;
@group(0) @binding(5) var<storage, read> triangles: array<Triangle>;
// numbers of points plus one, zero where there is none
@group(0) @binding(6) var<storage, read> list: array<u32>;
@group(0) @binding(7) var<storage, read_write> hits: array<u32>;

// A smaller slope is taken for this one: no 0 * (1 / 0) in boxes.
const LEAST_SLOPE = 1.0e-30;

// In the axes of a model; distances along it are metres of the world.
struct ObjectRay {
    origin: vec3f,
    direction: vec3f,
    inverse: vec3f,
}

fn passes_sphere(sphere: vec4f, origin: vec3f, w: vec3f) -> bool {
    let to_centre = sphere.xyz - origin;
    let nearest = clamp(dot(to_centre, w), 0.0, params.reach_m);
    let apart = to_centre - w * nearest;
    return dot(apart, apart) <= sphere.w * sphere.w;
}

fn passes_box(ray: ObjectRay, low: vec3f, high: vec3f) -> bool {
    let a = (low - ray.origin) * ray.inverse;
    let b = (high - ray.origin) * ray.inverse;
    let enter = min(a, b);
    let exit = max(a, b);
    let near = max(max(max(enter.x, enter.y), enter.z), 0.0);
    let far = min(min(min(exit.x, exit.y), exit.z), params.reach_m);
    return near <= far;
}

// Moller and Trumbore 1997.
fn passes_triangle(ray: ObjectRay, triangle: Triangle) -> bool {
    let ab = triangle.b.xyz - triangle.a.xyz;
    let ac = triangle.c.xyz - triangle.a.xyz;
    let p = cross(ray.direction, ac);
    let determinant = dot(ab, p);
    // a ray inside the triangle's plane
    if determinant == 0.0 {
        return false;
    }
    let inverse = 1.0 / determinant;
    let s = ray.origin - triangle.a.xyz;
    let u = dot(s, p) * inverse;
    let q = cross(s, ab);
    let v = dot(ray.direction, q) * inverse;
    let t = dot(ac, q) * inverse;
    return u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0 && t < params.reach_m;
}

fn meets_model(ray: ObjectRay, first: u32, end: u32) -> bool {
    var at = first;
    while at < end {
        let node = nodes[at];
        if !passes_box(ray, node.low, node.high) {
            at = node.next;
            continue;
        }
        for (var k = node.first; k < node.end; k++) {
            if passes_triangle(ray, triangles[k]) {
                return true;
            }
        }
        at++;
    }
    return false;
}

fn meets(origin: vec3f, w: vec3f) -> bool {
    for (var i = 0u; i < params.instances; i++) {
        if !passes_sphere(instances[i].sphere, origin, w) {
            continue;
        }
        let from_world = instances[i].object_from_world;
        let direction = (from_world * vec4f(w, 0.0)).xyz;
        let slope = select(direction, vec3f(LEAST_SLOPE), abs(direction) < vec3f(LEAST_SLOPE));
        let ray = ObjectRay((from_world * vec4f(origin, 1.0)).xyz, direction, 1.0 / slope);
        if meets_model(ray, instances[i].first, instances[i].end) {
            return true;
        }
    }
    return false;
}

@compute @workgroup_size(LISTED_TOGETHER)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let number = list[id.x];
    if number == 0u {
        return;
    }
    let point = vec2u((number - 1u) % params.points.x, (number - 1u) / params.points.x);
    let shown = surface_at(grid_pixel(point, params.step));
    let origin = shown.position + params.object_lift_m * shown.normal;
    let first = id.y * 32u;
    let at = hits_index(point, id.y);
    var found = hits[at];
    for (var d = first; d < min(first + 32u, params.directions); d++) {
        let bit = 1u << (d - first);
        let w = directions[d * ROW].xyz;
        if (found & bit) == 0u && dot(shown.normal, w) > 0.0 && meets(origin, w) {
            found |= bit;
        }
    }
    hits[at] = found;
}
