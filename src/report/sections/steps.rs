//! How the estimate moves in time: after a lamp is switched, and while nothing happens.

use super::{Section, depth_name, figure};
use crate::report::figures::step_curves;
use crate::report::markup::{escape, number, table};
use crate::report::sources::Sources;
use crate::study::light::LightStudy;

/// `None` where no study has measured it.
pub(in crate::report) fn section(sources: &Sources) -> Option<Section> {
    let mut html = String::new();
    for study in sources.light.iter().map(|found| &found.record) {
        for noise in [false, true] {
            if study.steps.iter().any(|s| s.sensor_noise == noise) {
                let caption = format!(
                    "Relative L2 distance of the SH coefficients to their final value, <b>{}</b>. \
                     Dashed: 10 %. Dot: from here on the estimate stays within 10 %.",
                    depth_name(noise)
                );
                html += &figure(&step_curves(study, noise), &caption);
            }
        }
        html += &settling(study);
        html += &jitter(study);
    }
    let title = "Switched lamp, and standing still";
    (!html.is_empty()).then_some(Section { id: "steps", title, html })
}

fn settling(study: &LightStudy) -> String {
    if study.steps.is_empty() {
        return String::new();
    }
    let rows = study.steps.iter().map(|step| {
        let last_angle = step.trace.iter().rev().find_map(|t| t.angle_deg);
        vec![
            escape(&step.scene),
            escape(&step.method),
            depth_name(step.sensor_noise).to_owned(),
            step.settled_after.map_or("never".to_owned(), |frames| frames.to_string()),
            number(last_angle, 1),
        ]
    });
    let head =
        ["Switched lamp", "method", "depth", "settled after (frames)", "angle at the end (°)"];
    details("Settling times", &table(&head, &rows.collect::<Vec<_>>(), 3))
}

fn jitter(study: &LightStudy) -> String {
    if study.jitter.is_empty() {
        return String::new();
    }
    let rows = study.jitter.iter().map(|j| {
        vec![
            escape(&j.scene),
            escape(&j.method),
            depth_name(j.sensor_noise).to_owned(),
            j.frames.to_string(),
            number(j.median_deg, 3),
            number(j.max_deg, 3),
            number(j.relative_l2, 4),
        ]
    });
    let head = [
        "Jitter",
        "method",
        "depth",
        "frames",
        "median turn a frame (°)",
        "largest (°)",
        "median change of coefficients",
    ];
    format!(
        "<h3>Jitter</h3><p class=\"note\">Camera, scene and light stand still: what moves is \
         error.</p>{}",
        table(&head, &rows.collect::<Vec<_>>(), 3)
    )
}

fn details(summary: &str, html: &str) -> String {
    format!("<details><summary>{summary}</summary>{html}</details>")
}
