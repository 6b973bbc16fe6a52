//! From arguments to settings, sequence, threads and log.

use super::CliError;
use super::args::{ComputeArgs, FrameRange, Poses, ReadingArgs, SettingsArgs, SourceArgs};
use super::backend::Device;
use kinlight::budget::{Governor, Ladder, Profile};
use kinlight::capture::{CaptureOptions, Sequence, open_sequence};
use kinlight::config::{Settings, SettingsError};
use kinlight::tracking::PoseMode;
use std::path::Path;

pub fn start_logging(verbose: u8) {
    let level = match verbose {
        0 => log::LevelFilter::Info,
        1 => log::LevelFilter::Debug,
        _ => log::LevelFilter::Trace,
    };
    env_logger::Builder::new()
        .filter_level(log::LevelFilter::Warn)
        .filter_module("kinlight", level)
        // to it, a machine without a device is an error; what follows from that is said here
        .filter_module(
            "wgpu_hal::vulkan::instance",
            if verbose == 0 { log::LevelFilter::Off } else { log::LevelFilter::Warn },
        )
        .format_timestamp(None)
        .format_target(false)
        .init();
}

/// Preset, then file, then single fields, then the flags that are short for a field.
pub fn settings(preset: &str, changes: &SettingsArgs) -> Result<Settings, CliError> {
    let usage = |e: SettingsError| CliError::Usage(e.to_string());
    let mut settings = Settings::preset(preset).map_err(usage)?;
    adjust(&mut settings, changes).map_err(usage)?;
    settings.validate().map_err(usage)?;
    Ok(settings)
}

/// What the user asks for on top of a preset or of a step of a profile.
fn adjust(settings: &mut Settings, changes: &SettingsArgs) -> Result<(), SettingsError> {
    if let Some(file) = &changes.settings {
        settings.merge_file(file)?;
    }
    for assignment in &changes.assignments {
        settings.assign(assignment)?;
    }
    if let Some(poses) = changes.poses {
        settings.tracking.mode = match poses {
            Poses::Track => PoseMode::Track,
            Poses::Recorded => PoseMode::Recorded,
            Poses::Static => PoseMode::Static,
        };
    }
    if let Some(seed) = changes.seed {
        settings.transfer.seed = seed;
    }
    Ok(())
}

/// What keeps the run's budget, where it has one. After [`start_threads`]: profiles name the number of
/// threads.
pub fn governor(run: &ComputeArgs, device: &Device) -> Result<Option<Governor>, CliError> {
    let Some(budget) = run.budget else { return Ok(None) };
    let usage = |e: kinlight::budget::BudgetError| CliError::Usage(e.to_string());
    let profile = Profile::find(run.profile.as_deref(), device.backend()).map_err(usage)?;
    let ladder = Ladder::choose(&profile, budget, &|settings| adjust(settings, &run.changes));
    Ok(Some(Governor::new(ladder.map_err(usage)?, budget)))
}

pub fn capture_options(reading: &ReadingArgs) -> CaptureOptions {
    CaptureOptions {
        calibration: reading.calibration.clone(),
        depth_factor: reading.depth_factor,
        depth_list: reading.depth_list.clone(),
        follow_links: reading.follow_links,
        max_time_difference_s: reading.max_time_difference,
        ..CaptureOptions::default()
    }
}

pub fn open(source: &SourceArgs) -> Result<Sequence, CliError> {
    open_recording(&source.sequence, &source.reading, source.frames)
}

pub fn open_recording(
    folder: &Path,
    reading: &ReadingArgs,
    frames: Option<FrameRange>,
) -> Result<Sequence, CliError> {
    let mut options = capture_options(reading);
    if let Some(range) = frames {
        options.first_frame = range.first;
        options.end_frame = range.end;
    }
    let sequence =
        open_sequence(folder, &options).map_err(|e| CliError::Sequence(explain(folder, e)))?;
    for warning in &sequence.info().warnings {
        log::warn!("{warning}");
    }
    Ok(sequence)
}

fn explain(path: &Path, error: kinlight::capture::CaptureError) -> String {
    if path == Path::new("sequences/demo") && !path.exists() {
        return "sequences/demo is not here: run from the project's folder, or name a sequence"
            .into();
    }
    error.to_string()
}

/// Rayon's pool of this size; 0 takes one thread a core.
pub fn start_threads(threads: usize) -> Result<(), CliError> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build_global()
        .map_err(|e| CliError::Run(format!("threads: {e}")))
}
