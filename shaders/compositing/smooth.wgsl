// Edge-aware smoothing over 3 x 3 grid points, with the weights 1 2 1 in x and y.
// Constants: PLANES; REACH, grid points as far from a changed one count as changed afterwards.
#import compositing/planes
#import compositing/likeness

@group(0) @binding(0) var<uniform> params: EdgeAwareUniform;
@group(0) @binding(1) var<storage, read> surface: array<vec4f>;
@group(0) @binding(2) var<storage, read> planes: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> filtered: array<vec4f>;

fn inside(point: vec2i) -> vec2u {
    return vec2u(clamp(point, vec2i(0), vec2i(params.grid) - 1));
}

fn point_index(point: vec2u) -> u32 {
    return point.y * params.grid.x + point.x;
}

fn surface_at(pixel: vec2u) -> vec4f {
    return surface[pixel.y * params.image.x + pixel.x];
}

fn is_changed_near(point: vec2i, points: u32) -> bool {
    var changed = 0.0;
    let reach = i32(REACH);
    for (var dy = -reach; dy <= reach; dy++) {
        for (var dx = -reach; dx <= reach; dx++) {
            let near = point_index(inside(point + vec2i(dx, dy)));
            changed = max(changed, planes[merged_of(near, points)].w);
        }
    }
    return changed > 0.0;
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.grid) {
        return;
    }
    let points = params.grid.x * params.grid.y;
    let own = point_index(id.xy);
    let kind = planes[real_of(own)].w;
    let is_changed = is_changed_near(vec2i(id.xy), points);
    var sums: array<vec3f, PLANES>;
    var total = 1.0;
    if kind != NOTHING && (is_changed || params.everywhere == 1u) {
        total = 0.0;
        let pixel = grid_pixel(id.xy, params.step, params.image);
        let plane = tangent_plane(pixel, surface_at(pixel));
        for (var dy = -1; dy <= 1; dy++) {
            for (var dx = -1; dx <= 1; dx++) {
                let point = inside(vec2i(id.xy) + vec2i(dx, dy));
                let near = point_index(point);
                var weight = f32((2 - abs(dx)) * (2 - abs(dy))) / 16.0;
                // The point itself counts even where its normal is missing.
                if dx != 0 || dy != 0 {
                    let there = grid_pixel(point, params.step, params.image);
                    weight *= likeness(plane, there, surface_at(there));
                    weight = select(0.0, weight, planes[real_of(near)].w == kind);
                }
                total += weight;
                for (var p = 0u; p < PLANES; p++) {
                    sums[p] += weight * planes[p * points + near].rgb;
                }
            }
        }
    } else {
        for (var p = 0u; p < PLANES; p++) {
            sums[p] = planes[p * points + own].rgb;
        }
    }
    filtered[real_of(own)] = vec4f(sums[0] / total, kind);
    filtered[merged_of(own, points)] = vec4f(sums[1] / total, select(0.0, 1.0, is_changed));
    if HAS_BOUNCE {
        filtered[bounce_of(own, points)] = vec4f(sums[PLANES - 1u] / total, 0.0);
    }
}
