//! Writes recordings in the TUM RGB-D layout: `rgb/`, `depth/`, `rgb.txt`, `depth.txt`,
//! `associations.txt`, `groundtruth.txt`, `intrinsics.txt`.
//!
//! A picture is written under a temporary name and renamed, and its line is added to the list only
//! then: whenever the program stops, the folder is a valid recording of the frames so far.
//! [`Recorder`] does the same with several threads, for cameras that are running.

mod frame;
mod pictures;
mod recorder;

pub use frame::{EncodedFrame, FrameEncoder, FrameRef};
pub use pictures::{ColorFormat, DEPTH_SCALE, DepthCompression, DepthFormat, DepthLoss};
pub use recorder::{Recorder, RecorderCounts};

use super::calibration::{CameraModel, Distortion};
use super::{Calibration, CaptureError};
use crate::math::{Pinhole, Pose};
use crate::output::{LineWriter, OutputError, atomic_write};
use std::fs;
use std::path::{Path, PathBuf};

/// Writes to a temporary name beside `path`, then renames: readers see all of the file or none.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), CaptureError> {
    atomic_write(path, |out| out.write_all(bytes)).map_err(output_error)
}

fn output_error(error: OutputError) -> CaptureError {
    match error {
        OutputError::Io { path, source } => CaptureError::Io { path, source },
        // These name the path themselves.
        other => CaptureError::Sequence(other.to_string()),
    }
}

fn make_folder(path: &Path) -> Result<(), CaptureError> {
    fs::create_dir_all(path).map_err(|e| output_error(OutputError::io(path, e)))
}

/// What a recording is made of.
#[derive(Clone, Debug)]
pub struct TumOptions {
    pub camera: Pinhole,
    pub color: ColorFormat,
    pub depth: DepthFormat,
    /// Name and notes of the camera for `calibration.toml`, which is written where they are given.
    pub calibration: Option<(String, String)>,
}

/// A recording being written.
#[derive(Debug)]
pub struct TumWriter {
    folder: PathBuf,
    encoder: FrameEncoder,
    rgb: LineWriter,
    depth: LineWriter,
    associations: LineWriter,
    /// Made with the first frame that has a pose.
    poses: Option<LineWriter>,
    /// A second depth picture a frame, in a folder of its own.
    second_depth: Option<(String, LineWriter)>,
    frames: usize,
    last_time: String,
    loss: DepthLoss,
}

impl TumWriter {
    /// Starts a recording in `folder`, which is made where it is missing, with 5000 depth steps a metre.
    ///
    /// # Errors
    /// The folder holds a recording already, or cannot be written.
    pub fn create(
        folder: &Path,
        camera: Pinhole,
        color: ColorFormat,
        compression: DepthCompression,
    ) -> Result<Self, CaptureError> {
        let depth = DepthFormat { compression, ..DepthFormat::default() };
        Self::start(folder, &TumOptions { camera, color, depth, calibration: None })
    }

    /// As [`Self::create`].
    pub fn start(folder: &Path, options: &TumOptions) -> Result<Self, CaptureError> {
        if folder.join("rgb.txt").exists() {
            let folder = folder.display();
            return Err(CaptureError::Sequence(format!(
                "{folder} holds a recording already: remove it, or choose another folder"
            )));
        }
        for name in ["rgb", "depth"] {
            make_folder(&folder.join(name))?;
        }
        let steps_per_m = options.depth.steps_per_m;
        let intrinsics = intrinsics(&options.camera, steps_per_m);
        write_whole(&folder.join("intrinsics.txt"), intrinsics.as_bytes())?;
        if let Some(named) = &options.calibration {
            let text = calibration(named, &options.camera, steps_per_m).to_toml()?;
            write_whole(&folder.join("calibration.toml"), text.as_bytes())?;
        }
        Ok(Self {
            rgb: list(folder, "rgb.txt", "timestamp filename (8-bit sRGB)")?,
            depth: list(folder, "depth.txt", &depth_header(steps_per_m))?,
            associations: list(
                folder,
                "associations.txt",
                "rgb timestamp, file, depth timestamp, file",
            )?,
            poses: None,
            second_depth: None,
            folder: folder.to_owned(),
            encoder: FrameEncoder {
                size: options.camera.size(),
                color: options.color,
                depth: options.depth,
                second_depth: false,
            },
            frames: 0,
            last_time: String::new(),
            loss: DepthLoss::default(),
        })
    }

    /// Adds a second depth picture a frame: folder `name`, list `name.txt`.
    pub fn with_second_depth(mut self, name: &str) -> Result<Self, CaptureError> {
        make_folder(&self.folder.join(name))?;
        let header = depth_header(self.encoder.depth.steps_per_m);
        let list = list(&self.folder, &format!("{name}.txt"), &header)?;
        self.second_depth = Some((name.to_owned(), list));
        self.encoder.second_depth = true;
        Ok(self)
    }

    /// Makes frames for [`Self::add`], in other threads as well.
    pub fn encoder(&self) -> FrameEncoder {
        self.encoder.clone()
    }

    /// Adds a frame.
    ///
    /// # Errors
    /// A picture does not have the camera's size, or cannot be written; a second depth picture is
    /// missing or unexpected.
    pub fn push(&mut self, frame: &FrameRef) -> Result<(), CaptureError> {
        let encoded = self.encoder.encode(frame)?;
        self.add(&encoded)
    }

    /// Adds a frame that this writer's encoder has made: pictures first, then the lines that name them.
    ///
    /// # Errors
    /// A file cannot be written, or the frame before has the same time to the microsecond.
    pub fn add(&mut self, frame: &EncodedFrame) -> Result<(), CaptureError> {
        // Pictures would make a folder anew that was removed, and lie there without a list.
        self.associations.check().map_err(output_error)?;
        let time = &frame.time;
        if *time == self.last_time {
            return Err(CaptureError::Sequence(format!("two frames have the time {time}")));
        }
        let color = format!("rgb/{time}.{}", self.encoder.color.extension());
        let depth = format!("depth/{time}.png");
        write_whole(&self.folder.join(&color), &frame.color)?;
        write_whole(&self.folder.join(&depth), &frame.depth)?;
        if let (Some((name, list)), Some(bytes)) = (&mut self.second_depth, &frame.second_depth) {
            let second = format!("{name}/{time}.png");
            write_whole(&self.folder.join(&second), bytes)?;
            push(list, &format!("{time} {second}"))?;
        }
        if let Some(pose) = &frame.world_from_camera {
            let poses = match &mut self.poses {
                Some(list) => list,
                none => none.insert(list(&self.folder, "groundtruth.txt", POSE_HEADER)?),
            };
            push(poses, &pose_line(time, pose))?;
        }
        push(&mut self.depth, &format!("{time} {depth}"))?;
        push(&mut self.rgb, &format!("{time} {color}"))?;
        push(&mut self.associations, &format!("{time} {color} {time} {depth}"))?;
        self.frames += 1;
        self.last_time.clone_from(time);
        self.loss.add(frame.loss);
        Ok(())
    }

    pub fn frames(&self) -> usize {
        self.frames
    }

    /// What the depth format has changed so far.
    pub fn loss(&self) -> DepthLoss {
        self.loss
    }

    /// Makes sure that the lists have reached the disk; returns the number of frames.
    pub fn finish(self) -> Result<usize, CaptureError> {
        let second = self.second_depth.as_ref().map(|(_, list)| list);
        let lists = [&self.rgb, &self.depth, &self.associations];
        for list in lists.into_iter().chain(second).chain(self.poses.as_ref()) {
            list.sync().map_err(output_error)?;
        }
        Ok(self.frames)
    }
}

fn calibration(
    (name, notes): &(String, String),
    camera: &Pinhole,
    steps_per_m: f32,
) -> Calibration {
    let color = CameraModel {
        width: camera.width,
        height: camera.height,
        fx: camera.fx.into(),
        fy: camera.fy.into(),
        cx: camera.cx.into(),
        cy: camera.cy.into(),
        distortion: Distortion::None,
    };
    Calibration {
        notes: notes.clone(),
        depth_factor: Some(steps_per_m.into()),
        invalid_depth: vec![0],
        ..Calibration::registered(name, color)
    }
}

const POSE_HEADER: &str =
    "timestamp tx ty tz qx qy qz qw (camera-to-world, camera x right, y down, z forward)";

fn depth_header(steps_per_m: f32) -> String {
    format!("timestamp filename (16-bit PNG, z-depth, {steps_per_m} per metre, 0 = none)")
}

fn intrinsics(c: &Pinhole, steps_per_m: f32) -> String {
    format!(
        "# fx fy cx cy width height depth_scale\n{:?} {:?} {:?} {:?} {} {} {steps_per_m}\n",
        c.fx, c.fy, c.cx, c.cy, c.width, c.height
    )
}

fn pose_line(time: &str, pose: &Pose) -> String {
    let (t, q) = (pose.translation.vector, pose.rotation.coords);
    format!("{time} {:.8} {:.8} {:.8} {:.8} {:.8} {:.8} {:.8}", t.x, t.y, t.z, q.x, q.y, q.z, q.w)
}

fn list(folder: &Path, name: &str, header: &str) -> Result<LineWriter, CaptureError> {
    let mut list = LineWriter::create(&folder.join(name)).map_err(output_error)?;
    push(&mut list, &format!("# {header}"))?;
    Ok(list)
}

fn push(list: &mut LineWriter, line: &str) -> Result<(), CaptureError> {
    list.push(line).map_err(output_error)
}

#[cfg(test)]
mod tests;
