//! Cameras that are running: devices, and what keeps a run going while they come, go and stall.
//!
//! ```text
//! driver -> device -> capture thread -> queue of the newest frames -> LiveSource
//! ```
//!
//! [`LiveSource`] is a [`FrameSource`](super::FrameSource) like a recording: who takes its frames does not
//! know that the device was lost, was opened again, or jumped in time. A [`ColorCamera`] may stand beside a
//! device whose own colour is missing or not good enough: it is read by a thread of its own.

mod back_off;
mod capture;
mod clock;
mod color_camera;
mod color_capture;
mod counts;
mod device;
pub mod drivers;
mod host_clock;
mod played;
mod queue;
mod source;

pub use color_camera::{ColorCamera, ColorDriver, ColorPicture};
pub(super) use color_capture::ColorCapture;
pub use counts::{LiveCounts, LiveSummary};
pub use device::{DeviceError, DeviceInfo, LiveDevice, LiveDriver};
pub(super) use host_clock::HostClock;
pub use played::PlayedDriver;
pub use source::{Delivery, LiveOptions, LiveSource, Monitor};
#[cfg(test)]
mod scripted;
#[cfg(test)]
mod tests;
