// Depth in range passes, everything else becomes missing. Bits are compared and not numbers, since
// shaders may take NaN and infinity for anything: positive numbers are ordered as their bits are, and
// NaN, infinity and negatives all have greater ones.

struct DepthUniform {
    pixels: u32,
    min_bits: u32,
    max_bits: u32,
    pad: u32,
}

@group(0) @binding(0) var<uniform> params: DepthUniform;
@group(0) @binding(1) var<storage, read_write> depth_bits: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= params.pixels {
        return;
    }
    let bits = depth_bits[id.x];
    if bits < params.min_bits || bits > params.max_bits {
        depth_bits[id.x] = 0u;
    }
}
