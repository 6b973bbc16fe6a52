// The lower median of a window's depths: always a depth that was measured, never a mean across an edge.
// Constants: TAPS, pixels that the window looks at; GUIDED.
//
// Positive numbers are ordered as their bits are, so the value of a rank is found bit by bit from the
// top, by counting: no sorting, and no memory for windows of more than 32 taps.

const NO_VALUE = 0xffffffffu;
const CACHED = TAPS <= 32u;

var<private> cache: array<u32, select(1u, TAPS, CACHED)>;

fn value(tap: u32, pixel: vec2i) -> u32 {
    if CACHED {
        return cache[tap];
    }
    return gather(tap, pixel);
}

// Bits of the depth that a tap sees: nothing where depth is missing, outside the picture, or where the
// guide differs from the pixel's own by the threshold or more (Gruber et al. 2015, Eq. 1).
fn gather(tap: u32, pixel: vec2i) -> u32 {
    let at = pixel + taps[tap];
    if any(at < vec2i(0)) || any(at >= vec2i(params.size)) {
        return NO_VALUE;
    }
    let depth_m = window_depth(at);
    var counts = depth_m > 0.0;
    if GUIDED {
        counts = counts && abs(intensity(at) - intensity(pixel)) < params.intensity_threshold;
    }
    return select(NO_VALUE, bitcast<u32>(depth_m), counts);
}

fn index(pixel: vec2i) -> u32 {
    return u32(pixel.y) * params.size.x + u32(pixel.x);
}

fn intensity(pixel: vec2i) -> f32 {
    return color[index(pixel)].w;
}

// Looks at the window; returns how many depths count.
fn open_window(pixel: vec2i) -> u32 {
    var count = 0u;
    for (var tap = 0u; tap < TAPS; tap++) {
        let bits = gather(tap, pixel);
        if CACHED {
            cache[tap] = bits;
        }
        count += u32(bits != NO_VALUE);
    }
    return count;
}

// Of the window that is open: the value of rank (count - 1) / 2, or 0.0 where none counts.
fn lower_median(pixel: vec2i, count: u32) -> f32 {
    if count == 0u {
        return 0.0;
    }
    // the leading bits that all values share are the median's, too: on one surface about a third of them
    var set_in_any = 0u;
    var set_in_all = NO_VALUE;
    for (var tap = 0u; tap < TAPS; tap++) {
        let bits = value(tap, pixel);
        set_in_any |= select(bits, 0u, bits == NO_VALUE);
        set_in_all &= bits;
    }
    let open_bits = 32u - countLeadingZeros(set_in_any ^ set_in_all);
    var rank = (count - 1u) / 2u;
    var found = (set_in_all >> open_bits) << open_bits;
    for (var above = open_bits; above > 0u; above--) {
        let bit = above - 1u;
        let leading = found >> bit;
        var below = 0u;
        for (var tap = 0u; tap < TAPS; tap++) {
            // the same leading bits, and a 0 here
            below += u32((value(tap, pixel) >> bit) == leading);
        }
        if rank >= below {
            rank -= below;
            found |= 1u << bit;
        }
    }
    return bitcast<f32>(found);
}
