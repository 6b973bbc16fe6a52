// Joint bilateral up-sampling (Kopf et al. 2007): each pixel takes shading from the four grid points around it,
// as far as they lie on its own surface. Pixels that no changed point reaches, and pixels that find no point
// of their own kind, get R = R' = 1 and no bounce: unchanged.
// Constants: PLANES; MIN_WEIGHT, summed weight below which the four points lie on other surfaces.
#import compositing/planes
#import compositing/likeness
#import compositing/between

@group(0) @binding(0) var<uniform> params: EdgeAwareUniform;
@group(0) @binding(1) var<storage, read> columns: array<Between>;
@group(0) @binding(2) var<storage, read> rows: array<Between>;
@group(0) @binding(3) var<storage, read> surface: array<vec4f>;
@group(0) @binding(4) var<storage, read> origin: array<u32>;
@group(0) @binding(5) var<storage, read> planes: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> full: array<vec4f>;

fn point_index(point: vec2u) -> u32 {
    return point.y * params.grid.x + point.x;
}

fn points() -> u32 {
    return params.grid.x * params.grid.y;
}

fn surface_at(pixel: vec2u) -> vec4f {
    return surface[pixel.y * params.image.x + pixel.x];
}

fn likeness_of(plane: TangentPlane, kind: f32, point: vec2u) -> f32 {
    if planes[real_of(point_index(point))].w != kind {
        return 0.0;
    }
    let pixel = grid_pixel(point, params.step, params.image);
    return likeness(plane, pixel, surface_at(pixel));
}

// Of the 4 x 4 points around, the one of the pixel's kind that is nearest in space: pixels of distance
// count at their size there. Every point of one kind, so never across an edge between real and virtual.
// `points()` where there is none.
fn nearest(plane: TangentPlane, kind: f32, first: vec2u) -> u32 {
    let pixel_m = plane.depth_m * length(params.step_x.xyz);
    let start = max(first, vec2u(1u)) - 1u;
    let end = min(first + 3u, params.grid);
    var best = points();
    var least = 0.0;
    for (var y = start.y; y < end.y; y++) {
        for (var x = start.x; x < end.x; x++) {
            let point = vec2u(x, y);
            let at = point_index(point);
            if planes[real_of(at)].w != kind {
                continue;
            }
            let pixel = grid_pixel(point, params.step, params.image);
            let off = distance_m(plane, pixel, surface_at(pixel).w);
            let d = vec2f(pixel) - plane.pixel;
            let squared = off * off + (d.x * d.x + d.y * d.y) * pixel_m * pixel_m;
            if best == points() || squared < least {
                best = at;
                least = squared;
            }
        }
    }
    return best;
}

fn write(at: u32, plane: u32, value: vec4f) {
    full[plane * params.image.x * params.image.y + at] = value;
}

fn write_unchanged(at: u32, kind: f32) {
    write(at, 0u, vec4f(vec3f(1.0), kind));
    write(at, 1u, vec4f(vec3f(1.0), 0.0));
    if HAS_BOUNCE {
        write(at, 2u, vec4f(0.0));
    }
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.image) {
        return;
    }
    let at = id.y * params.image.x + id.x;
    let column = columns[id.x];
    let row = rows[id.y];
    let corners = array<vec2u, 4>(
        vec2u(column.first, row.first),
        vec2u(column.second, row.first),
        vec2u(column.first, row.second),
        vec2u(column.second, row.second),
    );
    let spatial = vec4f(
        (1.0 - column.share) * (1.0 - row.share),
        column.share * (1.0 - row.share),
        (1.0 - column.share) * row.share,
        column.share * row.share,
    );
    var corner: array<u32, 4>;
    var changed = 0.0;
    for (var t = 0u; t < 4u; t++) {
        corner[t] = point_index(corners[t]);
        changed = max(changed, planes[merged_of(corner[t], points())].w);
    }
    let own = surface_at(id.xy);
    let kind = kind_of(origin[at], own.w);
    if kind == NOTHING || (changed == 0.0 && params.everywhere == 0u) {
        write_unchanged(at, kind);
        return;
    }
    let plane = tangent_plane(id.xy, own);
    var weights: array<f32, 4>;
    for (var t = 0u; t < 4u; t++) {
        weights[t] = spatial[t] * likeness_of(plane, kind, corners[t]);
    }
    var total = (weights[0] + weights[1]) + (weights[2] + weights[3]);
    if total <= MIN_WEIGHT {
        let found = nearest(plane, kind, corners[0]);
        if found == points() {
            write_unchanged(at, kind);
            return;
        }
        corner[0] = found;
        weights = array<f32, 4>(1.0, 0.0, 0.0, 0.0);
        total = 1.0;
        changed = planes[merged_of(found, points())].w;
    }
    for (var p = 0u; p < PLANES; p++) {
        let first = p * points();
        let above = weights[0] * planes[first + corner[0]].rgb
            + weights[1] * planes[first + corner[1]].rgb;
        let below = weights[2] * planes[first + corner[2]].rgb
            + weights[3] * planes[first + corner[3]].rgb;
        write(at, p, vec4f((above + below) / total, select(changed, kind, p == 0u)));
    }
}
