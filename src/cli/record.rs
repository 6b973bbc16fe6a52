//! `kinlight record`: what a camera gives, as a recording.

use super::live::{Camera, DeviceArgs, Rate};
use super::{CliError, Talk};
use clap::Args;
use kinlight::capture::live::{DeviceInfo, LiveSummary};
use kinlight::capture::openni::{OniFiles, OniOptions, OniSource};
use kinlight::capture::writer::{
    ColorFormat, DEPTH_SCALE, DepthFormat, DepthLoss, Recorder, TumOptions, TumWriter,
};
use kinlight::capture::{CaptureError, FrameSource, RawFrame};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Record a camera into a folder in the TUM layout, without loss, or into a .oni file, until Ctrl-C.
///
/// Whatever ends the program, the folder is a recording of all but the last second. A .oni file gets its
/// index only at the end: where the program is killed, nothing can play it.
#[derive(Debug, Args)]
pub struct RecordArgs {
    #[command(flatten)]
    device: DeviceArgs,
    /// Folder for the recording; a name that ends with .oni: a file, which OpenNI2's own recorder writes, as
    /// with --oni.
    #[arg(long, value_name = "FOLDER|FILE.oni")]
    out: PathBuf,
    /// Also record to this file, as the sensor gives it, before any registration by calibration. A sensor that is
    /// lost and opened again continues in FILE-2.oni.
    #[arg(long, value_name = "FILE.oni")]
    oni: Option<PathBuf>,
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

/// OpenNI2 may have much to write before a .oni file is whole; Ctrl-C a second time ends the wait.
const CLOSE_ONI: Duration = Duration::from_secs(60);

pub fn run(args: &RecordArgs, talk: Talk) -> Result<(), CliError> {
    let Targets { folder, oni } = args.targets()?;
    let mut camera = match &oni {
        Some(files) => args.device.open_recording(QUEUE, files, CLOSE_ONI)?,
        None => args.device.open(QUEUE)?,
    };
    let mut sink = match folder {
        Some(folder) => Sink::Folder(Box::new(args.recorder(folder, &camera)?)),
        None => Sink::Nowhere { frames: 0 },
    };
    let ended = record(&mut camera, &mut sink, args.device.every_frame, talk)?;
    let written = sink.finish().map_err(unwritable)?;
    let live = camera.source.live();
    // The .oni file is whole only now.
    drop(camera);
    let files = oni.map_or_else(Vec::new, |files| args.read_back(&files));
    if let Some(loss) = &written.loss {
        args.depth.tell(loss);
    }
    let Written { frames, .. } = written;
    if let Some(error) = ended {
        return Err(CliError::Device(format!("{error}; {frames} frames are recorded")));
    }
    if frames == 0 {
        return Err(CliError::Device("the camera gave no frame".into()));
    }
    tell(&args.out, &written, &files, live, talk);
    Ok(())
}

/// What is written.
struct Targets<'a> {
    folder: Option<&'a Path>,
    oni: Option<OniFiles>,
}

impl RecordArgs {
    fn targets(&self) -> Result<Targets<'_>, CliError> {
        let is_file = self.out.extension().is_some_and(|e| e.eq_ignore_ascii_case("oni"));
        let (folder, file) = match (is_file, &self.oni) {
            (true, Some(_)) => {
                let out = self.out.display();
                return Err(CliError::Usage(format!(
                    "--oni goes with a folder, and --out {out} is a file"
                )));
            }
            (true, None) => (None, Some(&self.out)),
            (false, file) => (Some(&*self.out), file.as_ref()),
        };
        let Some(file) = file else { return Ok(Targets { folder, oni: None }) };
        let name = file.display();
        if !self.device.is_openni() {
            return Err(CliError::Usage(format!(
                "{name}: only OpenNI2's sensors can be recorded to a .oni file, not --device {}",
                self.device.device
            )));
        }
        if file.exists() {
            return Err(CliError::Output(format!(
                "{name} is there already: remove it, or choose another name"
            )));
        }
        // OpenNI2 would only say that it cannot.
        let parent = file.parent().filter(|p| !p.as_os_str().is_empty());
        if let Some(parent) = parent {
            std::fs::create_dir_all(parent)
                .map_err(|error| CliError::Output(format!("{}: {error}", parent.display())))?;
        }
        Ok(Targets { folder, oni: Some(OniFiles::new(file)) })
    }

    fn recorder(&self, folder: &Path, camera: &Camera) -> Result<Recorder, CliError> {
        let options = TumOptions {
            camera: camera.source.camera(),
            color: ColorFormat::Png,
            depth: self.depth.format(),
            calibration: Some(described(camera.source.info())),
        };
        let writer = TumWriter::start(folder, &options).map_err(unwritable)?;
        Recorder::new(writer, encoders()).map_err(unwritable)
    }

    /// Opens each file: what it holds is what its index says.
    fn read_back(&self, files: &OniFiles) -> Vec<serde_json::Value> {
        let calibration = self.device.sensor.calibration.clone();
        let options = OniOptions { calibration, ..OniOptions::default() };
        let look = |file: &PathBuf| match OniSource::open(file, &options) {
            Ok(source) => {
                let [depth, color] = source.info().counts;
                json!({ "file": file, "depth_frames": depth, "color_frames": color })
            }
            Err(error) => {
                log::error!("what was recorded does not open: {error}");
                json!({ "file": file, "error": error.to_string() })
            }
        };
        files.begun().iter().map(look).collect()
    }
}

/// Where frames go.
enum Sink {
    Folder(Box<Recorder>),
    /// OpenNI2 records by itself while frames are taken.
    Nowhere {
        frames: usize,
    },
}

/// What a sink has taken.
struct Written {
    frames: usize,
    dropped: usize,
    /// In a folder.
    loss: Option<DepthLoss>,
}

impl Sink {
    fn take(&mut self, frame: RawFrame, every_frame: bool) -> Result<(), CaptureError> {
        match self {
            Self::Folder(recorder) if every_frame => recorder.push(frame),
            Self::Folder(recorder) => recorder.offer(frame),
            Self::Nowhere { frames } => {
                *frames += 1;
                Ok(())
            }
        }
    }

    /// Frames taken and dropped until now.
    fn counts(&self) -> (usize, usize) {
        match self {
            Self::Folder(recorder) => {
                let counts = recorder.counts();
                (counts.written, counts.dropped)
            }
            Self::Nowhere { frames } => (*frames, 0),
        }
    }

    fn finish(self) -> Result<Written, CaptureError> {
        match self {
            Self::Folder(recorder) => {
                let (writer, counts) = recorder.finish()?;
                let loss = Some(writer.loss());
                Ok(Written { frames: writer.finish()?, dropped: counts.dropped, loss })
            }
            Self::Nowhere { frames } => Ok(Written { frames, dropped: 0, loss: None }),
        }
    }
}

/// Until the camera's end, which may be an error, or an error in writing.
fn record(
    camera: &mut Camera,
    sink: &mut Sink,
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
        sink.take(frame, every_frame).map_err(unwritable)?;
        rate.tick();
        let (counts, (written, dropped)) = (monitor.counts(), sink.counts());
        bar.set_message(format!(
            "{:.1} FPS  {written} frames written, {} dropped, {} bad{}",
            rate.per_second(),
            counts.dropped + dropped,
            counts.bad,
            if monitor.is_down() { "  no camera" } else { "" },
        ));
    }
}

fn tell(
    out: &Path,
    written: &Written,
    files: &[serde_json::Value],
    live: Option<LiveSummary>,
    talk: Talk,
) {
    if let Some(live) = &live {
        talk.say(format_args!("camera: {}", live.counts));
    }
    let Written { frames, dropped, loss } = written;
    if loss.is_some() {
        let out = out.display();
        talk.say(format_args!("{frames} frames written to {out}, {dropped} dropped while writing"));
    }
    for file in files {
        let name = file["file"].as_str().unwrap_or_default();
        if let (Some(depth), Some(color)) =
            (file["depth_frames"].as_u64(), file["color_frames"].as_u64())
        {
            talk.say(format_args!("{depth} depth and {color} colour frames written to {name}"));
        }
    }
    talk.result(&json!({
        "out": out,
        "frames": frames,
        "dropped_writing": dropped,
        "depth_loss": loss,
        "oni": files,
        "live": live,
    }));
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
