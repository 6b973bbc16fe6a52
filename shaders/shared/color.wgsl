// Rec. 709 luminance of linear RGB.
fn luminance(rgb: vec3f) -> f32 {
    return 0.2126 * rgb.r + 0.7152 * rgb.g + 0.0722 * rgb.b;
}
