//! What an average frame moves, and how often it stops.

use crate::gpu::{Gpu, Traffic};
use crate::pipeline::FrameTraffic;

/// Counted from the second frame on: the first brings tables, models, and the place of the volume. What is
/// downloaded between frames, to be looked at, is no part of them.
#[derive(Default)]
pub struct TrafficOfFrames {
    at_start: Traffic,
    sum: Traffic,
    picture_bytes: u64,
    /// The first included.
    frames: u64,
}

impl TrafficOfFrames {
    pub fn start_frame(&mut self, gpu: &Gpu) {
        self.at_start = gpu.traffic();
    }

    /// `picture_bytes` of what was read back are the composed picture.
    pub fn end_frame(&mut self, gpu: &Gpu, picture_bytes: u64) {
        if self.frames > 0 {
            self.sum = self.sum.and(gpu.traffic().since(self.at_start));
            self.picture_bytes += picture_bytes;
        }
        self.frames += 1;
    }

    pub fn of_a_frame(&self) -> Option<FrameTraffic> {
        let frames = self.frames.checked_sub(1).filter(|&frames| frames > 0)?;
        let mean = |count: u64| count as f64 / frames as f64;
        Some(FrameTraffic {
            uploaded: self.sum.uploaded / frames,
            read_back: self.sum.read_back / frames,
            picture: self.picture_bytes / frames,
            submissions: mean(self.sum.submissions),
            waits: mean(self.sum.waits),
        })
    }
}
