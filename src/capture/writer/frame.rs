//! One frame, ready to be written.

use super::{ColorFormat, DepthFormat, DepthLoss};
use crate::capture::CaptureError;
use crate::image::{Image, Size};
use crate::math::Pose;
use image::ImageResult;

/// What one frame of a recording consists of; pictures have the camera's size.
#[derive(Clone, Copy, Debug)]
pub struct FrameRef<'a> {
    pub timestamp_s: f64,
    /// 8-bit sRGB.
    pub color: &'a Image<[u8; 3]>,
    /// z-depth in metres; missing = 0.0.
    pub depth_m: &'a Image<f32>,
    /// For the folder given to [`TumWriter::with_second_depth`](super::TumWriter::with_second_depth).
    pub second_depth_m: Option<&'a Image<f32>>,
    pub world_from_camera: Option<&'a Pose>,
}

/// A frame as its files' bytes.
#[derive(Clone, Debug)]
pub struct EncodedFrame {
    /// As in file names and lists: seconds, to the microsecond.
    pub(super) time: String,
    pub(super) color: Vec<u8>,
    pub(super) depth: Vec<u8>,
    pub(super) second_depth: Option<Vec<u8>>,
    pub(super) world_from_camera: Option<Pose>,
    pub(super) loss: DepthLoss,
}

/// Turns pictures into files' bytes; of one recording.
#[derive(Clone, Debug)]
pub struct FrameEncoder {
    pub(super) size: Size,
    pub(super) color: ColorFormat,
    pub(super) depth: DepthFormat,
    /// Whether a second depth picture comes with every frame.
    pub(super) second_depth: bool,
}

impl FrameEncoder {
    /// # Errors
    /// A picture does not have the camera's size; a second depth picture is missing or unexpected.
    pub fn encode(&self, frame: &FrameRef) -> Result<EncodedFrame, CaptureError> {
        let time = format!("{:.6}", frame.timestamp_s);
        self.check(frame)
            .map_err(|p| CaptureError::Sequence(format!("the frame at {time} s: {p}")))?;
        Ok(EncodedFrame {
            color: bytes(self.color.encode(frame.color), "colour", &time)?,
            depth: bytes(self.depth.encode(frame.depth_m), "depth", &time)?,
            second_depth: frame
                .second_depth_m
                .map(|depth_m| bytes(self.depth.encode(depth_m), "second depth", &time))
                .transpose()?,
            world_from_camera: frame.world_from_camera.copied(),
            loss: self.depth.loss(frame.depth_m),
            time,
        })
    }

    fn check(&self, frame: &FrameRef) -> Result<(), String> {
        if !frame.timestamp_s.is_finite() {
            return Err("it has no time".into());
        }
        if frame.second_depth_m.is_some() != self.second_depth {
            return Err("a second depth picture must come with every frame or with none".into());
        }
        let sizes = [
            ("colour", Some(frame.color.size())),
            ("depth", Some(frame.depth_m.size())),
            ("second depth", frame.second_depth_m.map(Image::size)),
        ];
        for (what, size) in sizes {
            if let Some(size) = size.filter(|&s| s != self.size) {
                return Err(format!("its {what} picture is {size}, the camera is {}", self.size));
            }
        }
        Ok(())
    }
}

fn bytes(encoded: ImageResult<Vec<u8>>, what: &str, time: &str) -> Result<Vec<u8>, CaptureError> {
    encoded
        .map_err(|error| CaptureError::Sequence(format!("the {what} picture at {time} s: {error}")))
}
