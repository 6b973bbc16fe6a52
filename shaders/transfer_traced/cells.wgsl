// Which cells between four coarse points each lie on one smooth surface; cell (i, j) starts at point (i, j).
#import transfer_traced/surfaces
#import transfer_traced/smooth

@group(0) @binding(1) var<storage, read> surface: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> is_smooth: array<u32>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.coarse) {
        return;
    }
    let end = min(id.xy + 1u, params.coarse - 1u);
    let a = surface_at(grid_pixel(id.xy, params.coarse_step));
    let b = surface_at(grid_pixel(vec2u(end.x, id.y), params.coarse_step));
    let c = surface_at(grid_pixel(vec2u(id.x, end.y), params.coarse_step));
    let d = surface_at(grid_pixel(end, params.coarse_step));
    let is_joined = joins(a, b) && joins(a, c) && joins(a, d)
        && joins(b, c) && joins(b, d) && joins(c, d);
    is_smooth[id.y * params.coarse.x + id.x] = u32(is_joined);
}
