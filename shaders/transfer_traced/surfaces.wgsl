// The surfaces that pixels show. The main file declares `surface`, normal and depth of every pixel.
#import transfer_traced/points

const LARGEST_FINITE = 0x7f7fffffu;
// Surfaces further away are moved here: out of everything's reach, but their coordinates are finite.
const FARTHEST_POINT_M = 1.0e9;

struct Surface {
    is_valid: bool,
    // in the world
    position: vec3f,
    normal: vec3f,
}

const NOTHING = Surface(false, vec3f(0.0), vec3f(0.0));

// Of a pixel. None where depth is missing, or the normal is not of about unit length.
fn surface_at(pixel: vec2u) -> Surface {
    let found = surface[pixel_index(pixel)];
    let depth = bitcast<u32>(found.w);
    let squared = bitcast<u32>(dot(found.xyz, found.xyz));
    // bits are compared, as they tell what is no number from what is
    let is_valid = depth > 0u && depth <= LARGEST_FINITE
        && squared > bitcast<u32>(0.25) && squared < bitcast<u32>(4.0);
    if !is_valid {
        return NOTHING;
    }
    let depth_m = min(found.w, FARTHEST_POINT_M);
    let w = select(1.0, depth_m, params.perspective == 1u);
    let aside = (vec2f(pixel) - params.centre) * params.inverse_scale * w;
    let position = (params.world_from_view * vec4f(aside, depth_m, 1.0)).xyz;
    return Surface(true, position, found.xyz);
}
