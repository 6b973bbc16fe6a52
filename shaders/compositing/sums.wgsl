// Sums over 256 grid points each, for the means of R and of the bounce and the log-average of R.
// Constant: PLANES.
#import compositing/planes
#import compositing/sum

struct SumsUniform {
    grid: vec2u,
    // columns and rows from one point of the log-average to the next
    every: u32,
    pad: u32,
}

@group(0) @binding(0) var<uniform> params: SumsUniform;
@group(0) @binding(1) var<storage, read> planes: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> sums: array<Sum>;

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(local_invocation_index) local: u32,
    @builtin(workgroup_id) group: vec3u,
) {
    let points = params.grid.x * params.grid.y;
    var sum = Sum();
    if id.x < points {
        let real = planes[real_of(id.x)];
        if real.w != NOTHING {
            sum.real = vec4f(real.rgb, 1.0);
            if HAS_BOUNCE {
                sum.bounce = vec4f(planes[bounce_of(id.x, points)].rgb, 0.0);
            }
        }
        let place = vec2u(id.x % params.grid.x, id.x / params.grid.x) % params.every;
        if real.w == REAL && all(place == vec2u(0u)) {
            sum.logarithms = vec4f(log(luminance(real.rgb)), 1.0, 0.0, 0.0);
        }
    }
    let total = summed(local, sum);
    if local == 0u {
        sums[group.x] = total;
    }
}
