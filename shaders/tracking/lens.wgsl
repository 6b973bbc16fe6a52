// A perspective camera, in pixels: u = x / z * scale + centre.
struct Lens {
    scale: vec2f,
    centre: vec2f,
    inverse_scale: vec2f,
    size: vec2u,
}
