//! Speed against accuracy.

use super::{Section, figure};
use crate::report::figures::{ErrorMeasure, front, pareto};
use crate::report::markup::{escape, number, table, three_digits};
use crate::report::sources::Sources;
use crate::study::tradeoff::{TradePoint, Tradeoff};

/// `None` without a sweep.
pub(in crate::report) fn section(sources: &Sources) -> Option<Section> {
    let mut html = String::new();
    for found in &sources.tradeoff {
        let tradeoff = &found.record;
        let has = |m: &ErrorMeasure| tradeoff.points.iter().any(|p| m.of(p).is_some());
        let measures: Vec<ErrorMeasure> = ErrorMeasure::ALL.into_iter().filter(has).collect();
        let Some((&first, others)) = measures.split_first() else {
            let folder = escape(&found.folder.display().to_string());
            html += &format!("<p>No setting of the sweep in {folder} has a measured error.</p>");
            continue;
        };
        html += &plot(tradeoff, first);
        html += &front_table(tradeoff, first);
        for &measure in others {
            html += &format!(
                "<details><summary>Update time against {}</summary>{}</details>",
                measure.label(),
                plot(tradeoff, measure)
            );
        }
    }
    let title = "Speed against accuracy";
    (!html.is_empty()).then_some(Section { id: "tradeoff", title, html })
}

fn plot(tradeoff: &Tradeoff, measure: ErrorMeasure) -> String {
    let caption = format!(
        "{} settings over {} sequences. Line: settings that nothing measured beats in both. Rings: \
         presets as they are. Point at a dot for its settings.",
        tradeoff.points.len(),
        tradeoff.sequences.len()
    );
    figure(&pareto(tradeoff, measure), &caption)
}

/// The settings on the front of this plot, from fast to slow.
fn front_table(tradeoff: &Tradeoff, measure: ErrorMeasure) -> String {
    let points: Vec<(&TradePoint, f64, f64)> = tradeoff
        .points
        .iter()
        .filter(|p| p.update_ms > 0.0 && p.update_ms.is_finite())
        .filter_map(|p| Some((p, p.update_ms, measure.of(p)?)))
        .collect();
    let times_and_errors: Vec<(f64, f64)> = points.iter().map(|p| (p.1, p.2)).collect();
    let rows = front(&times_and_errors).into_iter().map(|i| {
        let p = points[i].0;
        vec![
            escape(&p.name),
            escape(&p.preset),
            format!("<code>{}</code>", escape(&p.changes.join(" "))),
            three_digits(p.update_ms),
            number(p.light_angle_deg, 1),
            number(p.light_relative_l2, 3),
            number(p.transfer_error, 3),
            number(p.composite_error, 3),
            number(p.volume_mib, 0),
        ]
    });
    let head = [
        "On the front",
        "preset",
        "changes",
        "update (ms)",
        "angle (°)",
        "light L2",
        "transfer L2",
        "change RMSE",
        "volume (MiB)",
    ];
    table(&head, &rows.collect::<Vec<_>>(), 3)
}
