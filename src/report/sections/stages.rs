//! Where the time goes, and the frames that came out.

use super::slider::{Choice, slider};
use super::{Section, figure};
use crate::report::figures::{BarScale, stage_bars};
use crate::report::markup::{escape, number, table, three_digits};
use crate::report::paper::{TABLE_1, measured};
use crate::report::pictures::Pictures;
use crate::report::sources::{RunFolder, Sources};
use crate::timing::Stage;

const SHARE_CAPTION: &str = "The same as shares of the sum, with Table 1 of the paper for comparison \
    (a GPU of 2013): milliseconds of two machines say little, shares say which stage rules.";

type Row<'a> = (&'a str, [f64; Stage::ALL.len()]);

/// `None` where there is no run.
pub(in crate::report) fn section(sources: &Sources, pictures: &mut Pictures) -> Option<Section> {
    if sources.runs.is_empty() {
        return None;
    }
    let mut html = String::new();
    let own: Vec<Row> = sources
        .runs
        .iter()
        .filter_map(|run| Some((run.name.as_str(), stages(measured(run.timings.as_ref()?)))))
        .collect();
    if !own.is_empty() {
        html += &figure(
            &stage_bars(&own, BarScale::Milliseconds),
            "Median time of each stage of a frame. The length of a bar is the sum of its stages.",
        );
        html += &figure(&stage_bars(&shares(&own), BarScale::Percent), SHARE_CAPTION);
    }
    html += &run_table(&sources.runs);
    html += &frames(sources, pictures);
    Some(Section { id: "stages", title: "Where the time goes", html })
}

fn stages(values: [f64; 2 + Stage::ALL.len()]) -> [f64; Stage::ALL.len()] {
    std::array::from_fn(|i| values[i + 2])
}

/// The runs, and the paper's methods for comparison.
fn shares<'a>(own: &[Row<'a>]) -> Vec<Row<'a>> {
    const PAPER_NAMES: [&str; 4] = ["paper: GR12", "paper: Ours", "paper: GR14", "paper: OursFast"];
    let paper = TABLE_1.iter().zip(PAPER_NAMES);
    let paper = paper.map(|(method, name)| (name, stages(method.columns[0].values)));
    own.iter().copied().chain(paper).collect()
}

fn run_table(runs: &[RunFolder]) -> String {
    let rows: Vec<Vec<String>> = runs.iter().map(run_row).collect();
    let head = [
        "Run",
        "recording",
        "frames",
        "FPS",
        "update median (ms)",
        "p95",
        "p99",
        "max",
        "tracked (%)",
        "ATE RMSE (cm)",
        "light off by (°)",
        "volume (MiB)",
    ];
    table(&head, &rows, 2)
}

fn run_row(run: &RunFolder) -> Vec<String> {
    let timings = run.timings.as_ref();
    let value = |pointer: &str| run.summary.as_ref().and_then(|s| s.pointer(pointer)?.as_f64());
    let update =
        |pick: fn(&crate::output::Quantiles) -> f64| three_digits(timings.map(|t| pick(&t.update)));
    let sequence = run.made_by.as_ref().map_or("–", |m| m.sequence.as_str());
    vec![
        escape(&run.name),
        escape(sequence),
        number(value("/frames").or(timings.map(|t| t.frames as f64)), 0),
        three_digits(timings.map(|t| t.fps)),
        update(|q| q.median_ms),
        update(|q| q.p95_ms),
        update(|q| q.p99_ms),
        update(|q| q.max_ms),
        number(value("/tracked_share").map(|v| 100.0 * v), 1),
        number(value("/absolute_error/translation_m/rmse").map(|v| 100.0 * v), 2),
        number(value("/light_error/median_deg"), 1),
        number(value("/volume_bytes").map(|v| v / f64::from(1 << 20)), 0),
    ]
}

/// Shares of a recording after which a frame is shown.
const MOMENTS: [f64; 2] = [0.3, 0.7];
const FRAME_WIDTH: u32 = 640;

/// Composed frames of the runs at a few moments, side by side where there are several runs of one
/// recording.
fn frames(sources: &Sources, pictures: &mut Pictures) -> String {
    let with_frames: Vec<&RunFolder> =
        sources.runs.iter().filter(|r| !r.frames.is_empty()).collect();
    let Some(first) = with_frames.first() else { return String::new() };
    let sequence = |run: &RunFolder| run.made_by.as_ref().map(|m| m.sequence.clone());
    let mut html = String::new();
    for moment in MOMENTS {
        let index = (moment * first.frames.len() as f64) as usize;
        let Some(frame) = first.frames.get(index).and_then(|p| p.file_name()) else { continue };
        let choices: Vec<Choice> = with_frames
            .iter()
            .filter(|run| sequence(run) == sequence(first))
            .filter_map(|run| {
                let path = run.frames.iter().find(|p| p.file_name() == Some(frame))?;
                let picture = pictures.read(path, FRAME_WIDTH)?;
                Choice::new(&run.name, &picture)
            })
            .collect();
        let caption = format!("Frame {}", frame.to_string_lossy().trim_end_matches(".png"));
        html += &slider(&caption, &choices, (0, 1), pictures);
    }
    match html.is_empty() {
        true => html,
        false => format!("<h3>Composed frames</h3><div class=\"pictures\">{html}</div>"),
    }
}
