// Colour enters the listed blocks, beside the surface only. Encoded values are averaged: what is averaged
// are observations of one colour, and steps of equal visibility lose least in 8 bits.
// Constant: COLOR_WEIGHT, pictures in the average.
#import fusion/blocks
#import fusion/look_up

@group(0) @binding(0) var<uniform> params: FuseUniform;
@group(0) @binding(1) var<storage, read> depth_bits: array<u32>;
// three bytes a pixel
@group(0) @binding(2) var<storage, read> color_srgb: array<u32>;
@group(0) @binding(3) var<storage, read> table: array<u32>;
@group(0) @binding(4) var<storage, read> work: array<u32>;
// a byte each of red, green, blue and the average's weight
@group(0) @binding(5) var<storage, read_write> colors: array<u32>;

fn bytes(word: u32) -> vec4u {
    return (vec4u(word) >> vec4u(0u, 8u, 16u, 24u)) & vec4u(255u);
}

fn recorded(pixel: u32) -> vec3u {
    let first = 3u * pixel;
    let byte = vec3u(first, first + 1u, first + 2u);
    let words = vec3u(color_srgb[byte.x / 4u], color_srgb[byte.y / 4u], color_srgb[byte.z / 4u]);
    return (words >> (8u * (byte % 4u))) & vec3u(255u);
}

fn average(word: u32, pixel: u32) -> u32 {
    let old = bytes(word);
    let count = old.w + 1u;
    let rgb = (old.xyz * old.w + recorded(pixel) + count / 2u) / count;
    return rgb.x | (rgb.y << 8u) | (rgb.z << 16u) | (min(count, COLOR_WEIGHT) << 24u);
}

@compute @workgroup_size(8, 8, 4)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_id) local: vec3u) {
    let index = work[group.x] & ~FRESH;
    let is_fresh = (work[group.x] & FRESH) != 0u;
    let first = table[index] * BLOCK_VOXELS;
    let block = block_coords(index, params.grid);
    for (var i = 0u; i < 2u; i++) {
        let voxel = vec3u(local.xy, 4u * i + local.z);
        let at = first + (voxel.z * 8u + voxel.y) * 8u + voxel.x;
        let seen = look_up(block, voxel);
        let is_near = seen.is_valid && abs(seen.distance_m) <= 2.0 * params.voxel_m;
        var word = 0u;
        if !is_fresh && is_near {
            word = colors[at];
        }
        if is_near {
            word = average(word, seen.pixel);
        }
        if is_near || is_fresh {
            colors[at] = word;
        }
    }
}
