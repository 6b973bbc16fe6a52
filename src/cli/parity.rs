//! `kinlight parity`: whether the backends agree.

use super::args::{SettingsArgs, SourceArgs};
use super::{CliError, Talk, objects, setup};
use clap::Args;
use kinlight::capture::FrameSource;
use kinlight::gpu::{AdapterChoice, Gpu};
use kinlight::output::atomic_write;
use kinlight::parity::{ParityError, Report, compare};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Run the CPU and the GPU backend over the same frames and say how far apart they are, stage by stage; fails
/// where that is more than rounding explains.
#[derive(Debug, Args)]
pub struct ParityArgs {
    #[command(flatten)]
    source: SourceArgs,
    #[command(flatten)]
    changes: SettingsArgs,
    /// Named settings to start from.
    #[arg(long, default_value = "ours-fast")]
    preset: String,
    /// Compare with the graphics device whose name or driver contains this.
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
    /// Frames at which each stage is compared alone, spread over all from the first to the last.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..))]
    stage_frames: u32,
    /// Folder for parity.json.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Worker threads; 0 takes one a core.
    #[arg(long, default_value_t = 0)]
    threads: usize,
}

pub fn run(args: &ParityArgs, talk: Talk) -> Result<(), CliError> {
    setup::start_threads(args.threads)?;
    // both pipelines, and trackers on their own, would say the same of each frame
    if log::max_level() == log::LevelFilter::Info {
        log::set_max_level(log::LevelFilter::Warn);
    }
    let settings = setup::settings(&args.preset, &args.changes)?;
    let choice = args.adapter.clone().map_or(AdapterChoice::Best, AdapterChoice::Named);
    let gpu = Gpu::open(&choice).map_err(|e| CliError::Usage(e.to_string()))?;
    let mut source = setup::open(&args.source)?;
    let first = args.source.frames.map_or(0, |frames| frames.first);
    let scene = objects::scene(&args.source.object, Some(&args.source.sequence), first, &source)?;

    let bar = talk.progress(source.len().unwrap_or(0));
    bar.set_prefix("parity");
    let count = args.stage_frames as usize;
    let report =
        compare(&Arc::new(gpu), &settings, &scene, &mut source, count, &mut |_| bar.inc(1));
    bar.finish_and_clear();
    let report = report?;

    let mut result = json!(report);
    result["sequence"] = json!(args.source.sequence);
    result["preset"] = json!(args.preset);
    if let Some(folder) = &args.out {
        write(&folder.join("parity.json"), &result)?;
    }
    talk.say(format_args!("{}, preset {}", args.source.sequence.display(), args.preset));
    talk.say(&report);
    talk.result(&result);
    verdict(&report)
}

fn write(path: &Path, result: &serde_json::Value) -> Result<(), CliError> {
    atomic_write(path, |to| writeln!(to, "{result:#}")).map_err(|e| CliError::Output(e.to_string()))
}

/// An error where something is out of tolerance.
fn verdict(report: &Report) -> Result<(), CliError> {
    match report.beyond() {
        beyond if beyond.is_empty() => Ok(()),
        beyond => Err(CliError::Differ(format!("out of tolerance: {}", beyond.join(", ")))),
    }
}

impl From<ParityError> for CliError {
    fn from(error: ParityError) -> Self {
        let text = error.to_string();
        match error {
            ParityError::Capture(_) | ParityError::NoFrames => Self::Sequence(text),
            _ => Self::Run(text),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinlight::parity::tolerances::{COMPOSITING, INPUT_DEPTH};
    use kinlight::parity::{Ledger, Row};

    fn report(on_gpu: f32) -> Report {
        let mut ledger = Ledger::new(true);
        ledger.compare(&INPUT_DEPTH, 0, &[1.5], &[on_gpu]);
        let stages: Vec<_> =
            [&INPUT_DEPTH, &COMPOSITING].map(|tolerance| Row::new(tolerance, &ledger)).into();
        Report {
            adapter: "none".into(),
            software: true,
            frames: 1,
            stage_frames: vec![0],
            within: on_gpu == 1.5,
            stages,
            run: Vec::new(),
        }
    }

    #[test]
    fn what_is_out_of_tolerance_is_named_and_fails() {
        assert!(verdict(&report(1.5)).is_ok());
        for other in [1.6, f32::NAN] {
            let report = report(other);
            let error = verdict(&report).unwrap_err();
            assert_eq!((error.exit_code(), error.has_result()), (1, true));
            assert!(error.to_string().ends_with(": input depth"), "{error}");
            assert!(report.to_string().contains("BEYOND") && !report.within);
        }
    }
}
