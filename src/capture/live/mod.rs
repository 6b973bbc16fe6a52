//! Cameras that are running: devices, and what keeps a run going while they come, go and stall.
//!
//! ```text
//! driver -> device -> capture thread -> queue of the newest frames -> LiveSource
//! ```
//!
//! [`LiveSource`] is a [`FrameSource`](super::FrameSource) like a recording: who takes its frames does not
//! know that the device was lost, was opened again, or jumped in time.

mod back_off;
mod capture;
mod clock;
mod counts;
mod device;
pub mod drivers;
mod played;
mod queue;
mod source;

pub use counts::{LiveCounts, LiveSummary};
pub use device::{DeviceError, DeviceInfo, LiveDevice, LiveDriver};
pub use played::PlayedDriver;
pub use source::{Delivery, LiveOptions, LiveSource, Monitor};
#[cfg(test)]
mod scripted;
#[cfg(test)]
mod tests;
