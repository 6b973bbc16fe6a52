//! The top row of Fig. 8: dominant directions drawn on the environment map of a light.

use super::canvas::{Anchor, Canvas, nothing};
use super::class_of;
use crate::eval::light::angle_deg;
use crate::report::markup::number;
use crate::report::statistics::median_direction;
use crate::study::light::{LightRun, LightStudy};
use glam::DVec3;

const SIZE: (f64, f64) = (320.0, 160.0);

/// Dots where the methods see the light, each the median over all frames of all scenes (small dots:
/// of each scene), and a ring at the true direction.
///
/// `picture` is a data URI of the environment map, laid out as [`crate::output::Panorama::z_up`].
pub fn environment_dots(
    study: &LightStudy,
    light: usize,
    sensor_noise: bool,
    picture: Option<&str>,
) -> String {
    let depth = if sensor_noise { "sensor noise" } else { "exact depth" };
    let name = format!("Estimated and true directions of light {}, {depth}", light + 1);
    let runs: Vec<&LightRun> =
        study.runs.iter().filter(|r| r.light == light && r.sensor_noise == sensor_noise).collect();
    let Some(truth) = median_direction(runs.iter().map(|r| r.true_direction)) else {
        return nothing(&name, &format!("Light {}: no run with {depth}.", light + 1));
    };
    let mut canvas = Canvas::new(SIZE.0, SIZE.1, &name);
    match picture {
        Some(uri) => canvas.picture(uri, (0.0, 0.0), SIZE),
        None => draw_empty_map(&mut canvas),
    }
    for scene in &study.scenes {
        for method in &study.methods {
            let of = |r: &&&LightRun| r.method == *method && r.scene == *scene;
            let class = format!("f{} faint", class_of(method));
            let title = format!("{method}, {scene}");
            draw_dot(&mut canvas, &class, 2.3, &title, runs.iter().filter(of), truth);
        }
    }
    let (x, y) = on_map(truth);
    canvas.circle("truth-rim", (x, y), 10.0, "");
    canvas.circle("truth", (x, y), 10.0, "True direction");
    for method in &study.methods {
        let class = format!("f{} dot", class_of(method));
        let of = |r: &&&LightRun| r.method == *method;
        draw_dot(&mut canvas, &class, 5.5, method, runs.iter().filter(of), truth);
    }
    canvas.finish()
}

fn draw_dot<'a>(
    canvas: &mut Canvas,
    class: &str,
    radius: f64,
    title: &str,
    runs: impl Iterator<Item = &'a &'a LightRun>,
    truth: [f64; 3],
) {
    let seen = runs.flat_map(|r| r.frames.iter().filter_map(|f| f.direction));
    if let Some(direction) = median_direction(seen) {
        let [a, b] = [direction, truth].map(|d| DVec3::from_array(d).as_vec3());
        let title = format!("{title}: {}° off", number(angle_deg(a, b), 1));
        canvas.circle(class, on_map(direction), radius, &title);
    }
}

fn draw_empty_map(canvas: &mut Canvas) {
    canvas.rect("empty-map", (0.0, 0.0), SIZE, "");
    canvas.line("maprule", (0.0, 0.5 * SIZE.1), (SIZE.0, 0.5 * SIZE.1));
    for (direction, label) in
        [([1.0, 0.0, 0.0], "+x"), ([0.0, 1.0, 0.0], "+y"), ([0.0, -1.0, 0.0], "\u{2212}y")]
    {
        let (x, _) = on_map(direction);
        canvas.line("maprule", (x, 0.0), (x, SIZE.1));
        canvas.text("soft", (x + 4.0, SIZE.1 - 6.0), Anchor::Start, label);
    }
}

/// Where a direction lies in the map: the inverse of [`crate::output::Panorama::direction`].
fn on_map([x, y, z]: [f64; 3]) -> (f64, f64) {
    use std::f64::consts::PI;
    let to_left = y.atan2(x);
    let from_up = (x.hypot(y)).atan2(z);
    (SIZE.0 * (PI - to_left) / (2.0 * PI), SIZE.1 * from_up / PI)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Size;
    use crate::output::Panorama;

    #[test]
    fn dots_lie_where_the_map_shows_their_direction() {
        let size = Size::new(SIZE.0 as usize, SIZE.1 as usize);
        for (x, y) in [(0, 0), (100, 30), (160, 80), (319, 140), (233, 159)] {
            let (u, v) = on_map(Panorama::z_up().direction(x, y, size).to_array());
            let (du, dv) = (u - x as f64 - 0.5, v - y as f64 - 0.5);
            assert!(du.abs() < 1e-9 && dv.abs() < 1e-9, "{x},{y}: {u},{v}");
        }
    }
}
