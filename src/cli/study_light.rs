//! `kinlight study light`.

use super::args::parse_size;
use super::{CliError, Talk, interrupt, setup};
use clap::{Args, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use kinlight::study::light::{self, LightPlan, LightStudy, Progress};
use kinlight::study::{SequenceStore, StudyError};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Light error of every preset: six scenes, four lights, with and without sensor noise.
///
/// Finished runs are kept in OUT/runs.jsonl: a study that was interrupted goes on where it stopped.
#[derive(Debug, Args)]
pub struct LightStudyArgs {
    /// Folder for everything that is written.
    #[arg(long, default_value = "out/study/light")]
    pub out: PathBuf,
    /// Folder of the made sequences; they are made once [default: OUT/sequences].
    #[arg(long, value_name = "DIR")]
    pub sequences: Option<PathBuf>,
    /// Built-in scenes, the richest last [default: all of the study].
    #[arg(long, value_delimiter = ',', value_name = "NAME,...")]
    pub scenes: Vec<String>,
    /// Lights on the half circle, 0 to 3 [default: all].
    #[arg(long, value_delimiter = ',', value_name = "N,...")]
    pub lights: Vec<usize>,
    /// Presets [default: those that the paper compares].
    #[arg(long, value_delimiter = ',', value_name = "NAME,...")]
    pub presets: Vec<String>,
    /// Which depth the runs see.
    #[arg(long, value_enum, default_value_t = Noise::Both)]
    pub noise: Noise,
    /// Frames of a run that count.
    #[arg(long, default_value_t = LightPlan::default().frames)]
    pub frames: usize,
    /// Frames before those.
    #[arg(long, default_value_t = LightPlan::default().warm_up)]
    pub warm_up: usize,
    /// Width and height in pixels.
    #[arg(long, value_name = "W,H", value_parser = parse_size, default_value = "640,480")]
    pub size: (usize, usize),
    /// Light paths a pixel of the made sequences.
    #[arg(long, default_value_t = LightPlan::default().samples)]
    pub samples: u32,
    /// Set one field of the settings of every preset (may be repeated).
    #[arg(long = "set", value_name = "FIELD=VALUE")]
    pub assignments: Vec<String>,
    /// Leave out some of the measurements.
    #[arg(long, value_enum, value_delimiter = ',')]
    pub without: Vec<Extra>,
    /// Worker threads; 0 takes one a core.
    #[arg(long, default_value_t = 0)]
    pub threads: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Noise {
    /// Depth as it truly is.
    Exact,
    /// Depth as a Kinect v1 would give it.
    Kinect,
    Both,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Extra {
    /// Frames that the light takes after the lamp was switched.
    Steps,
    /// Movement of the light where nothing moves.
    Jitter,
}

impl LightStudyArgs {
    fn plan(&self) -> LightPlan {
        fn or<T: Clone>(given: &[T], default: Vec<T>) -> Vec<T> {
            if given.is_empty() { default } else { given.to_vec() }
        }
        let whole = LightPlan::default();
        LightPlan {
            scenes: or(&self.scenes, whole.scenes),
            lights: or(&self.lights, whole.lights),
            presets: or(&self.presets, whole.presets),
            assignments: self.assignments.clone(),
            exact: self.noise != Noise::Kinect,
            kinect: self.noise != Noise::Exact,
            frames: self.frames,
            warm_up: self.warm_up,
            width: self.size.0,
            height: self.size.1,
            samples: self.samples,
            steps: !self.without.contains(&Extra::Steps),
            jitter: !self.without.contains(&Extra::Jitter),
        }
    }
}

pub fn run(args: &LightStudyArgs, talk: Talk) -> Result<(), CliError> {
    // What single frames have to tell is too much for hundreds of runs, unless it was asked for.
    if log::max_level() == log::LevelFilter::Info {
        log::set_max_level(log::LevelFilter::Warn);
    }
    setup::start_threads(args.threads)?;
    let sequences = args.sequences.clone().unwrap_or_else(|| args.out.join("sequences"));
    let store = SequenceStore::new(sequences);
    let command = std::env::args().collect::<Vec<_>>().join(" ");
    let bar = bar(talk);
    let stop = interrupt::stop_on_interrupt()?;
    let study = light::run(&args.plan(), &command, &store, &args.out, &stop, &|p| show(&bar, p));
    bar.finish_and_clear();
    let study = study.map_err(|error| to_be_continued(error, &args.out))?;
    light::write(&study, &args.out)?;
    talk.say(light::summary(&study));
    talk.say(format_args!("written to {}", args.out.display()));
    talk.result(&result(&study, args));
    Ok(())
}

/// Of a study that keeps the runs it has finished.
pub fn to_be_continued(error: StudyError, out: &Path) -> CliError {
    match CliError::from(error) {
        CliError::Interrupted { problem, has_result } => {
            let out = out.display();
            let problem =
                format!("{problem}: finished runs are kept in {out}, and the same command goes on");
            CliError::Interrupted { problem, has_result }
        }
        other => other,
    }
}

/// Per mille of the work.
const BAR_LENGTH: u64 = 1000;

fn bar(talk: Talk) -> ProgressBar {
    let bar = talk.progress(BAR_LENGTH as usize);
    let style = ProgressStyle::with_template("{wide_bar} {percent} % {msg}");
    bar.set_style(style.expect("the template is a constant"));
    bar
}

fn show(bar: &ProgressBar, progress: &Progress) {
    let minutes = (progress.left_s / 60.0).ceil();
    if bar.message().is_empty() && progress.left_s > 0.0 {
        bar.println(format!("about {minutes} min of work, to be known better soon"));
    }
    bar.set_position((progress.share * BAR_LENGTH as f64) as u64);
    bar.set_message(format!("{minutes} min left: {}", progress.doing));
}

fn result(study: &LightStudy, args: &LightStudyArgs) -> serde_json::Value {
    let runs = study.runs.iter().map(|run| {
        json!({
            "scene": run.scene,
            "light": run.light,
            "sensor_noise": run.sensor_noise,
            "method": run.method,
            "median_deg": run.median_deg(),
            "median_relative_l2": run.median_relative_l2(),
            "frames": run.frames.len(),
            "invalid": run.invalid,
            "update_ms": run.stage_ms.get("Update"),
        })
    });
    let steps = study.steps.iter().map(|step| {
        json!({
            "scene": step.scene,
            "sensor_noise": step.sensor_noise,
            "method": step.method,
            "settled_after": step.settled_after,
        })
    });
    json!({
        "out": args.out,
        "runs": runs.collect::<Vec<_>>(),
        "steps": steps.collect::<Vec<_>>(),
        "jitter": study.jitter,
    })
}
