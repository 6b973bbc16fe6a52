// What a pixel of a merged buffer shows, and where the virtual pixels of a view are.

struct Emitter {
    // world normal and z-depth in metres
    surface: vec4f,
    // radiance that leaves it; 1 where it is virtual
    radiance: vec4f,
}

// Columns from the right, columns from the left, rows from the bottom, rows from the top, and the bits of the
// least depth that changes, inverted: all as maxima, so that zero stands for no virtual pixel.
const EXTENT_WORDS = 5u;

fn extent_of(size: vec2u, pixel: vec2u, changed_m: f32) -> array<u32, EXTENT_WORDS> {
    return array<u32, EXTENT_WORDS>(
        size.x - pixel.x, pixel.x + 1u, size.y - pixel.y, pixel.y + 1u, ~bitcast<u32>(changed_m),
    );
}
