//! Drivers by the name of a device.

use super::{DeviceError, LiveDriver, PlayedDriver};
use std::path::PathBuf;

/// What is asked of a device that is not in its name.
#[derive(Clone, Debug, Default)]
pub struct DeviceOptions {
    /// Recordings give a frame as soon as it is wanted, not at its time.
    pub unpaced: bool,
    /// Recordings are lost before each of these frames, once each: the way to try what a run does then.
    pub lose_at: Vec<usize>,
}

/// A driver that knows which device it is to open.
pub struct NamedDriver {
    pub driver: Box<dyn LiveDriver>,
    /// The recording that it plays.
    pub recording: Option<PathBuf>,
}

/// Devices that can be named, for people.
pub const DEVICES: &str = "play:FOLDER";

/// Finds the driver for a device; it is not opened yet.
pub fn find(uri: &str, options: &DeviceOptions) -> Result<NamedDriver, DeviceError> {
    match uri.split_once(':') {
        Some(("play", folder)) if !folder.is_empty() => {
            let driver = PlayedDriver::new(folder.as_ref(), !options.unpaced)
                .losing_device_before(&options.lose_at);
            Ok(NamedDriver { driver: Box::new(driver), recording: Some(folder.into()) })
        }
        _ => {
            Err(DeviceError::NoDriver(format!("no driver for device '{uri}'; there is {DEVICES}")))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_devices_are_named() {
        for uri in ["", "play", "play:", "kinect:0"] {
            let error = find(uri, &DeviceOptions::default()).map(|_| ()).unwrap_err().to_string();
            assert!(error.contains(&format!("'{uri}'")) && error.contains(DEVICES), "{error}");
        }
        let found = find("play:a:b", &DeviceOptions::default()).unwrap();
        assert_eq!(found.recording, Some("a:b".into()));
    }
}
