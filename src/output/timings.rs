//! `timings.csv`, `timings.json`, and the table in the rows of the paper (Gruber et al. 2015,
//! Tables 1 and 2). All times are wall-clock milliseconds.

use super::{LineWriter, OutputError, atomic_write};
use crate::math::Distribution;
use crate::pipeline::BackendRecord;
use crate::timing::{Stage, StageTimes};
use crate::tracking::TrackingState;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;
use std::time::Duration;

/// What is noted about one frame.
#[derive(Clone, Debug)]
pub struct FrameTiming {
    pub frame: usize,
    pub timestamp_s: f64,
    /// From asking for the frame to having its result, what lies between the stages included.
    pub duration: Duration,
    /// From the arrival of a camera's frame to the begin of its processing; recordings have none.
    pub age: Option<Duration>,
    pub stages: StageTimes,
    /// Camera centre in world axes.
    pub position_m: [f64; 3],
    pub state: TrackingState,
    /// Name of the settings that the frame was made with.
    pub setting: String,
}

/// One line a frame: `frame,timestamp,duration_ms,<stages>,x,y,z,state,age_ms,setting`, stages in
/// milliseconds; the age is empty for recordings.
#[derive(Debug)]
pub struct TimingsLog {
    lines: LineWriter,
}

impl TimingsLog {
    pub fn create(path: &Path) -> Result<Self, OutputError> {
        let mut lines = LineWriter::create(path)?;
        let stages = Stage::ALL.map(Stage::name).join(",");
        lines.push(&format!("frame,timestamp,duration_ms,{stages},x,y,z,state,age_ms,setting"))?;
        Ok(Self { lines })
    }

    pub fn push(&mut self, timing: &FrameTiming) -> Result<(), OutputError> {
        let FrameTiming { frame, timestamp_s, duration, stages, state, setting, .. } = timing;
        let [x, y, z] = timing.position_m;
        let stages = Stage::ALL.map(|s| format!("{:.4}", ms(stages.get(s)))).join(",");
        let age = timing.age.map_or(String::new(), |age| format!("{:.4}", ms(age)));
        self.lines.push(&format!(
            "{frame},{timestamp_s:.6},{:.4},{stages},{x:.6},{y:.6},{z:.6},{},{age},{}",
            ms(*duration),
            state_name(*state),
            csv_field(setting)
        ))
    }
}

/// Milliseconds. The median of an even count is the mean of the two in the middle; p95 and p99 are
/// the smallest values that 95 and 99 percent of the frames do not exceed. Of more than 4096 frames these three
/// are within 0.25 percent.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Quantiles {
    pub median_ms: f64,
    pub p95_ms: f64,
    pub p99_ms: f64,
    pub max_ms: f64,
}

/// Times of a run without its first frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TimingSummary {
    /// Frames measured, and those left out before them.
    pub frames: usize,
    pub warmup_frames: usize,
    /// 1 / median update, as in the paper.
    pub fps: f64,
    /// Sum of the stages of a frame.
    pub update: Quantiles,
    pub duration: Quantiles,
    /// From the arrival of a camera's frame to the begin of its processing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub age: Option<Quantiles>,
    #[serde(serialize_with = "by_name", deserialize_with = "from_names")]
    pub(super) stages: [Quantiles; Stage::ALL.len()],
    /// What computed; not in older files.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub backend: Option<BackendRecord>,
}

impl TimingSummary {
    pub fn stage(&self, stage: Stage) -> Quantiles {
        self.stages[stage as usize]
    }
}

impl Quantiles {
    /// `None` without a value.
    pub(super) fn of(values_ms: &Distribution) -> Option<Self> {
        Some(Self {
            median_ms: values_ms.median()?,
            p95_ms: values_ms.quantile(0.95)?,
            p99_ms: values_ms.quantile(0.99)?,
            max_ms: values_ms.largest()?,
        })
    }
}

pub fn write_timings_json(path: &Path, summary: &TimingSummary) -> Result<(), OutputError> {
    atomic_write(path, |w| {
        serde_json::to_writer_pretty(&mut *w, summary)?;
        writeln!(w)
    })
}

/// The paper's table as text: median milliseconds, a column for each named summary and, from the
/// second on, how many times faster it is than the first.
pub fn stage_table(columns: &[(&str, &TimingSummary)]) -> String {
    let mut rows = vec![
        Row::new("FPS", columns, |s| s.fps, |first, other| other / first),
        Row::new("Update", columns, |s| s.update.median_ms, |first, other| first / other),
    ];
    rows.extend(Stage::ALL.map(|stage| {
        let median = move |s: &TimingSummary| s.stage(stage).median_ms;
        Row::new(stage.name(), columns, median, |first, other| first / other)
    }));

    let widths: Vec<usize> = columns.iter().map(|(name, _)| name.chars().count().max(9)).collect();
    let mut table = format!("{:<11}", "");
    for (i, ((name, _), width)) in columns.iter().zip(&widths).enumerate() {
        let _ = write!(table, "  {name:>width$}"); // a String takes everything
        if i > 0 {
            table += "   faster";
        }
    }
    for row in rows {
        let _ = write!(table, "\n{:<11}", row.name);
        for ((value, ratio), width) in row.cells.iter().zip(&widths) {
            let _ = write!(table, "  {value:>width$.2}");
            match ratio {
                Some(ratio) if ratio.is_finite() => {
                    let _ = write!(table, "  {ratio:>6.2}x");
                }
                Some(_) => table += "        -",
                None => {}
            }
        }
    }
    table.push('\n');
    table
}

struct Row {
    name: &'static str,
    /// Value, and ratio to the first column in all columns but that.
    cells: Vec<(f64, Option<f64>)>,
}

impl Row {
    fn new(
        name: &'static str,
        columns: &[(&str, &TimingSummary)],
        value: impl Fn(&TimingSummary) -> f64,
        faster: impl Fn(f64, f64) -> f64,
    ) -> Self {
        let values: Vec<f64> = columns.iter().map(|(_, summary)| value(summary)).collect();
        let ratio = |i: usize| (i > 0).then(|| faster(values[0], values[i]));
        Self { name, cells: values.iter().enumerate().map(|(i, &v)| (v, ratio(i))).collect() }
    }
}

pub(super) fn ms(duration: Duration) -> f64 {
    duration.as_secs_f64() * 1e3
}

/// Quoted where commas, quotes or line ends would break the line (RFC 4180).
pub fn csv_field(text: &str) -> std::borrow::Cow<'_, str> {
    match text.contains([',', '"', '\n', '\r']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")).into(),
        false => text.into(),
    }
}

fn state_name(state: TrackingState) -> &'static str {
    match state {
        TrackingState::Init => "init",
        TrackingState::Tracking => "tracking",
        TrackingState::Degraded => "degraded",
        TrackingState::Lost => "lost",
        TrackingState::Relocalising => "relocalising",
    }
}

fn by_name<S: serde::Serializer>(
    stages: &[Quantiles; Stage::ALL.len()],
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.collect_map(Stage::ALL.map(Stage::name).iter().zip(stages))
}

/// Stages that are not known are passed over; one that is missing is an error.
fn from_names<'de, D: serde::Deserializer<'de>>(
    deserializer: D,
) -> Result<[Quantiles; Stage::ALL.len()], D::Error> {
    let named = BTreeMap::<String, Quantiles>::deserialize(deserializer)?;
    let mut stages = [Quantiles { median_ms: 0.0, p95_ms: 0.0, p99_ms: 0.0, max_ms: 0.0 }; _];
    for (quantiles, stage) in stages.iter_mut().zip(Stage::ALL) {
        let missing = || serde::de::Error::custom(format!("no stage '{}'", stage.name()));
        *quantiles = *named.get(stage.name()).ok_or_else(missing)?;
    }
    Ok(stages)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::TimingRecorder;

    /// Stage k of frame i takes (k + 1) (i + 1) ms, except for a slow first frame.
    fn timings(n: usize) -> Vec<FrameTiming> {
        (0..n)
            .map(|frame| {
                let mut stages = StageTimes::default();
                let slow = if frame == 0 { 1000 } else { 1 };
                for (k, stage) in Stage::ALL.into_iter().enumerate() {
                    let ms = slow * (k + 1) * (frame + 1);
                    stages.add(stage, Duration::from_millis(ms as u64));
                }
                FrameTiming {
                    frame,
                    timestamp_s: 0.5 * frame as f64,
                    duration: stages.update() + Duration::from_micros(500),
                    age: (frame > 0).then(|| Duration::from_millis(frame as u64)),
                    stages,
                    position_m: [0.1, -0.2, 1.5],
                    state: TrackingState::Tracking,
                    setting: "ours".to_owned(),
                }
            })
            .collect()
    }

    fn summary(timings: &[FrameTiming], warm_up: usize) -> TimingSummary {
        let mut recorder = TimingRecorder::new(warm_up);
        timings.iter().for_each(|timing| recorder.push(timing));
        recorder.summary().expect("there are frames")
    }

    #[test]
    fn csv_has_a_header_and_a_line_a_frame() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("timings.csv");
        let mut log = TimingsLog::create(&path).unwrap();
        for timing in &timings(2) {
            log.push(timing).unwrap();
        }
        let text = std::fs::read_to_string(&path).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            lines[0],
            "frame,timestamp,duration_ms,Input,Reconstruct,Surface,DynGeo,RadTransfer,LightEst,\
             Rendering,x,y,z,state,age_ms,setting"
        );
        assert_eq!(
            lines[2],
            "1,0.500000,56.5000,2.0000,4.0000,6.0000,8.0000,10.0000,12.0000,14.0000,\
             0.100000,-0.200000,1.500000,tracking,1.0000,ours"
        );
        assert!(lines[1].ends_with("tracking,,ours"), "a frame of a recording: {}", lines[1]);
        assert_eq!(lines.len(), 3);
    }

    #[test]
    fn fields_are_quoted_where_they_must() {
        assert_eq!(csv_field("step 4"), "step 4");
        assert_eq!(csv_field("step 4, \"32\""), "\"step 4, \"\"32\"\"\"");
        assert_eq!(csv_field("a\nb"), "\"a\nb\"");
    }

    #[test]
    fn warm_up_is_left_out_and_quantiles_are_those_of_the_rest() {
        // frames 1 to 100: Input takes 2 to 101 ms
        let of_hundred = summary(&timings(101), 1);
        assert_eq!((of_hundred.frames, of_hundred.warmup_frames), (100, 1));
        let input = of_hundred.stage(Stage::Input);
        let expected = Quantiles { median_ms: 51.5, p95_ms: 96.0, p99_ms: 100.0, max_ms: 101.0 };
        assert!(close(input, expected), "{input:?}");
        assert!((of_hundred.update.median_ms - 28.0 * 51.5).abs() < 1e-9);
        assert!((of_hundred.duration.median_ms - 28.0 * 51.5 - 0.5).abs() < 1e-9);
        assert!((of_hundred.fps - 1000.0 / (28.0 * 51.5)).abs() < 1e-12);
        let age = of_hundred.age.unwrap();
        assert!((age.median_ms, age.max_ms) == (50.5, 100.0), "{age:?}");
        assert!(summary(&timings(1), 0).age.is_none());
        let one = summary(&timings(1), 0).stage(Stage::Surface);
        assert_eq!((one.median_ms, one.p95_ms, one.max_ms), (3000.0, 3000.0, 3000.0));
    }

    fn close(a: Quantiles, b: Quantiles) -> bool {
        let list = |q: Quantiles| [q.median_ms, q.p95_ms, q.p99_ms, q.max_ms];
        list(a).iter().zip(list(b)).all(|(a, b)| (a - b).abs() < 1e-9)
    }

    #[test]
    fn state_names_are_those_of_other_files() {
        use TrackingState::*;
        for state in [Init, Tracking, Degraded, Lost, Relocalising] {
            assert_eq!(serde_json::to_value(state).unwrap(), state_name(state));
        }
    }

    #[test]
    fn json_names_the_stages_in_order() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("timings.json");
        write_timings_json(&path, &summary(&timings(4), 1)).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let value: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(value["stages"]["Surface"]["median_ms"], 9.0);
        assert_eq!(value["stages"]["Rendering"]["max_ms"], 28.0);
        assert_eq!(value["frames"], 3);
        let at = Stage::ALL.map(|s| text.find(&format!("\"{}\"", s.name())).unwrap());
        assert!(at.is_sorted());
        let back: TimingSummary = serde_json::from_str(&text).unwrap();
        let made = summary(&timings(4), 1);
        assert_eq!((back.frames, back.warmup_frames), (made.frames, made.warmup_frames));
        assert!(Stage::ALL.into_iter().all(|s| close(back.stage(s), made.stage(s))));
        assert!(close(back.update, made.update) && (back.fps - made.fps).abs() < 1e-9);
        let without = text.replace("\"DynGeo\"", "\"Dyn\"");
        let error = serde_json::from_str::<TimingSummary>(&without).unwrap_err().to_string();
        assert!(error.contains("DynGeo"), "{error}");
    }

    #[test]
    fn table_has_the_rows_of_the_paper() {
        let slow = summary(&timings(4), 1);
        let mut fast = slow.clone();
        fast.fps *= 4.0;
        fast.update.median_ms /= 4.0;
        fast.stages[Stage::Input as usize].median_ms = 0.0;
        let one = stage_table(&[("ours", &slow)]);
        assert_eq!(
            one.lines().nth(1).unwrap().split_whitespace().collect::<Vec<_>>(),
            ["FPS", "11.90"]
        );
        let two = stage_table(&[("ours", &slow), ("ours-fast", &fast)]);
        let cells: Vec<Vec<&str>> = two.lines().map(|l| l.split_whitespace().collect()).collect();
        assert_eq!(cells[0], ["ours", "ours-fast", "faster"]);
        assert_eq!(cells[1], ["FPS", "11.90", "47.62", "4.00x"]);
        assert_eq!(cells[2], ["Update", "84.00", "21.00", "4.00x"]);
        assert_eq!(cells[3], ["Input", "3.00", "0.00", "-"]);
        let names: Vec<&str> = cells[1..].iter().map(|c| c[0]).collect();
        let paper = "FPS Update Input Reconstruct Surface DynGeo RadTransfer LightEst Rendering";
        assert_eq!(names.join(" "), paper);
        let lengths: Vec<usize> = two.lines().map(|l| l.chars().count()).collect();
        assert!(lengths.iter().all(|&l| l == lengths[0]), "aligned:\n{two}");
    }
}
