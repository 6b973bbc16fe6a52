// From sums to means, 1 where no point has a surface; and the exposure that brings the log-average of R
// (Reinhard et al. 2002, Eq. 1) to the key.
#import compositing/sum

struct MeansUniform {
    groups: u32,
    key: f32,
}

@group(0) @binding(0) var<uniform> params: MeansUniform;
@group(0) @binding(1) var<storage, read> sums: array<Sum>;
// R and the exposure, the bounce
@group(0) @binding(2) var<storage, read_write> means: array<vec4f, 2>;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(local_invocation_index) local: u32) {
    var sum = Sum();
    for (var i = local; i < params.groups; i += WORKGROUP) {
        sum.real += sums[i].real;
        sum.bounce += sums[i].bounce;
        sum.logarithms += sums[i].logarithms;
    }
    let total = summed(local, sum);
    if local == 0u {
        let count = total.real.w;
        let has_surface = count > 0.0;
        let real = select(vec3f(1.0), total.real.rgb / max(count, 1.0), has_surface);
        let bounce = select(vec3f(1.0), total.bounce.rgb / max(count, 1.0), has_surface);
        // 1 where there is no real point
        let log_average = exp(total.logarithms.x / max(total.logarithms.y, 1.0));
        means[0] = vec4f(real, params.key / log_average);
        means[1] = vec4f(bounce, 0.0);
    }
}
