// T = T_unoccluded - sum of c_j Y_j over the hidden directions / sum of all c_j, with c_j = max(0, n.w_j).
#import transfer_traced/surfaces
#import transfer/lobe

@group(0) @binding(1) var<storage, read> surface: array<vec4f>;
@group(0) @binding(2) var<storage, read> directions: array<vec4f>;
@group(0) @binding(3) var<storage, read> how: array<u32>;
@group(0) @binding(4) var<storage, read> hits: array<u32>;
@group(0) @binding(5) var<storage, read_write> transfer: array<f32>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.points) {
        return;
    }
    let at = point_index(id.xy);
    let way = how[at];
    if way == NO_SURFACE {
        write_nothing(at * COEFFICIENTS);
        return;
    }
    if way != TRACED && way != KNOWN {
        return;
    }
    let n = surface_at(grid_pixel(id.xy, params.step)).normal;
    var sum = 0.0;
    for (var d = 0u; d < params.directions; d++) {
        sum += max(dot(n, directions[d * ROW].xyz), 0.0);
    }
    // a lattice that leaves a hemisphere empty hides nothing from it
    let share = select(0.0, 1.0 / max(sum, 1e-20), sum > 0.0);
    for (var word = 0u; word * 32u < params.directions; word++) {
        var bits = hits[hits_index(id.xy, word)];
        while bits != 0u {
            let d = word * 32u + firstTrailingBit(bits);
            hide(dot(n, directions[d * ROW].xyz) * share, d);
            bits &= bits - 1u;
        }
    }
    write_transfer(at * COEFFICIENTS, n);
}
