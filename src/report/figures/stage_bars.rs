//! Stage times of several runs as stacked bars.

use super::canvas::{Anchor, Canvas, Panel, legend_height, nothing, text_width};
use super::stage_class;
use crate::report::markup::{number, three_digits};
use crate::report::ticks::Axis;
use crate::timing::Stage;

/// What the length of a bar means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BarScale {
    Milliseconds,
    /// Of the sum of the stages.
    Percent,
}

const WIDTH: f64 = 1040.0;
const ROW: f64 = 34.0;
const BAR: f64 = 22.0;

/// A bar for each `(name, milliseconds of each of [`Stage::ALL`])`.
pub fn stage_bars(rows: &[(&str, [f64; Stage::ALL.len()])], scale: BarScale) -> String {
    let name = "Stage times";
    if rows.is_empty() {
        return nothing(name, "No stage times.");
    }
    let rows: Vec<_> = rows.iter().map(|(name, times)| (*name, scaled(times, scale))).collect();
    let longest = rows.iter().map(|(name, _)| text_width(name)).fold(0.0, f64::max);
    let left = (longest + 12.0).clamp(60.0, 240.0);
    let names = Stage::ALL.map(|s| s.name().to_owned());
    let top = legend_height(left, WIDTH, &names) + 8.0;
    let panel =
        Panel { left, top, width: WIDTH - left - 66.0, height: ROW * rows.len() as f64 + 6.0 };
    let mut canvas = Canvas::new(WIDTH, panel.bottom() + 40.0, name);
    let entries: Vec<_> = names.into_iter().enumerate().map(|(i, n)| (stage_class(i), n)).collect();
    canvas.legend(left, 0.0, &entries);
    let axis = match scale {
        BarScale::Milliseconds => Axis::from_zero(rows.iter().map(|(_, t)| t.iter().sum()), 8),
        BarScale::Percent => Axis::from_zero([100.0], 10),
    };
    canvas.x_axis(&panel, &axis);
    let unit = match scale {
        BarScale::Milliseconds => "ms",
        BarScale::Percent => "%",
    };
    let title = match scale {
        BarScale::Milliseconds => "median milliseconds a frame",
        BarScale::Percent => "percent of the update",
    };
    canvas.text("soft", (panel.x(0.5), panel.bottom() + 34.0), Anchor::Middle, title);
    for (i, (name, times)) in rows.iter().enumerate() {
        let y = panel.top + ROW * i as f64 + 0.5 * (ROW - BAR) + 3.0;
        canvas.fitted("", (left - 8.0, y + 15.0), Anchor::End, name, left - 10.0);
        let end = draw_bar(&mut canvas, &panel, &axis, y, name, times, unit);
        if scale == BarScale::Milliseconds {
            let sum = format!("{} ms", three_digits(times.iter().sum::<f64>()));
            canvas.text("bold halo", (end + 6.0, y + 15.0), Anchor::Start, &sum);
        }
    }
    canvas.line("rule", (left, panel.top), (left, panel.bottom()));
    canvas.finish()
}

/// Gives the right end of the bar.
fn draw_bar(
    canvas: &mut Canvas,
    panel: &Panel,
    axis: &Axis,
    y: f64,
    name: &str,
    times: &[f64; Stage::ALL.len()],
    unit: &str,
) -> f64 {
    let mut before = 0.0;
    for (k, stage) in Stage::ALL.into_iter().enumerate() {
        let (from, to) = (panel.x(axis.share(before)), panel.x(axis.share(before + times[k])));
        before += times[k];
        let value = match unit {
            "%" => number(times[k], 1),
            _ => three_digits(times[k]),
        };
        let title = format!("{name}, {}: {} {unit}", stage.name(), number(times[k], 2));
        canvas.rect(&stage_class(k), (from, y), (to - from, BAR), &title);
        if to - from > text_width(&value) + 6.0 {
            canvas.text("on", (0.5 * (from + to), y + 15.0), Anchor::Middle, &value);
        }
    }
    panel.x(axis.share(before))
}

fn scaled(times: &[f64; Stage::ALL.len()], scale: BarScale) -> [f64; Stage::ALL.len()] {
    let times = times.map(|t| if t.is_finite() { t.max(0.0) } else { 0.0 });
    let sum: f64 = times.iter().sum();
    match scale {
        BarScale::Percent if sum > 0.0 => times.map(|t| 100.0 * t / sum),
        _ => times,
    }
}
