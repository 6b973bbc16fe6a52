//! Drivers by the name of a device.

use super::{DeviceError, LiveDriver, PlayedDriver};
use crate::capture::openni::{OpenniDriver, OpenniOptions};
use std::path::PathBuf;

/// What is asked of a device that is not in its name.
#[derive(Clone, Debug, Default)]
pub struct DeviceOptions {
    /// Recordings give a frame as soon as it is wanted, not at its time.
    pub unpaced: bool,
    /// Recordings are played forth and back without end.
    pub looped: bool,
    /// Recordings are lost before each of these frames, once each: the way to try what a run does then.
    pub lose_at: Vec<usize>,
    /// Of sensors.
    pub openni: OpenniOptions,
}

/// A driver that knows which device it is to open.
pub struct NamedDriver {
    pub driver: Box<dyn LiveDriver>,
    /// The recording that it plays.
    pub recording: Option<PathBuf>,
}

/// Devices that can be named, for people.
pub const DEVICES: &str = "openni, openni:URI and play:FOLDER";

/// Finds the driver for a device; it is not opened yet.
pub fn find(uri: &str, options: &DeviceOptions) -> Result<NamedDriver, DeviceError> {
    match uri.split_once(':') {
        Some(("play", folder)) if !folder.is_empty() => {
            let driver = PlayedDriver::new(folder.as_ref(), !options.unpaced)
                .looped(options.looped)
                .losing_device_before(&options.lose_at);
            Ok(NamedDriver { driver: Box::new(driver), recording: Some(folder.into()) })
        }
        None if uri == "openni" => Ok(sensor(None, options)),
        Some(("openni", sensor_uri)) if !sensor_uri.is_empty() => {
            Ok(sensor(Some(sensor_uri.to_owned()), options))
        }
        _ => {
            Err(DeviceError::NoDriver(format!("no driver for device '{uri}'; there is {DEVICES}")))
        }
    }
}

fn sensor(uri: Option<String>, options: &DeviceOptions) -> NamedDriver {
    let driver = OpenniDriver::new(uri, options.openni.clone());
    NamedDriver { driver: Box::new(driver), recording: None }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_devices_are_named() {
        for uri in ["", "play", "play:", "openni:", "kinect:0"] {
            let error = find(uri, &DeviceOptions::default()).map(|_| ()).unwrap_err().to_string();
            assert!(error.contains(&format!("'{uri}'")) && error.contains(DEVICES), "{error}");
        }
        let found = find("play:a:b", &DeviceOptions::default()).unwrap();
        assert_eq!(found.recording, Some("a:b".into()));
        for uri in ["openni", "openni:1d27/0609@1/2"] {
            assert!(find(uri, &DeviceOptions::default()).is_ok_and(|d| d.recording.is_none()));
        }
    }
}
