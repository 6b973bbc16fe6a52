//! Composed pictures against path-traced ones.

use super::slider::{Choice, slider};
use super::{Section, depth_name};
use crate::math::median;
use crate::report::markup::{escape, number, table, three_digits};
use crate::report::pictures::{self, Pictures};
use crate::report::sources::{Found, Sources, picture_cases, pictures_in};
use crate::report::statistics::mean;
use crate::study::composite::{CompositeFrame, CompositeRun, CompositeStudy};
use image::RgbImage;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// `None` without a composite study.
pub(in crate::report) fn section(sources: &Sources, pictures: &mut Pictures) -> Option<Section> {
    let mut html = String::new();
    for found in &sources.composite {
        html += &all_pictures(found, pictures);
        html += &variants(&found.record);
        html += &objects(&found.record);
    }
    let title = "Composed pictures against the truth";
    (!html.is_empty()).then_some(Section { id: "composite", title, html })
}

/// Runs that answer the same question.
#[derive(Clone, Copy, PartialEq)]
struct Setting<'a> {
    preset: &'a str,
    variant: &'a str,
    sensor_noise: bool,
}

impl<'a> Setting<'a> {
    fn of(run: &'a CompositeRun) -> Self {
        Self { preset: &run.preset, variant: &run.variant, sensor_noise: run.sensor_noise }
    }
}

fn settings(study: &CompositeStudy) -> Vec<Setting<'_>> {
    let mut all = Vec::new();
    for run in &study.runs {
        let setting = Setting::of(run);
        if !all.contains(&setting) {
            all.push(setting);
        }
    }
    all
}

type Measure = fn(&CompositeFrame) -> f64;

fn run_median(run: &CompositeRun, measure: Measure) -> Option<f64> {
    median(run.frames.iter().map(measure))
}

/// Mean over runs of the median over frames.
pub(in crate::report) fn overall(
    runs: &[CompositeRun],
    wanted: impl Fn(&CompositeRun) -> bool,
    measure: Measure,
) -> Option<f64> {
    mean(runs.iter().filter(|r| wanted(r)).filter_map(|r| run_median(r, measure)))
}

fn variants(study: &CompositeStudy) -> String {
    let changes: Vec<Option<f64>> =
        settings(study).iter().map(|s| change_from_preset(study, s)).collect();
    let largest = changes.iter().flatten().fold(0.0f64, |m, v| m.max(v.abs()));
    let rows = settings(study).into_iter().zip(&changes).map(|(setting, change)| {
        let of = |r: &CompositeRun| Setting::of(r) == setting;
        let value = |measure, digits| number(overall(&study.runs, of, measure), digits);
        let update = mean(study.runs.iter().filter(|r| of(r)).map(|r| r.update_ms));
        vec![
            escape(setting.variant),
            escape(setting.preset),
            depth_name(setting.sensor_noise).to_owned(),
            value(|f| f.psnr_db, 2),
            value(|f| f.ssim, 4),
            value(|f| f.flip, 4),
            value(|f| f.changed_rmse, 3),
            value(|f| f.object_rmse, 3),
            three_digits(update),
            difference_bar(*change, largest),
        ]
    });
    let head = [
        "Variant",
        "preset",
        "depth",
        "PSNR (dB)",
        "SSIM",
        "FLIP",
        "change RMSE",
        "object RMSE",
        "update (ms)",
        "change RMSE against its preset",
    ];
    format!(
        "<h3>Presets and variants</h3><p class=\"note\">Mean over sequences of the median over frames. \
         Change RMSE: relative error of the change of light on real surfaces, where the object caused \
         one. Bars: the same against the preset without the change, over the sequences that both ran \
         on; to the left is better.</p>{}",
        table(&head, &rows.collect::<Vec<_>>(), 3)
    )
}

/// Mean relative change of the error against the unchanged preset on the same sequence. `None` for the
/// preset itself.
fn change_from_preset(study: &CompositeStudy, setting: &Setting) -> Option<f64> {
    let error = |run| run_median(run, |f| f.changed_rmse);
    let changes = study.runs.iter().filter(|r| Setting::of(r) == *setting && !r.changes.is_empty());
    mean(changes.filter_map(|run| {
        let base = study.runs.iter().find(|base| {
            base.changes.is_empty()
                && base.preset == run.preset
                && base.sequence == run.sequence
                && base.object == run.object
                && base.sensor_noise == run.sensor_noise
        })?;
        Some(error(run)? / error(base)? - 1.0)
    }))
}

/// A bar from the middle to the left (smaller, better) or right, with its percentage.
fn difference_bar(change: Option<f64>, largest: f64) -> String {
    let Some(change) = change.filter(|c| c.is_finite()) else { return "–".to_owned() };
    let length = if largest > 0.0 { 50.0 * change.abs() / largest } else { 0.0 };
    let (class, left) = if change < 0.0 { ("better", 50.0 - length) } else { ("worse", 50.0) };
    let sign = if change > 0.0 { "+" } else { "" };
    format!(
        "<span class=\"diff\"><span class=\"track\"><i class=\"{class}\" \
         style=\"left:{left:.1}%;width:{length:.1}%\"></i></span><span>{sign}{} %</span></span>",
        number(100.0 * change, 1)
    )
}

/// Error by kind of object, a column for every preset as it is.
fn objects(study: &CompositeStudy) -> String {
    let plain: Vec<Setting> = settings(study)
        .into_iter()
        .filter(|s| study.runs.iter().any(|r| Setting::of(r) == *s && r.changes.is_empty()))
        .collect();
    let mut kinds: Vec<&str> = Vec::new();
    for run in &study.runs {
        if !kinds.contains(&run.object.as_str()) {
            kinds.push(&run.object);
        }
    }
    let name = |s: &Setting| format!("{}, {}", escape(s.preset), depth_name(s.sensor_noise));
    let head: Vec<String> =
        std::iter::once("Change RMSE by object".to_owned()).chain(plain.iter().map(name)).collect();
    let row = |kind: &&str| {
        let cells = plain.iter().map(|setting| {
            let of = |r: &CompositeRun| {
                Setting::of(r) == *setting && r.object == *kind && r.changes.is_empty()
            };
            number(overall(&study.runs, of, |f| f.changed_rmse), 3)
        });
        std::iter::once(escape(kind)).chain(cells).collect::<Vec<_>>()
    };
    let rows: Vec<_> = kinds.iter().map(row).collect();
    table(&head.iter().map(String::as_str).collect::<Vec<_>>(), &rows, 1)
}

const WIDTH: u32 = 640;

fn all_pictures(found: &Found<CompositeStudy>, pictures: &mut Pictures) -> String {
    let mut html = String::new();
    for case in picture_cases(&found.folder) {
        let name = case.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        for (frame, paths) in by_frame(pictures_in(&case)) {
            let caption = format!("{name}, frame {frame}");
            html += &slider(&caption, &choices(&paths, pictures), (0, 1), pictures);
        }
    }
    match html.is_empty() {
        true => html,
        false => format!(
            "<p class=\"note\">Drag the line, or move it with the arrow keys. \u{201c}Difference\u{201d} \
             is to the truth, in encoded values, black for none; a quarter of the range and more is \
             pale yellow; \u{201c}FLIP\u{201d} is the perceived one.</p><div class=\"pictures\">{html}</div>"
        ),
    }
}

/// What a picture shows, and where it is.
type Named = (String, PathBuf);

/// The pictures of each measured frame, which the study names `FRAME-WHAT.png`; others are none of its.
fn by_frame(paths: Vec<PathBuf>) -> BTreeMap<usize, Vec<Named>> {
    let mut frames: BTreeMap<usize, Vec<Named>> = BTreeMap::new();
    for path in paths {
        let stem = path.file_stem().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let Some((frame, what)) = stem.split_once('-') else { continue };
        let Ok(frame) = frame.parse() else { continue };
        frames.entry(frame).or_default().push((what.to_owned(), path));
    }
    frames
}

/// Truth, presets, what differs between them, the camera's picture.
fn choices(paths: &[Named], pictures: &mut Pictures) -> Vec<Choice> {
    let mut one = |wanted: &str| {
        let (_, path) = paths.iter().find(|(what, _)| what == wanted)?;
        pictures.read(path, WIDTH)
    };
    let [truth, input] = ["truth", "input"].map(&mut one);
    let mut shown: Vec<(String, RgbImage)> = Vec::new();
    let mut differences: Vec<(String, RgbImage)> = Vec::new();
    for (what, path) in paths.iter().filter(|(what, _)| what != "truth" && what != "input") {
        let Some(picture) = pictures.read(path, WIDTH) else { continue };
        if let Some(preset) = what.strip_suffix("-flip") {
            differences.push((format!("FLIP of {preset}"), picture));
            continue;
        }
        if let Some(map) = truth.as_ref().and_then(|truth| pictures::difference(&picture, truth)) {
            differences.push((format!("difference of {what}"), map));
        }
        shown.push((what.clone(), picture));
    }
    let truth = truth.map(|picture| ("truth (path-traced)".to_owned(), picture));
    let input = input.map(|picture| ("camera".to_owned(), picture));
    let all = truth.into_iter().chain(shown).chain(differences).chain(input);
    all.filter_map(|(name, picture)| Choice::new(&name, &picture)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_of_a_frame_belong_together() {
        let names = ["000020-ours-fast.png", "000003-truth.png", "000020-truth.png", "notes-a.png"];
        let frames = by_frame(names.map(PathBuf::from).to_vec());
        let what = |frame| frames[&frame].iter().map(|n| n.0.as_str()).collect::<Vec<_>>();
        assert_eq!(frames.keys().collect::<Vec<_>>(), [&3, &20]);
        assert_eq!((what(3), what(20)), (vec!["truth"], vec!["ours-fast", "truth"]));
    }
}
