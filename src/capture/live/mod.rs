//! Cameras that are running: devices, and what keeps a run going while they come, go and stall.

mod device;

pub use device::{DeviceError, DeviceInfo, LiveDevice, LiveDriver};
