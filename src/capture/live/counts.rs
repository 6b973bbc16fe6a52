//! What a live camera gave, and what became of it.

use super::DeviceInfo;
use serde::Serialize;
use std::time::Duration;

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct LiveCounts {
    /// Good frames that the device gave.
    pub captured: usize,
    /// Frames that were taken from the queue.
    pub delivered: usize,
    /// Frames that newer ones replaced before they were taken.
    pub dropped: usize,
    /// Frames that the driver or their own sizes and times gave up as no good.
    pub bad: usize,
    /// How often the device was lost or stalled.
    pub outages: usize,
    /// Of them, how often frames came again.
    pub recoveries: usize,
    /// Time without a device, outages that go on included.
    pub down_s: f64,
    /// Attempts to open the device again.
    pub attempts: usize,
    pub clock_jumps: usize,
    /// From arrival to delivery, of the last frame.
    #[serde(skip)]
    pub last_age: Duration,
}

/// The camera of a run.
#[derive(Clone, Debug, Serialize)]
pub struct LiveSummary {
    pub device: DeviceInfo,
    #[serde(flatten)]
    pub counts: LiveCounts,
}

impl std::fmt::Display for LiveCounts {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { captured, delivered, dropped, bad, .. } = self;
        write!(f, "{captured} frames captured, {delivered} used, {dropped} dropped, {bad} bad")?;
        if self.outages > 0 {
            let (outages, down_s) = (self.outages, self.down_s);
            write!(f, "; camera lost {outages} times, {down_s:.1} s in all")?;
        }
        if self.clock_jumps > 0 {
            write!(f, "; its clock jumped {} times", self.clock_jumps)?;
        }
        Ok(())
    }
}
