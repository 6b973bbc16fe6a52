// Which samples of a pixel lie in front of the real surface.
// Constants: DEPTH_BIAS, by which share of its depth a virtual surface must be nearer; CROSSING_RANGE, share
// of depth within which crossings are found between pixel centres; MAX_SLOPE, in depth per pixel width.
// The importing shader declares `params` with the view, and `real`.

// The real depth of 3x3 pixels, 0.0 where missing.
struct Neighbourhood {
    rows: array<vec3f, 3>,
    // distance in pixels from the middle; 0 where the picture ends
    step_x: vec3f,
    step_y: vec3f,
}

fn real_row(columns: vec3u, row: u32) -> vec3f {
    let first = row * params.view.size.x;
    return vec3f(real[first + columns.x].w, real[first + columns.y].w, real[first + columns.z].w);
}

fn neighbourhood(pixel: vec2u) -> Neighbourhood {
    let before = vec2u(max(vec2i(pixel) - 1, vec2i(0)));
    let after = min(pixel + 1u, params.view.size - 1u);
    let columns = vec3u(before.x, pixel.x, after.x);
    let rows = vec3u(before.y, pixel.y, after.y);
    return Neighbourhood(
        array(real_row(columns, rows.x), real_row(columns, rows.y), real_row(columns, rows.z)),
        vec3f(columns) - f32(pixel.x),
        vec3f(rows) - f32(pixel.y),
    );
}

fn max_slope(depth_m: f32) -> f32 {
    let scale = abs(params.view.scale);
    let slope = MAX_SLOPE / min(scale.x, scale.y);
    return select(slope, slope * depth_m, params.view.perspective == 1u);
}

fn bounded(slope: f32, limit: f32) -> f32 {
    // false for what is no number, too
    return select(0.0, clamp(slope, -limit, limit), abs(slope) < LARGEST_WEIGHT);
}

// Real depth minus that of the triangle at three pixel centres, bounded to -1..1; missing depth is far.
fn row_of_gaps(real_m: vec3f, virtual_m: vec3f, per_range: f32) -> vec3f {
    let gaps = clamp((real_m - virtual_m) * per_range, vec3f(-1.0), vec3f(1.0));
    return select(vec3f(1.0), gaps, real_m > vec3f(0.0));
}

// Real depth minus that of a triangle, continued to 3x3 pixel centres from a sample.
fn gaps_around(face: Face, s: Sight, offset: vec2f, around: Neighbourhood) -> array<vec3f, 3> {
    let depth_m = depth_of(face, s);
    let limit = max_slope(depth_m);
    var slope = vec2f(0.0);
    if s.is_valid {
        let steps = weight_steps(s);
        slope = vec2f(
            bounded(dot(steps.u, face.z), limit),
            bounded(dot(steps.v, face.z), limit),
        );
    }
    let per_range = 1.0 / (CROSSING_RANGE * depth_m);
    let along_x = slope.x * (around.step_x - offset.x);
    let along_y = slope.y * (around.step_y - offset.y);
    let bias = DEPTH_BIAS * depth_m;
    return array(
        row_of_gaps(around.rows[0], depth_m + (along_x + along_y.x) + bias, per_range),
        row_of_gaps(around.rows[1], depth_m + (along_x + along_y.y) + bias, per_range),
        row_of_gaps(around.rows[2], depth_m + (along_x + along_y.z) + bias, per_range),
    );
}

// Bilinear value at a sample from those at 3x3 pixel centres.
fn interpolated(values: array<vec3f, 3>, offset: vec2f) -> f32 {
    let other = select(values[2], values[0], offset.y < 0.0);
    let near = values[1];
    let t = abs(offset);
    let to_near = select(near.z, near.x, offset.x < 0.0);
    let to_other = select(other.z, other.x, offset.x < 0.0);
    let in_near = near.y + t.x * (to_near - near.y);
    let in_other = other.y + t.x * (to_other - other.y);
    return in_near + t.y * (in_other - in_near);
}
