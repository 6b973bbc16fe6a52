//! Time against error, and the front that users choose from.

use super::canvas::{Anchor, Canvas, Panel, legend_height, nothing, text_width};
use super::class_of;
use crate::report::markup::{number, three_digits};
use crate::report::ticks::Axis;
use crate::study::tradeoff::{TradePoint, Tradeoff};

/// Which error stands on the upright axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorMeasure {
    LightAngle,
    LightCoefficients,
    Transfer,
    Composite,
}

impl ErrorMeasure {
    pub const ALL: [Self; 4] =
        [Self::LightAngle, Self::LightCoefficients, Self::Transfer, Self::Composite];

    /// `None` where the sweep did not measure it.
    pub fn of(self, point: &TradePoint) -> Option<f64> {
        let value = match self {
            Self::LightAngle => point.light_angle_deg,
            Self::LightCoefficients => point.light_relative_l2,
            Self::Transfer => point.transfer_error,
            Self::Composite => point.composite_error,
        };
        value.filter(|v| v.is_finite())
    }

    pub fn label(self) -> &'static str {
        match self {
            Self::LightAngle => "angle to the true dominant direction (degrees)",
            Self::LightCoefficients => "relative L2 of the light's coefficients",
            Self::Transfer => "relative L2 against traced transfer",
            Self::Composite => "relative RMSE of the composed change of light",
        }
    }
}

/// Every setting as a dot, logarithmic time against error; a line through those that nothing beats in
/// both, and a ring around the presets.
pub fn pareto(tradeoff: &Tradeoff, measure: ErrorMeasure) -> String {
    let name = format!("Update time against {}", measure.label());
    let points: Vec<Dot> = tradeoff.points.iter().filter_map(|p| Dot::of(p, measure)).collect();
    if points.is_empty() {
        return nothing(&name, &format!("No setting with {}.", measure.label()));
    }
    let mut presets: Vec<String> = Vec::new();
    for dot in &points {
        if !presets.contains(&dot.point.preset) {
            presets.push(dot.point.preset.clone());
        }
    }
    let width = 1040.0;
    let legend = legend_height(46.0, width, &presets);
    let panel = Panel { left: 46.0, top: legend + 26.0, width: width - 76.0, height: 360.0 };
    let mut canvas = Canvas::new(width, panel.bottom() + 40.0, &name);
    let entries: Vec<_> =
        presets.iter().map(|p| (format!("f{}", class_of(p)), p.clone())).collect();
    canvas.legend(panel.left, 0.0, &entries);
    canvas.text("soft", (4.0, panel.top - 10.0), Anchor::Start, measure.label());
    let below = (panel.x(0.5), panel.bottom() + 34.0);
    canvas.text("soft", below, Anchor::Middle, "update (ms, logarithmic)");
    let time = Axis::logarithmic(points.iter().map(|d| d.time_ms));
    let error = Axis::from_zero(points.iter().map(|d| d.error), 6);
    canvas.x_axis(&panel, &time);
    canvas.y_axis(&panel, &error);

    let at = |d: &Dot| (panel.x(time.share(d.time_ms)), panel.y(error.share(d.error)));
    let front = front(&points.iter().map(|d| (d.time_ms, d.error)).collect::<Vec<_>>());
    let line: Vec<(f64, f64)> = front.iter().map(|&i| at(&points[i])).collect();
    canvas.polyline("front", &line, "");
    for (i, dot) in points.iter().enumerate() {
        let class = format!("f{}", class_of(&dot.point.preset));
        let (class, radius) = match (dot.is_preset(), front.contains(&i)) {
            (true, _) => (format!("{class} dot"), 6.5),
            (false, true) => (format!("{class} dot"), 4.5),
            (false, false) => (format!("{class} faint"), 3.5),
        };
        if dot.is_preset() {
            canvas.circle("front", at(dot), 9.0, "");
        }
        canvas.circle(&class, at(dot), radius, &dot.title(measure));
    }
    label(&mut canvas, &panel, &points, &front, &line, at);
    canvas.finish()
}

/// Indices of the points that no other beats in both, from fast to slow.
pub(in crate::report) fn front(points: &[(f64, f64)]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|&a, &b| {
        let ((ta, ea), (tb, eb)) = (points[a], points[b]);
        ta.total_cmp(&tb).then(ea.total_cmp(&eb))
    });
    let mut best = f64::INFINITY;
    order.retain(|&i| {
        let better = points[i].1 < best;
        best = best.min(points[i].1);
        better
    });
    order
}

struct Dot<'a> {
    point: &'a TradePoint,
    time_ms: f64,
    error: f64,
}

impl<'a> Dot<'a> {
    fn of(point: &'a TradePoint, measure: ErrorMeasure) -> Option<Self> {
        let time_ms = Some(point.update_ms).filter(|t| *t > 0.0 && t.is_finite())?;
        Some(Self { point, time_ms, error: measure.of(point)? })
    }

    fn is_preset(&self) -> bool {
        self.point.changes.is_empty()
    }

    fn title(&self, measure: ErrorMeasure) -> String {
        let TradePoint { name, preset, changes, .. } = self.point;
        let changes: String = changes.iter().map(|c| format!("\n{c}")).collect();
        format!(
            "{name} ({preset})\n{} ms, {} {}{changes}",
            three_digits(self.time_ms),
            number(self.error, 3),
            measure.label()
        )
    }
}

/// Names beside presets, then beside points on the front, where there is room.
fn label(
    canvas: &mut Canvas,
    panel: &Panel,
    points: &[Dot],
    front: &[usize],
    line: &[(f64, f64)],
    at: impl Fn(&Dot) -> (f64, f64),
) {
    let mut taken: Vec<[f64; 4]> = Vec::new();
    for dot in points {
        let (x, y) = at(dot);
        taken.push([x - 4.0, y - 4.0, x + 4.0, y + 4.0]);
    }
    taken.extend(along(line).map(|(x, y)| [x - 1.0, y - 1.0, x + 1.0, y + 1.0]));
    let presets = (0..points.len()).filter(|&i| points[i].is_preset());
    let others = front.iter().copied().filter(|&i| !points[i].is_preset());
    for i in presets.chain(others) {
        let (x, y) = at(&points[i]);
        let width = text_width(&points[i].point.name).min(230.0);
        // right of the dot, above it, below it, left of it
        let places = [
            (x + 12.0, y + 4.0),
            (x + 4.0, y - 13.0),
            (x + 4.0, y + 22.0),
            (x - 12.0 - width, y + 4.0),
            (x - 4.0 - width, y + 24.0),
            (x - 0.5 * width, y + 34.0),
        ];
        let place = places.into_iter().find(|&(left, base)| {
            let own = [left, base - 11.0, left + width, base + 3.0];
            let inside = left >= panel.left && own[2] <= panel.right() + 26.0;
            let above = own[1] >= panel.top - 6.0 && own[3] <= panel.bottom();
            inside && above && taken.iter().all(|other| !overlap(&own, other))
        });
        // a preset is always named
        let place = place.or(points[i].is_preset().then_some(places[5]));
        let Some((left, base)) = place else { continue };
        taken.push([left, base - 11.0, left + width, base + 3.0]);
        let class = if points[i].is_preset() { "bold halo" } else { "soft halo" };
        canvas.fitted(class, (left, base), Anchor::Start, &points[i].point.name, 230.0);
    }
}

/// Points on a line, closer to each other than a label is high.
fn along(line: &[(f64, f64)]) -> impl Iterator<Item = (f64, f64)> + '_ {
    line.windows(2).flat_map(|ends| {
        let [(x0, y0), (x1, y1)] = [ends[0], ends[1]];
        let steps = ((x1 - x0).hypot(y1 - y0) / 6.0).ceil().max(1.0) as usize;
        (0..=steps).map(move |i| {
            let part = i as f64 / steps as f64;
            (x0 + part * (x1 - x0), y0 + part * (y1 - y0))
        })
    })
}

fn overlap(a: &[f64; 4], b: &[f64; 4]) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_holds_what_nothing_beats() {
        let points = [(3.0, 1.0), (1.0, 5.0), (2.0, 6.0), (2.0, 2.0), (4.0, 1.0), (1.0, 7.0)];
        assert_eq!(front(&points), [1, 3, 0]);
        assert_eq!(front(&[]), Vec::<usize>::new());
        assert_eq!(front(&[(1.0, f64::NAN)]), Vec::<usize>::new());
    }
}
