//! Fig. 8 made again: where the light is seen, and how far that is off.

use super::{Section, depth_name, figure, legend};
use crate::math::median;
use crate::report::figures::{angle_boxes, environment_dots};
use crate::report::markup::{escape, number, table};
use crate::report::pictures::{self, Pictures};
use crate::report::sources::{Found, Sources};
use crate::study::light::{ENVIRONMENT_EXPOSURE, LightRun, LightStudy};
use std::collections::BTreeSet;

/// `None` without a light study.
pub(in crate::report) fn section(sources: &Sources, pictures: &mut Pictures) -> Option<Section> {
    let mut html = String::new();
    for found in &sources.light {
        html += &introduction(found);
        html += &maps(found, pictures);
        html += &boxes(&found.record);
        html += &angle_table(&found.record);
    }
    let title = "Light direction (Fig. 8)";
    (!html.is_empty()).then_some(Section { id: "light", title, html })
}

fn introduction(found: &Found<LightStudy>) -> String {
    let study = &found.record;
    let frames: usize = study.runs.iter().map(|r| r.frames.len()).sum();
    let invalid: usize = study.runs.iter().map(|r| r.invalid).sum();
    format!(
        "<p>{} scenes of growing richness, {} lights on a half circle, {} methods: {} runs of {} \
         frames, the first {} of each not counted. {frames} estimates; {invalid} frames had no valid \
         light. <span class=\"note\">From {}.</span></p>",
        study.scenes.len(),
        lights(study).len(),
        study.methods.len(),
        study.runs.len(),
        study.frames_per_run,
        study.warm_up,
        escape(&found.folder.display().to_string())
    )
}

fn lights(study: &LightStudy) -> BTreeSet<usize> {
    study.runs.iter().map(|r| r.light).collect()
}

/// Whether there are runs with exact depth, and with sensor noise.
fn depths(runs: &[LightRun]) -> impl Iterator<Item = bool> + '_ {
    [false, true].into_iter().filter(|&noise| runs.iter().any(|r| r.sensor_noise == noise))
}

const MAP_WIDTH: u32 = 480;

fn maps(found: &Found<LightStudy>, pictures: &mut Pictures) -> String {
    let study = &found.record;
    let mut html = String::new();
    for light in lights(study) {
        let path = found.folder.join(format!("environment_light{light}.png"));
        let read = pictures.read(&path, MAP_WIDTH);
        let uri = read.and_then(|picture| pictures::data_uri(&picture));
        for noise in depths(&study.runs) {
            let uri = uri.as_deref().filter(|uri| pictures.take([*uri]));
            let svg = environment_dots(study, light, noise, uri);
            let caption = format!("Light {}, {}", light + 1, depth_name(noise));
            html += &format!("<figure>{svg}<figcaption>{caption}</figcaption></figure>");
        }
    }
    let rows = depths(&study.runs).count().max(1);
    format!(
        "{}<div class=\"maps rows{rows}\">{html}</div><p class=\"note\">Environment maps as one sees \
         them turning around, world z up. White ring: true direction. Large dots: median over all \
         frames of all scenes; small dots: of each scene. Brightness: {ENVIRONMENT_EXPOSURE} L / (1 + {ENVIRONMENT_EXPOSURE} L) of \
         the luminance L, for all maps alike.</p>",
        legend(&study.methods)
    )
}

fn boxes(study: &LightStudy) -> String {
    let mut html = String::new();
    for noise in depths(&study.runs) {
        let caption = format!(
            "Angle between the estimated and the true dominant direction, <b>{}</b>, all frames of \
             all lights. Bar: median. Box: quartiles. Whiskers: outermost value within 1.5 box \
             heights. Small dots: extremes beyond.",
            depth_name(noise)
        );
        html += &figure(&angle_boxes(study, noise), &caption);
    }
    html
}

/// Median angles, a row for each scene, exact depth and sensor noise for each method.
fn angle_table(study: &LightStudy) -> String {
    let depths: Vec<bool> = depths(&study.runs).collect();
    let mut head = vec![String::from("Median angle (°)")];
    for method in &study.methods {
        for (i, &noise) in depths.iter().enumerate() {
            let name = if i == 0 { escape(method) + ", " } else { String::new() };
            head.push(name + depth_name(noise));
        }
    }
    let row = |name: &str, scene: Option<&str>| {
        let cells = study.methods.iter().flat_map(|method| {
            depths.iter().map(|&noise| number(median_angle(study, scene, method, noise), 1))
        });
        std::iter::once(escape(name)).chain(cells).collect::<Vec<_>>()
    };
    let mut rows: Vec<_> = study.scenes.iter().map(|s| row(s, Some(s))).collect();
    rows.push(row("all scenes", None));
    table(&head.iter().map(String::as_str).collect::<Vec<_>>(), &rows, 1)
}

/// Over all frames of all lights, of one scene or of all.
pub(in crate::report) fn median_angle(
    study: &LightStudy,
    scene: Option<&str>,
    method: &str,
    sensor_noise: bool,
) -> Option<f64> {
    median_of(study, scene, method, sensor_noise, |f| f.angle_deg)
}

pub(in crate::report) fn median_of(
    study: &LightStudy,
    scene: Option<&str>,
    method: &str,
    sensor_noise: bool,
    value: impl Fn(&crate::study::light::LightFrame) -> Option<f64>,
) -> Option<f64> {
    let of = |r: &&LightRun| {
        r.method == method
            && r.sensor_noise == sensor_noise
            && scene.is_none_or(|scene| r.scene == scene)
    };
    median(study.runs.iter().filter(of).flat_map(|r| r.frames.iter().filter_map(&value)))
}
