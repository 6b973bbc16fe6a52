// Whether two points may lie on one smooth surface: each near the other's tangent plane (on a floor that is
// seen at a slant depth changes without an edge), with normals that are alike.
fn joins(a: Surface, b: Surface) -> bool {
    let between = b.position - a.position;
    return a.is_valid && b.is_valid
        && abs(dot(between, a.normal)) <= params.smooth_m
        && abs(dot(between, b.normal)) <= params.smooth_m
        && dot(a.normal, b.normal) >= params.smooth_cosine;
}
