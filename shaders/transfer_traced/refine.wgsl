// Pixels between coarse points: interpolated where they lie on the smooth surface of their cell, else traced.
#import transfer_traced/surfaces
#import transfer_traced/smooth

@group(0) @binding(1) var<storage, read> surface: array<vec4f>;
// of the image's columns, then of its rows: coarse points before and after, and bits of the second's share
@group(0) @binding(2) var<storage, read> places: array<vec4u>;
@group(0) @binding(3) var<storage, read> is_smooth: array<u32>;
@group(0) @binding(4) var<storage, read_write> how: array<u32>;

// The coarse point on an axis that a pixel is nearest to.
fn nearest(place: vec4u) -> u32 {
    return select(place.x, place.y, bitcast<f32>(place.z) >= 0.5);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.image) {
        return;
    }
    let shown = surface_at(id.xy);
    let column = places[id.x];
    let row = places[params.image.x + id.y];
    var found = NO_SURFACE;
    if shown.is_valid {
        found = TRACED;
        if is_smooth[row.x * params.coarse.x + column.x] == 1u {
            let corner = surface_at(grid_pixel(vec2u(nearest(column), nearest(row)), params.coarse_step));
            found = select(TRACED, INTERPOLATED, joins(corner, shown));
        }
    }
    how[pixel_index(id.xy)] = found;
}
