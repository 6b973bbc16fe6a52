//! `kinlight record`: what a camera gives, as a recording.

use super::live::{Camera, DeviceArgs, Rate};
use super::{CliError, Talk};
use clap::Args;
use kinlight::capture::live::DeviceInfo;
use kinlight::capture::writer::{
    ColorFormat, DEPTH_SCALE, DepthFormat, DepthLoss, Recorder, TumOptions, TumWriter,
};
use kinlight::capture::{CaptureError, FrameSource};
use serde_json::json;
use std::path::PathBuf;

/// Record a camera into a folder in the TUM layout, without loss, until Ctrl-C.
///
/// Whatever ends the program, the folder is a recording of all but the last second.
#[derive(Debug, Args)]
pub struct RecordArgs {
    #[command(flatten)]
    device: DeviceArgs,
    /// Folder for the recording.
    #[arg(long)]
    out: PathBuf,
    #[command(flatten)]
    depth: DepthArgs,
}

/// How depth is written; for record and convert.
#[derive(Debug, Args)]
pub struct DepthArgs {
    /// 16-bit depth steps a metre. 5000, as in TUM recordings, is exact for millimetres and ends at
    /// 13.1 m; 1000 ends at 65.5 m.
    #[arg(long, value_name = "STEPS", default_value_t = DEPTH_SCALE, value_parser = parse_steps)]
    depth_steps: f32,
}

impl DepthArgs {
    pub fn format(&self) -> DepthFormat {
        DepthFormat { steps_per_m: self.depth_steps, ..DepthFormat::default() }
    }

    /// Says what these steps have changed.
    pub fn tell(&self, loss: &DepthLoss) {
        let steps = self.depth_steps;
        if loss.rounded > 0 {
            let (pixels, most_mm) = (loss.rounded, loss.most_m * 1e3);
            log::warn!(
                "{pixels} depth pixels lie between {steps} steps a metre: moved by at most {most_mm:.3} mm"
            );
        }
        if loss.beyond > 0 {
            let (pixels, end_m) = (loss.beyond, f32::from(u16::MAX) / steps);
            log::warn!(
                "{pixels} depth pixels beyond {end_m:.1} m are missing now: take fewer --depth-steps"
            );
        }
    }
}

fn parse_steps(text: &str) -> Result<f32, String> {
    let steps: f32 = text.parse().map_err(|_| format!("'{text}' is no number"))?;
    match steps.is_finite() && steps >= 1.0 {
        true => Ok(steps),
        false => Err("at least 1 step a metre is needed".into()),
    }
}

/// Frames that may wait while the recorder takes the last one.
const QUEUE: usize = 8;

/// More do not help: a camera gives 30 frames a second, an encoder takes some 20 ms for one.
const MOST_ENCODERS: usize = 4;

pub fn run(args: &RecordArgs, talk: Talk) -> Result<(), CliError> {
    let mut camera = args.device.open(QUEUE)?;
    let options = TumOptions {
        camera: camera.source.camera(),
        color: ColorFormat::Png,
        depth: args.depth.format(),
        calibration: Some(described(camera.source.info())),
    };
    let writer = TumWriter::start(&args.out, &options).map_err(unwritable)?;
    let mut recorder = Recorder::new(writer, encoders()).map_err(unwritable)?;
    let ended = record(&mut camera, &mut recorder, args.device.every_frame, talk)?;
    let (writer, counts) = recorder.finish().map_err(unwritable)?;
    let loss = writer.loss();
    let frames = writer.finish().map_err(unwritable)?;
    let live = camera.source.live();
    drop(camera);
    args.depth.tell(&loss);
    if let Some(error) = ended {
        return Err(CliError::Device(format!("{error}; {frames} frames are recorded")));
    }
    if frames == 0 {
        return Err(CliError::Device("the camera gave no frame".into()));
    }
    if let Some(live) = &live {
        talk.say(format_args!("camera: {}", live.counts));
    }
    let (dropped, out) = (counts.dropped, args.out.display());
    talk.say(format_args!("{frames} frames written to {out}, {dropped} dropped while writing"));
    talk.result(&json!({
        "out": args.out,
        "frames": frames,
        "dropped_writing": dropped,
        "depth_loss": loss,
        "live": live,
    }));
    Ok(())
}

/// Until the camera's end, which may be an error, or an error in writing.
fn record(
    camera: &mut Camera,
    recorder: &mut Recorder,
    every_frame: bool,
    talk: Talk,
) -> Result<Option<CaptureError>, CliError> {
    let (bar, monitor, mut rate) = (talk.status(), camera.source.monitor(), Rate::default());
    loop {
        let frame = match camera.source.next_frame() {
            Ok(Some(frame)) => frame,
            ended => {
                bar.finish_and_clear();
                return Ok(ended.err());
            }
        };
        let taken = if every_frame { recorder.push(frame) } else { recorder.offer(frame) };
        taken.map_err(unwritable)?;
        rate.tick();
        let (counts, written) = (monitor.counts(), recorder.counts());
        bar.set_message(format!(
            "{:.1} FPS  {} frames written, {} dropped, {} bad{}",
            rate.per_second(),
            written.written,
            counts.dropped + written.dropped,
            counts.bad,
            if monitor.is_down() { "  no camera" } else { "" },
        ));
    }
}

/// Threads that encode pictures.
pub fn encoders() -> usize {
    std::thread::available_parallelism().map_or(1, |n| n.get().min(MOST_ENCODERS))
}

/// Name and notes of the calibration file.
fn described(info: &DeviceInfo) -> (String, String) {
    let name = format!("{} {}", info.vendor, info.name).trim().to_owned();
    let notes = [&info.modes[..], &info.notes[..]].concat().join("; ");
    (name, format!("recorded from {}; {notes}", info.uri))
}

pub fn unwritable(error: CaptureError) -> CliError {
    CliError::Output(error.to_string())
}
