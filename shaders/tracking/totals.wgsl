// Adds up partial sums in a fixed order: one workgroup, each invocation every SLICES-th partial of one term.
// Constants: TERMS, numbers of a sum.

struct TotalsUniform {
    partials: u32,
    pad: u32,
}

const SLICES = 256u / TERMS;

@group(0) @binding(0) var<uniform> params: TotalsUniform;
@group(0) @binding(1) var<storage, read> partials: array<f32>;
@group(0) @binding(2) var<storage, read_write> totals: array<f32>;

var<workgroup> slices: array<f32, SLICES * TERMS>;

@compute @workgroup_size(SLICES * TERMS)
fn main(@builtin(local_invocation_index) lane: u32) {
    var sum = 0.0;
    for (var i = lane; i < params.partials * TERMS; i += SLICES * TERMS) {
        sum += partials[i];
    }
    slices[lane] = sum;
    workgroupBarrier();
    if lane < TERMS {
        var total = 0.0;
        for (var slice = 0u; slice < SLICES; slice++) {
            total += slices[slice * TERMS + lane];
        }
        totals[lane] = total;
    }
}
