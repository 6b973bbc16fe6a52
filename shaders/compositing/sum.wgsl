// Sums over the invocations of a workgroup, as a tree: the same for every run.
#import shared/color

const WORKGROUP = 256u;

struct Sum {
    // R of points with a surface, and their number
    real: vec4f,
    bounce: vec4f,
    // ln of the luminance of R, and the number of points
    logarithms: vec4f,
}

var<workgroup> parts: array<Sum, WORKGROUP>;

// Valid in the first invocation.
fn summed(local: u32, own: Sum) -> Sum {
    parts[local] = own;
    for (var half = WORKGROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if local < half {
            parts[local].real += parts[local + half].real;
            parts[local].bounce += parts[local + half].bounce;
            parts[local].logarithms += parts[local + half].logarithms;
        }
    }
    return parts[local];
}
