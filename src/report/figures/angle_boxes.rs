//! The middle row of Fig. 8: angle between the estimated and the true dominant direction, a box for
//! every scene and method.

use super::canvas::{Anchor, Canvas, Panel, legend_height, nothing, text_width};
use super::class_of;
use crate::report::markup::number;
use crate::report::statistics::BoxSummary;
use crate::report::ticks::Axis;
use crate::study::light::LightStudy;

const LEFT: f64 = 52.0;
const HEIGHT: f64 = 260.0;

/// Box plots over all frames and lights of a scene: bar at the median, box between the quartiles,
/// whiskers to the outermost value within 1.5 box heights, dots at the extremes beyond them.
///
/// Both halves of a study, exact depth and sensor noise, have the same axis.
pub fn angle_boxes(study: &LightStudy, sensor_noise: bool) -> String {
    let depth = if sensor_noise { "sensor noise" } else { "exact depth" };
    let name = format!("Angle to the true dominant direction by scene and method, {depth}");
    if !study.runs.iter().any(|run| run.sensor_noise == sensor_noise) {
        return nothing(&name, &format!("No run with {depth}."));
    }
    let (scenes, methods) = (&study.scenes, &study.methods);
    let group = (18.0 * methods.len() as f64 + 28.0).max(90.0).max(980.0 / scenes.len() as f64);
    let width = LEFT + group * scenes.len() as f64 + 10.0;
    let legend = legend_height(LEFT, width, methods);
    let panel = Panel {
        left: LEFT,
        top: legend + 14.0,
        width: group * scenes.len() as f64,
        height: HEIGHT,
    };
    let mut canvas = Canvas::new(width, panel.bottom() + 30.0, &name);
    canvas.text("soft", (0.0, panel.top - 8.0 - legend * 0.5), Anchor::Start, "degrees");
    let entries: Vec<_> =
        methods.iter().map(|m| (format!("f{}", class_of(m)), m.clone())).collect();
    canvas.legend(LEFT + text_width("degrees"), 0.0, &entries);
    let largest = study.runs.iter().flat_map(|r| r.frames.iter().filter_map(|f| f.angle_deg));
    let axis = Axis::from_zero(largest, 6);
    canvas.y_axis(&panel, &axis);
    for (i, scene) in scenes.iter().enumerate() {
        let left = panel.left + group * i as f64;
        if i > 0 {
            canvas.line("grid", (left, panel.top), (left, panel.bottom()));
        }
        let middle = (left + 0.5 * group, panel.bottom() + 18.0);
        canvas.fitted("", middle, Anchor::Middle, scene, group - 8.0);
        let slot = (group - 20.0) / methods.len().max(1) as f64;
        for (k, method) in methods.iter().enumerate() {
            let angles = angles(study, scene, method, sensor_noise);
            let x = left + 10.0 + slot * (k as f64 + 0.5);
            if let Some(b) = BoxSummary::of(angles) {
                draw_box(&mut canvas, &panel, &axis, x, slot, &b, method, scene);
            }
        }
    }
    canvas.line("rule", (panel.left, panel.bottom()), (panel.right(), panel.bottom()));
    canvas.finish()
}

fn angles<'a>(
    study: &'a LightStudy,
    scene: &'a str,
    method: &'a str,
    sensor_noise: bool,
) -> impl Iterator<Item = f64> + 'a {
    let of = move |r: &&crate::study::light::LightRun| {
        r.scene == scene && r.method == method && r.sensor_noise == sensor_noise
    };
    study.runs.iter().filter(of).flat_map(|r| r.frames.iter().filter_map(|f| f.angle_deg))
}

fn draw_box(
    canvas: &mut Canvas,
    panel: &Panel,
    axis: &Axis,
    x: f64,
    slot: f64,
    b: &BoxSummary,
    method: &str,
    scene: &str,
) {
    let half = (0.36 * slot).min(13.0);
    let y = |value: f64| panel.y(axis.share(value));
    let color = class_of(method);
    let stroke = format!("line s{color}");
    for (from, to) in [(b.low_whisker, b.lower_quartile), (b.upper_quartile, b.high_whisker)] {
        canvas.line(&stroke, (x, y(from)), (x, y(to)));
    }
    for end in [b.low_whisker, b.high_whisker] {
        canvas.line(&stroke, (x - 0.5 * half, y(end)), (x + 0.5 * half, y(end)));
    }
    for (extreme, whisker) in [(b.min, b.low_whisker), (b.max, b.high_whisker)] {
        if extreme != whisker {
            let title = format!("{scene}, {method}: {}°", number(extreme, 1));
            canvas.circle(&format!("f{color} faint"), (x, y(extreme)), 2.2, &title);
        }
    }
    let title = format!(
        "{scene}, {method}: median {}°, quartiles {}° to {}°, range {}° to {}°, {} frames",
        number(b.median, 1),
        number(b.lower_quartile, 1),
        number(b.upper_quartile, 1),
        number(b.min, 1),
        number(b.max, 1),
        b.count
    );
    let top = y(b.upper_quartile);
    let size = (2.0 * half, (y(b.lower_quartile) - top).max(1.0));
    canvas.rect(&format!("box f{color} s{color}"), (x - half, top), size, &title);
    let median = format!("median s{color}");
    canvas.line(&median, (x - half, y(b.median)), (x + half, y(b.median)));
}
