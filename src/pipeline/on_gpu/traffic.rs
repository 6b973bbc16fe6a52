//! What an average frame moves, and how often it stops.

use crate::gpu::{Gpu, Traffic};
use crate::pipeline::FrameTraffic;

/// Counted from the second frame on: the first brings tables, models, and the place of the volume.
#[derive(Default)]
pub struct TrafficOfFrames {
    after_first: Option<Traffic>,
    newest: Traffic,
    frames: u64,
    picture_bytes: u64,
}

impl TrafficOfFrames {
    /// Part of what was read back is a composed picture.
    pub fn add_picture(&mut self, bytes: u64) {
        self.picture_bytes += bytes;
    }

    pub fn end_frame(&mut self, gpu: &Gpu) {
        self.newest = gpu.traffic();
        if self.after_first.is_some() {
            self.frames += 1;
        } else {
            self.after_first = Some(self.newest);
            self.picture_bytes = 0;
        }
    }

    pub fn of_a_frame(&self) -> Option<FrameTraffic> {
        let moved = self.newest.since(self.after_first?);
        let mean = |bytes: u64| bytes.checked_div(self.frames);
        Some(FrameTraffic {
            uploaded: mean(moved.uploaded)?,
            read_back: mean(moved.read_back)?,
            picture: mean(self.picture_bytes)?,
            submissions: moved.submissions as f64 / self.frames as f64,
            waits: moved.waits as f64 / self.frames as f64,
        })
    }
}
