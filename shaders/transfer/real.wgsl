// Transfer of the real scene: T = T_unoccluded - sum_j (1 - K_j) c_j Y_j / sum_j c_j, c_j = max(0, n.w_j).
#import transfer/sampling
#import transfer/lobe

@group(0) @binding(1) var<storage, read> directions: array<vec4f>;
@group(0) @binding(2) var<storage, read> distances_m: array<f32>;
@group(0) @binding(3) var<storage, read> limits_m: array<f32>;
@group(0) @binding(4) var<storage, read> surface: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> transfer: array<f32>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.grid) {
        return;
    }
    let first = (id.y * params.grid.x + id.x) * COEFFICIENTS;
    let pixel = grid_pixel(id.xy);
    let point = point_of(pixel, surface[pixel.y * params.views[0].size.x + pixel.x]);
    if !point.is_valid {
        write_nothing(first);
        return;
    }
    show_to_views(point);
    let sum = sum_of_cosines(point.n);
    let distances = first_distance(id.xy);
    for (var d = 0u; d < params.directions; d++) {
        let w = directions[d * ROW].xyz;
        let cosine = dot(point.n, w);
        if cosine > 0.0 {
            let share = hiddenness(look(w, distances + d * params.samples).cosine);
            if share > 0.0 {
                hide(share * cosine / sum, d);
            }
        }
    }
    write_transfer(first, point.n);
}
