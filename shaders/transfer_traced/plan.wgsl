// Every point of the grid that shows a surface is traced.
#import transfer_traced/surfaces

@group(0) @binding(1) var<storage, read> surface: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> how: array<u32>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.points) {
        return;
    }
    let shown = surface_at(grid_pixel(id.xy, params.step));
    how[point_index(id.xy)] = select(NO_SURFACE, TRACED, shown.is_valid);
}
