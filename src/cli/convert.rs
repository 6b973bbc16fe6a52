//! `kinlight convert`: a recording in another layout.

use super::args::{FrameRange, ReadingArgs, parse_frames};
use super::record::{DepthArgs, encoders, unwritable};
use super::{CliError, Talk, interrupt, setup};
use clap::{Args, ValueEnum};
use kinlight::capture::writer::{ColorFormat, Recorder, TumOptions, TumWriter};
use kinlight::capture::{FrameSource, Sequence};
use serde_json::json;
use std::path::PathBuf;

/// Write a recording of any layout that is read as one of another.
///
/// Frames are written as they are read: undistorted, depth registered to colour. Poses become
/// groundtruth.txt, one a frame.
#[derive(Debug, Args)]
pub struct ConvertArgs {
    /// Folder of the recording.
    sequence: PathBuf,
    /// Folder to write.
    out: PathBuf,
    /// Layout to write.
    #[arg(long, value_enum, default_value_t = Target::Tum)]
    to: Target,
    #[command(flatten)]
    reading: ReadingArgs,
    /// Frames to convert, counted from 0; B is not included (A.. and ..B work too).
    #[arg(long, value_name = "A..B", value_parser = parse_frames)]
    frames: Option<FrameRange>,
    #[command(flatten)]
    depth: DepthArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Target {
    /// TUM RGB-D benchmark: rgb/, depth/, lists, groundtruth.txt, calibration.toml.
    Tum,
}

pub fn run(args: &ConvertArgs, talk: Talk) -> Result<(), CliError> {
    let mut source = setup::open_recording(&args.sequence, &args.reading, args.frames)?;
    let options = TumOptions {
        camera: source.camera(),
        color: ColorFormat::Png,
        depth: args.depth.format(),
        calibration: Some(described(&source)),
    };
    let writer = match args.to {
        Target::Tum => TumWriter::start(&args.out, &options).map_err(unwritable)?,
    };
    let mut recorder = Recorder::new(writer, encoders()).map_err(unwritable)?;
    let bar = talk.progress(source.len().unwrap_or(0));
    let mut poses = 0;
    let stop = interrupt::stop_on_interrupt()?;
    while !stop.is_asked() {
        let read = source.next_frame().map_err(|e| CliError::Sequence(e.to_string()))?;
        let Some(frame) = read else { break };
        poses += usize::from(frame.world_from_camera.is_some());
        recorder.push(frame).map_err(unwritable)?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    let (writer, _) = recorder.finish().map_err(unwritable)?;
    let loss = writer.loss();
    let frames = writer.finish().map_err(unwritable)?;
    args.depth.tell(&loss);
    let (skipped, out) = (source.skipped(), args.out.display());
    talk.say(format_args!(
        "{frames} frames ({poses} with pose) written to {out}, {} skipped",
        skipped.len()
    ));
    talk.result(&json!({
        "out": args.out,
        "frames": frames,
        "poses": poses,
        "skipped": skipped,
        "depth_loss": loss,
    }));
    if stop.is_asked() {
        let problem = format!("interrupted: {out} holds the {frames} frames until then");
        return Err(CliError::Interrupted { problem, has_result: true });
    }
    Ok(())
}

/// Name and notes of the calibration file.
fn described(source: &Sequence) -> (String, String) {
    let info = source.info();
    let mut notes = format!("converted from {} (layout {})", info.folder.display(), info.layout);
    if info.undistorted {
        notes += "; undistorted";
    }
    if !info.registered {
        notes += "; depth registered to colour";
    }
    (info.camera_from.clone(), notes)
}
