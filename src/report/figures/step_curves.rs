//! How an estimate follows a lamp that is switched.

use super::canvas::{Anchor, Canvas, Panel, legend_height, nothing};
use super::class_of;
use crate::report::markup::number;
use crate::report::ticks::Axis;
use crate::study::light::{LightStudy, StepResponse};

const COLUMNS: usize = 3;
const CELL: (f64, f64) = (345.0, 220.0);
const SETTLED: f64 = 0.1;

/// Distance of the SH coefficients to their final value, by frames since the switch: a panel for every
/// scene, a line for every method, and a dot where it has settled.
pub fn step_curves(study: &LightStudy, sensor_noise: bool) -> String {
    let depth = if sensor_noise { "sensor noise" } else { "exact depth" };
    let name = format!("Step response of the light, {depth}");
    let steps: Vec<&StepResponse> = study
        .steps
        .iter()
        .filter(|s| s.sensor_noise == sensor_noise && !s.trace.is_empty())
        .collect();
    let mut scenes: Vec<&str> = Vec::new();
    let mut methods: Vec<String> = Vec::new();
    for step in &steps {
        if !scenes.contains(&step.scene.as_str()) {
            scenes.push(&step.scene);
        }
        if !methods.contains(&step.method) {
            methods.push(step.method.clone());
        }
    }
    if steps.is_empty() {
        return nothing(&name, &format!("No step response with {depth}."));
    }
    let columns = scenes.len().min(COLUMNS);
    let width = CELL.0 * columns as f64;
    let legend = legend_height(0.0, width, &methods);
    let height = legend + 6.0 + CELL.1 * scenes.len().div_ceil(columns) as f64;
    let mut canvas = Canvas::new(width, height, &name);
    let entries: Vec<_> =
        methods.iter().map(|m| (format!("f{}", class_of(m)), m.clone())).collect();
    canvas.legend(0.0, 0.0, &entries);

    let all = || steps.iter().flat_map(|s| s.trace.iter().map(|t| (since(s, t.frame), t.distance)));
    let x_axis = Axis::from_zero(all().map(|(frame, _)| frame), 5);
    let y_axis = Axis::from_zero(all().map(|(_, distance)| distance), 4);
    for (i, scene) in scenes.iter().enumerate() {
        let panel = Panel {
            left: CELL.0 * (i % columns) as f64 + 38.0,
            top: legend + 32.0 + CELL.1 * (i / columns) as f64,
            width: CELL.0 - 58.0,
            height: CELL.1 - 80.0,
        };
        canvas.fitted("bold", (panel.left, panel.top - 9.0), Anchor::Start, scene, panel.width);
        canvas.y_axis(&panel, &y_axis);
        canvas.x_axis(&panel, &x_axis);
        let middle = (panel.x(0.5), panel.bottom() + 32.0);
        canvas.text("soft", middle, Anchor::Middle, "frames after the switch");
        let switch = panel.x(x_axis.share(0.0));
        canvas.line("rule", (switch, panel.top), (switch, panel.bottom()));
        let settled = panel.y(y_axis.share(SETTLED));
        canvas.line("dash", (panel.left, settled), (panel.right(), settled));
        for step in steps.iter().filter(|s| s.scene == *scene) {
            draw_step(&mut canvas, &panel, &x_axis, &y_axis, step);
        }
    }
    canvas.finish()
}

fn draw_step(canvas: &mut Canvas, panel: &Panel, x: &Axis, y: &Axis, step: &StepResponse) {
    let at = |frame: f64, distance: f64| (panel.x(x.share(frame)), panel.y(y.share(distance)));
    let color = class_of(&step.method);
    let settled = match step.settled_after {
        Some(frames) => format!("settled after {frames} frames"),
        None => "never settles".to_owned(),
    };
    let title = format!("{}: {settled}", step.method);
    let points: Vec<(f64, f64)> = step
        .trace
        .iter()
        .filter(|t| t.distance.is_finite())
        .map(|t| at(since(step, t.frame), t.distance))
        .collect();
    canvas.polyline(&format!("line s{color}"), &points, &title);
    let Some(frames) = step.settled_after else { return };
    let there = step.trace.iter().find(|t| t.frame == step.switch_frame + frames);
    if let Some(t) = there.filter(|t| t.distance.is_finite()) {
        let title = format!("{title}, distance {} there", number(t.distance, 2));
        canvas.circle(&format!("f{color} dot"), at(frames as f64, t.distance), 4.5, &title);
    }
}

/// Frames since the switch, negative before it.
fn since(step: &StepResponse, frame: usize) -> f64 {
    frame as f64 - step.switch_frame as f64
}
