// Depth and normals of the volume's surfaces in a view, perspective or orthographic: a ray for every pixel
// centre, a workgroup for every tile. A surface is where distances along the ray turn from positive to
// negative (a front face) between voxels that were seen.
// Constants: TILE, pixels a side of a tile; CAST_NEAREST_M; CLOSE, voxels, and REFINEMENTS of a crossing.
#import fusion/walk

struct RaycastUniform {
    rays: Rays,
    // highest voxel coordinate
    last: f32,
    // voxels per stored step
    scale: f32,
    grid: u32,
    // of a ray, more than any takes
    most_steps: u32,
}

@group(0) @binding(0) var<uniform> params: RaycastUniform;
@group(0) @binding(1) var<storage, read> table: array<u32>;
@group(0) @binding(2) var<storage, read> crossings: array<vec2u>;
@group(0) @binding(3) var<storage, read> voxels: array<u32>;
// as the tiles were drawn
@group(0) @binding(4) var<storage, read> ranges: array<vec2u>;
@group(0) @binding(5) var<storage, read_write> surface: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> origin: array<u32>;

const NO_SURFACE = 0u;
const MODEL = 1u;

// The part of a ray that is looked at.
struct Range {
    near: f32,
    far: f32,
}

// Where distances turn from positive (a) to negative (b).
struct Bracket {
    is_found: bool,
    a: f32,
    at_a: f32,
    b: f32,
    at_b: f32,
}

// Follows the distances from the near end (as a sphere tracer does). Bricks without surface are passed
// at once: whatever crossing comes after one has its positive side after it as well.
fn march(ray: Ray, range: Range) -> Bracket {
    let per_voxel = 1.0 / sqrt(dot(ray.direction, ray.direction));
    let inverse = 1.0 / ray.direction;
    var t = range.near;
    var a = t;
    // last distance; not positive where no sample in front came last
    var at_a = -1.0;
    for (var i = 0u; i < params.most_steps && t <= range.far; i++) {
        let point = point_at(ray, t);
        let voxel = vec3u(point + 0.5);
        let side = empty_side(voxel);
        if side != 0u {
            t = max(leave(ray.origin, inverse, voxel, side, 0u), t + NUDGE * per_voxel);
            at_a = -1.0;
            continue;
        }
        let distance = trilinear(point);
        if distance.is_known && distance.value <= 0.0 && at_a > 0.0 {
            return Bracket(true, a, at_a, t, distance.value);
        }
        a = t;
        at_a = select(-1.0, distance.value, distance.is_known && distance.value > 0.0);
        t += step_at(distance) * per_voxel;
    }
    return Bracket(false, 0.0, 0.0, 0.0, 0.0);
}

// Regula falsi (Illinois). A crossing with unseen voxels inside the bracket is none: 0.
fn refine(ray: Ray, bracket: Bracket) -> f32 {
    var ends = bracket;
    var t = ends.b;
    for (var i = 0u; i < REFINEMENTS; i++) {
        t = ends.a + (ends.b - ends.a) * ends.at_a / (ends.at_a - ends.at_b);
        let distance = trilinear(point_at(ray, t));
        if !distance.is_known {
            return 0.0;
        }
        let value = distance.value;
        if abs(value) < CLOSE {
            break;
        }
        if value > 0.0 {
            ends.a = t;
            ends.at_a = value;
            ends.at_b *= 0.5;
        } else {
            ends.b = t;
            ends.at_b = value;
            ends.at_a *= 0.5;
        }
    }
    return t;
}

// Against the ray; zero where a gradient is not, or is none.
fn unit_against(gradient: vec3f, direction: vec3f) -> vec3f {
    let square = dot(gradient, gradient);
    if square <= 0.0 || dot(gradient, direction) >= 0.0 {
        return vec3f(0.0);
    }
    return gradient * (1.0 / sqrt(square));
}

// Interpolated central differences; where their surroundings were not seen, the gradient of the cell.
fn normal_at(point: vec3f, direction: vec3f) -> vec3f {
    let normal = unit_against(central_gradient(point), direction);
    let base = vec3u(point);
    if any(normal != vec3f(0.0)) || any(base >= vec3u(highest_voxel())) {
        return normal;
    }
    let cell = cell_at(point, base);
    return select(vec3f(0.0), unit_against(gradient_in(cell), direction), cell.is_known);
}

// Normal and depth; zeros where there is no surface.
fn meet(ray: Ray, range: Range) -> vec4f {
    let bracket = march(ray, range);
    if !bracket.is_found {
        return vec4f(0.0);
    }
    let depth_m = refine(ray, bracket);
    if depth_m <= 0.0 {
        return vec4f(0.0);
    }
    let normal = normal_at(point_at(ray, depth_m), ray.direction);
    return select(vec4f(0.0), vec4f(normal, depth_m), any(normal != vec3f(0.0)));
}

// The part of the tile's range that lies in the volume; near > far where there is none.
fn clip(ray: Ray, tile: vec2u) -> Range {
    if tile.y == 0u {
        return Range(1.0, 0.0);
    }
    let a = -ray.origin / ray.direction;
    let b = (vec3f(params.last) - ray.origin) / ray.direction;
    let enter = min(a, b);
    let exit = max(a, b);
    let near = max(max(max(enter.x, enter.y), enter.z), bitcast<f32>(~tile.x));
    let far = min(min(min(exit.x, exit.y), exit.z), bitcast<f32>(tile.y));
    return Range(max(near, CAST_NEAREST_M), far);
}

@compute @workgroup_size(TILE, TILE)
fn main(@builtin(global_invocation_id) id: vec3u, @builtin(workgroup_id) tile: vec3u) {
    let size = params.rays.size;
    if any(id.xy >= size) {
        return;
    }
    var ray = ray_at(params.rays, vec2f(id.xy));
    ray.direction = away_from_zero(ray.direction);
    let tiles_across = (size.x + TILE - 1u) / TILE;
    let range = clip(ray, ranges[tile.y * tiles_across + tile.x]);
    var hit = vec4f(0.0);
    if range.near <= range.far {
        hit = meet(ray, range);
    }
    let at = id.y * size.x + id.x;
    surface[at] = hit;
    origin[at] = select(NO_SURFACE, MODEL, hit.w > 0.0);
}
