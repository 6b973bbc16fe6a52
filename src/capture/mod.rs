//! Where frames come from: recordings on disk, made scenes, sensors.
//!
//! A recording is opened by [`open_sequence`]: the [`layout`] of its files is recognised, colour and
//! depth are [associated](association) by time, the [`calibration`] is found, and every delivered
//! frame is rectified and registered: one [`Pinhole`] sees colour and depth alike. [`inspect`] says
//! what was found and whether it is plausible; [`InputStage`] prepares frames for the pipeline.

pub mod association;
pub mod calibration;
mod calibration_files;
mod decode;
#[cfg(any(test, fuzzing))]
pub(crate) mod fuzzing;
mod input;
mod inspect;
pub mod layout;
pub mod live;
pub mod openni;
mod photometry;
pub mod pixel_formats;
mod plausibility;
mod rectify;
mod registration;
mod rig;
mod sequence;
mod text;
pub mod trajectory;
#[cfg(all(feature = "v4l", target_os = "linux"))]
pub mod v4l;

pub use calibration::Calibration;
pub(crate) use decode::color as read_color;
pub use input::InputStage;
#[cfg(feature = "gpu")]
pub use input::{InputTables, input_tables};
pub use inspect::{SequenceReport, inspect};
pub use layout::Layout;
pub(crate) use photometry::{gain, linear_from_code};
pub use registration::Registration;
pub use sequence::{CaptureOptions, Sequence, SequenceInfo, SkippedFrame, open_sequence};

#[cfg(test)]
mod bad_input_tests;
#[cfg(test)]
mod made_sequences;
#[cfg(test)]
mod real_data_tests;

pub mod writer;

use crate::image::Image;
pub use crate::image::MAX_PIXELS;
use crate::math::{Pinhole, Pose};
use std::path::Path;
use std::time::Duration;

/// One colour + depth pair as a source delivers it: same camera, same size, rectified, registered.
#[derive(Clone, Debug)]
pub struct RawFrame {
    /// Position in the sequence, counted from 0.
    pub index: usize,
    pub timestamp_s: f64,
    /// 8-bit sRGB as recorded (after undistortion).
    pub color: Image<[u8; 3]>,
    /// z-depth in metres; missing = 0.0.
    pub depth_m: Image<f32>,
    /// Recorded pose, where the recording has one for this frame.
    pub world_from_camera: Option<Pose>,
    pub exposure_s: Option<f32>,
}

/// A frame after the Input stage.
#[derive(Clone, Debug, Default)]
pub struct RgbdFrame {
    pub index: usize,
    pub timestamp_s: f64,
    /// The camera image as recorded; what virtual objects are composed into.
    pub color_srgb: Image<[u8; 3]>,
    /// Noise-filtered linear-light RGB in [0, 1].
    pub color: Image<[f32; 3]>,
    /// Noise-filtered encoded luma in 8-bit steps, [0, 255].
    pub intensity: Image<f32>,
    /// z-depth in metres; missing = 0.0.
    pub depth_m: Image<f32>,
    pub world_from_camera: Option<Pose>,
}

/// Anything that yields frames in order of time.
pub trait FrameSource: Send {
    /// The one camera of all frames.
    fn camera(&self) -> Pinhole;

    /// Number of frames, where known beforehand.
    fn len(&self) -> Option<usize>;

    fn is_empty(&self) -> bool {
        self.len() == Some(0)
    }

    /// The next frame, `None` at the end. An error concerns one frame: asking again continues
    /// with the frame after it.
    fn next_frame(&mut self) -> Result<Option<RawFrame>, CaptureError>;

    /// Frames that could not be delivered so far.
    fn skipped(&self) -> &[SkippedFrame] {
        &[]
    }

    /// How the last frame came, where it is a camera's.
    fn arrival(&self) -> Option<Arrival> {
        None
    }

    /// What the camera gave so far, where it is one.
    fn live(&self) -> Option<live::LiveSummary> {
        None
    }
}

/// How a frame came from a camera that is running.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Arrival {
    /// From asking for the frame to having it.
    pub waited: Duration,
    /// From its arrival at this machine to its delivery.
    pub age: Duration,
}

#[derive(Debug, thiserror::Error)]
pub enum CaptureError {
    #[error("{path}: {source}")]
    Io { path: String, source: std::io::Error },
    #[error("{path}:{line}: {problem}")]
    Line { path: String, line: usize, problem: String },
    #[error("{path}: {problem}")]
    File { path: String, problem: String },
    #[error("frame {frame}: {problem}")]
    Frame { frame: usize, problem: String },
    #[error("{0}")]
    Sequence(String),
}

impl CaptureError {
    pub(crate) fn io(path: &Path, source: std::io::Error) -> Self {
        Self::Io { path: path.display().to_string(), source }
    }

    fn line(path: &Path, line: usize, problem: impl Into<String>) -> Self {
        Self::Line { path: path.display().to_string(), line, problem: problem.into() }
    }

    pub(crate) fn file(path: &Path, problem: impl Into<String>) -> Self {
        Self::File { path: path.display().to_string(), problem: problem.into() }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ColorFilter {
    None,
    /// 3x3 Gaussian on linear light.
    #[default]
    Gaussian,
    /// 3x3 median per channel.
    Median,
}

/// Input stage.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct InputParams {
    pub color_filter: ColorFilter,
    /// Depth outside [min, max] is missing.
    pub min_depth_m: f32,
    pub max_depth_m: f32,
}

impl Default for InputParams {
    fn default() -> Self {
        Self { color_filter: ColorFilter::default(), min_depth_m: 0.2, max_depth_m: 8.0 }
    }
}
