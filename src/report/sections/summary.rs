//! The numbers to look at first.

use super::Section;
use super::composite::overall;
use super::light::{median_angle, median_of};
use crate::math::median;
use crate::report::markup::{escape, factor, listed, number, table, three_digits};
use crate::report::paper::{ROWS, TABLE_1};
use crate::report::sources::{Problem, Sources};
use crate::timing::Stage;

/// `unread`: pictures that other sections could not read.
pub(in crate::report) fn section(sources: &Sources, unread: &[Problem]) -> Section {
    let html = problems(sources, unread) + &tiles(sources) + &methods(sources) + &missing(sources);
    Section { id: "summary", title: "Summary", html }
}

fn problems(sources: &Sources, unread: &[Problem]) -> String {
    let all = sources.problems.iter().chain(unread);
    let items: String = all.map(|p| format!("<li>{}</li>", escape(&p.to_string()))).collect();
    if items.is_empty() {
        return items;
    }
    format!("<div class=\"problems\"><b>Files that could not be used</b><ul>{items}</ul></div>")
}

fn missing(sources: &Sources) -> String {
    let missing = sources.missing().into_iter();
    let words: Vec<String> =
        missing.map(|(what, command)| format!("{what} (<code>{command}</code>)")).collect();
    match words.is_empty() {
        true => String::new(),
        false => format!("<p class=\"note\">Not measured yet: {}.</p>", listed(&words)),
    }
}

/// A large number and what it is; both are HTML.
fn tile(value: &str, meaning: &str) -> String {
    format!("<div class=\"tile\"><strong>{value}</strong><span>{meaning}</span></div>")
}

fn tiles(sources: &Sources) -> String {
    let tiles: Vec<String> = [
        light_tile(sources),
        speed_tile(sources),
        transfer_tile(sources),
        composite_tile(sources),
        settle_tile(sources),
        run_light_tile(sources),
        tracking_tile(sources),
    ]
    .into_iter()
    .flatten()
    .take(5)
    .collect();
    format!("<div class=\"tiles\">{}</div>", tiles.concat())
}

/// The estimator with the smallest angle, the light probe of the reference aside.
fn light_tile(sources: &Sources) -> Option<String> {
    let study = &sources.light.first()?.record;
    let noise = study.runs.iter().any(|r| r.sensor_noise);
    let estimators = study.methods.iter().filter(|m| !is_reference(m));
    let angles = estimators.filter_map(|m| Some((median_angle(study, None, m, noise)?, m)));
    let (angle, method) = angles.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let depth = super::depth_name(noise);
    let exact = noise
        .then(|| median_angle(study, None, method, false))
        .flatten()
        .map(|angle| format!("; {}° with exact depth", number(angle, 1)))
        .unwrap_or_default();
    let method = escape(method);
    let meaning = format!("off the true light (median), {method} with {depth}{exact}");
    Some(tile(&format!("{}°", number(angle, 1)), &meaning))
}

fn speed_tile(sources: &Sources) -> Option<String> {
    let timed = || sources.runs.iter().filter_map(|r| Some((r, r.timings.as_ref()?)));
    let (run, timings) = timed().max_by(|a, b| a.1.fps.total_cmp(&b.1.fps))?;
    let (slow, slowest) = timed().min_by(|a, b| a.1.fps.total_cmp(&b.1.fps))?;
    let faster = match run.folder == slow.folder {
        true => String::new(),
        false => format!(", {} {}", factor(timings.fps / slowest.fps), escape(&slow.name)),
    };
    let meaning = format!(
        "{} ({} ms a frame){faster}",
        escape(&run.name),
        three_digits(timings.update.median_ms)
    );
    Some(tile(&format!("{} FPS", three_digits(timings.fps)), &meaning))
}

/// What 4x4 subsampling saves in the transfer: the paper's point.
fn transfer_tile(sources: &Sources) -> Option<String> {
    let transfer = |preset| {
        let timings = sources.timings_of(preset)?;
        Some(timings.stage(Stage::RadTransfer).median_ms)
    };
    let [_, ours, _, fast] = TABLE_1;
    let row = ROWS.iter().position(|name| *name == Stage::RadTransfer.name())?;
    let paper = ours.columns[0].values[row] / fast.columns[0].values[row];
    let here = transfer(ours.preset)? / transfer(fast.preset)?;
    let meaning =
        format!("faster transfer by 4\u{d7}4 subsampling (paper, on a GPU: {})", factor(paper));
    Some(tile(&factor(here), &meaning))
}

fn composite_tile(sources: &Sources) -> Option<String> {
    let study = &sources.composite.first()?.record;
    let plain = study.runs.iter().filter(|r| r.changes.is_empty());
    let errors = plain.filter_map(|run| {
        let of = |r: &crate::study::composite::CompositeRun| {
            r.changes.is_empty() && r.preset == run.preset && r.sensor_noise == run.sensor_noise
        };
        Some((overall(&study.runs, of, |f| f.changed_rmse)?, run))
    });
    let (error, run) = errors.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let (preset, depth) = (escape(&run.preset), super::depth_name(run.sensor_noise));
    let meaning = format!("error of the composed change of light, {preset} with {depth}");
    Some(tile(&number(error, 2), &meaning))
}

fn settle_tile(sources: &Sources) -> Option<String> {
    let steps = &sources.light.first()?.record.steps;
    let frames = median(steps.iter().filter_map(|s| s.settled_after).map(|n| n as f64))?;
    let settled = steps.iter().filter(|s| s.settled_after.is_some()).count();
    let meaning = format!(
        "until a switched lamp is estimated within 10 % (median; {settled} of {} settle)",
        steps.len()
    );
    Some(tile(&format!("{} frames", number(frames, 0)), &meaning))
}

/// Where no light study is there: the light error of a run.
fn run_light_tile(sources: &Sources) -> Option<String> {
    let with_light = sources.runs.iter().filter_map(|run| {
        let angle = run.summary.as_ref()?.pointer("/light_error/median_deg")?.as_f64()?;
        Some((angle, run))
    });
    let (angle, run) = with_light.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let meaning = format!("off the true light (median), {}", escape(&run.name));
    sources.light.is_empty().then(|| tile(&format!("{}°", number(angle, 1)), &meaning))
}

fn tracking_tile(sources: &Sources) -> Option<String> {
    let run = sources.runs.first()?;
    let share = run.summary.as_ref()?.pointer("/tracked_share")?.as_f64()?;
    let meaning = format!("of the frames tracked, {}", escape(&run.name));
    Some(tile(&format!("{} %", number(100.0 * share, 1)), &meaning))
}

fn is_reference(method: &str) -> bool {
    method.starts_with("reference")
}

/// One line a method, with what was measured of it anywhere.
fn methods(sources: &Sources) -> String {
    let names = method_names(sources);
    let columns = [
        column("angle, exact depth (°)", &names, 1, |m| angle(sources, m, false)),
        column("angle, sensor noise (°)", &names, 1, |m| angle(sources, m, true)),
        column("SH relative L2, exact", &names, 3, |m| coefficients(sources, m, false)),
        column("SH relative L2, noise", &names, 3, |m| coefficients(sources, m, true)),
        column("settles (frames)", &names, 0, |m| settles(sources, m)),
        column("jitter (° a frame)", &names, 3, |m| jitter(sources, m)),
        column("change RMSE, exact", &names, 3, |m| composite(sources, m, false)),
        column("change RMSE, noise", &names, 3, |m| composite(sources, m, true)),
        column("update (ms)", &names, 1, |m| Some(sources.timings_of(m)?.update.median_ms)),
        column("FPS", &names, 2, |m| Some(sources.timings_of(m)?.fps)),
    ];
    let shown: Vec<_> = columns.into_iter().flatten().collect();
    if names.is_empty() || shown.is_empty() {
        return String::new();
    }
    let mut head = vec!["Method"];
    head.extend(shown.iter().map(|(title, _)| *title));
    let rows: Vec<Vec<String>> = names
        .iter()
        .enumerate()
        .map(|(i, name)| {
            let cells = shown.iter().map(|(_, cells)| cells[i].clone());
            std::iter::once(escape(name)).chain(cells).collect()
        })
        .collect();
    table(&head, &rows, 1)
}

/// Title and cells; `None` where no method has a value.
fn column(
    title: &'static str,
    names: &[String],
    digits: usize,
    value: impl Fn(&str) -> Option<f64>,
) -> Option<(&'static str, Vec<String>)> {
    let values: Vec<Option<f64>> = names.iter().map(|name| value(name)).collect();
    let any = values.iter().any(Option::is_some);
    any.then(|| (title, values.into_iter().map(|v| number(v, digits)).collect()))
}

fn method_names(sources: &Sources) -> Vec<String> {
    let light = sources.light.iter().flat_map(|f| f.record.methods.clone());
    let runs = sources.runs.iter().filter(|r| r.timings.is_some()).map(|r| r.name.clone());
    let composite = sources.composite.iter().flat_map(|f| &f.record.runs);
    let composite = composite.filter(|r| r.changes.is_empty()).map(|r| r.preset.clone());
    let mut names: Vec<String> = Vec::new();
    for name in light.chain(runs).chain(composite) {
        if !names.contains(&name) {
            names.push(name);
        }
    }
    names
}

fn angle(sources: &Sources, method: &str, noise: bool) -> Option<f64> {
    median_angle(&sources.light.first()?.record, None, method, noise)
}

fn coefficients(sources: &Sources, method: &str, noise: bool) -> Option<f64> {
    let study = &sources.light.first()?.record;
    median_of(study, None, method, noise, |f| Some(f.relative_l2))
}

fn settles(sources: &Sources, method: &str) -> Option<f64> {
    let steps = &sources.light.first()?.record.steps;
    let own = steps.iter().filter(|s| s.method == method).filter_map(|s| s.settled_after);
    median(own.map(|frames| frames as f64))
}

fn jitter(sources: &Sources, method: &str) -> Option<f64> {
    let jitter = &sources.light.first()?.record.jitter;
    median(jitter.iter().filter(|j| j.method == method).map(|j| j.median_deg))
}

fn composite(sources: &Sources, method: &str, noise: bool) -> Option<f64> {
    let runs = &sources.composite.first()?.record.runs;
    let of = |r: &crate::study::composite::CompositeRun| {
        r.changes.is_empty() && r.preset == method && r.sensor_noise == noise
    };
    overall(runs, of, |f| f.changed_rmse)
}
