// Shading in planes that follow each other, one vec4f a point:
// - R, and the kind of surface,
// - R', or of virtual points the part of the unoccluded light that arrives; and 1 where a virtual object
//   may have changed it, else 0,
// - the bounce, where there is one.
// Constant: PLANES, 2 or 3. `points` is how many points a plane has.

const HAS_BOUNCE = PLANES == 3u;

// Light beyond this counts as this, so that the filters' sums and products stay finite.
const LARGEST = 1e37;

const NOTHING = 0.0;
const REAL = 1.0;
const VIRTUAL = 2.0;

const NO_ORIGIN = 0u;
const VIRTUAL_ORIGIN = 3u;

fn real_of(point: u32) -> u32 {
    return point;
}

fn merged_of(point: u32, points: u32) -> u32 {
    return points + point;
}

fn bounce_of(point: u32, points: u32) -> u32 {
    return 2u * points + point;
}

fn kind_of(origin: u32, depth_m: f32) -> f32 {
    if origin == VIRTUAL_ORIGIN {
        return VIRTUAL;
    }
    return select(NOTHING, REAL, origin != NO_ORIGIN && depth_m > 0.0);
}

// The pixel that a grid point stands at: the middle of its step, inside the image.
fn grid_pixel(point: vec2u, step: u32, image: vec2u) -> vec2u {
    return min(point * step + step / 2u, image - 1u);
}
