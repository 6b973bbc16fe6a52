// Bilinear interpolation of the coarse map, where the pixels' plan says so.
#import transfer_traced/points

@group(0) @binding(1) var<storage, read> places: array<vec4u>;
@group(0) @binding(2) var<storage, read> how: array<u32>;
@group(0) @binding(3) var<storage, read> coarse: array<f32>;
@group(0) @binding(4) var<storage, read_write> transfer: array<f32>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let at = id.y * params.image.x + id.x;
    if any(id.xy >= params.image) || how[at] != INTERPOLATED {
        return;
    }
    let column = places[id.x];
    let row = places[params.image.x + id.y];
    let u = bitcast<f32>(column.z);
    let v = bitcast<f32>(row.z);
    let corners = COEFFICIENTS * vec4u(
        row.x * params.coarse.x + column.x,
        row.x * params.coarse.x + column.y,
        row.y * params.coarse.x + column.x,
        row.y * params.coarse.x + column.y,
    );
    for (var k = 0u; k < COEFFICIENTS; k++) {
        let a = coarse[corners.x + k];
        let above = a + (coarse[corners.y + k] - a) * u;
        let c = coarse[corners.z + k];
        let below = c + (coarse[corners.w + k] - c) * u;
        transfer[at * COEFFICIENTS + k] = above + (below - above) * v;
    }
}
