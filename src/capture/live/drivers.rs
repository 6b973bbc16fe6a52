//! Drivers by the name of a device.

use super::{ColorDriver, DeviceError, LiveDriver, PlayedDriver};
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
    /// A colour camera beside the sensor, instead of its own.
    pub color: Option<String>,
}

/// A driver that knows which device it is to open.
pub struct NamedDriver {
    pub driver: Box<dyn LiveDriver>,
    /// The recording that it plays.
    pub recording: Option<PathBuf>,
}

/// Devices that can be named, for people.
pub const DEVICES: &str = "openni, openni:URI and play:FOLDER";

/// Colour cameras that can be named, for people.
pub const COLOR_DEVICES: &str = "v4l and v4l:/dev/videoN";

/// Finds the driver for a device; it is not opened yet.
pub fn find(uri: &str, options: &DeviceOptions) -> Result<NamedDriver, DeviceError> {
    match uri.split_once(':') {
        Some(("play", folder)) if !folder.is_empty() => {
            if let Some(color) = &options.color {
                return Err(DeviceError::NoDriver(format!(
                    "a recording has its own colour: '{color}' goes with openni"
                )));
            }
            let driver = PlayedDriver::new(folder.as_ref(), !options.unpaced)
                .looped(options.looped)
                .losing_device_before(&options.lose_at);
            Ok(NamedDriver { driver: Box::new(driver), recording: Some(folder.into()) })
        }
        None if uri == "openni" => sensor(None, options),
        Some(("openni", sensor_uri)) if !sensor_uri.is_empty() => {
            sensor(Some(sensor_uri.to_owned()), options)
        }
        _ => {
            Err(DeviceError::NoDriver(format!("no driver for device '{uri}'; there is {DEVICES}")))
        }
    }
}

fn sensor(uri: Option<String>, options: &DeviceOptions) -> Result<NamedDriver, DeviceError> {
    let mut driver = OpenniDriver::new(uri, options.openni.clone());
    if let Some(color) = &options.color {
        driver = driver.with_color(color_camera(color, &options.openni)?);
    }
    Ok(NamedDriver { driver: Box::new(driver), recording: None })
}

fn color_camera(uri: &str, options: &OpenniOptions) -> Result<Box<dyn ColorDriver>, DeviceError> {
    match uri.split_once(':') {
        None if uri == "v4l" => v4l(None, options),
        Some(("v4l", path)) if !path.is_empty() => v4l(Some(path.into()), options),
        _ => Err(DeviceError::NoDriver(format!(
            "no driver for colour camera '{uri}'; there is {COLOR_DEVICES}"
        ))),
    }
}

#[cfg(all(feature = "v4l", target_os = "linux"))]
fn v4l(path: Option<PathBuf>, asked: &OpenniOptions) -> Result<Box<dyn ColorDriver>, DeviceError> {
    use crate::capture::v4l::{V4lDriver, V4lOptions};
    let options = V4lOptions { size: asked.size, fps: asked.fps, ..V4lOptions::default() };
    Ok(Box::new(V4lDriver::new(path, options)))
}

#[cfg(not(all(feature = "v4l", target_os = "linux")))]
fn v4l(
    _path: Option<PathBuf>,
    _asked: &OpenniOptions,
) -> Result<Box<dyn ColorDriver>, DeviceError> {
    Err(DeviceError::NoDriver(
        "this kinlight was built without V4L2: build it on Linux with `cargo build --release --features v4l` \
         (Debian: apt install clang libclang-dev)"
            .into(),
    ))
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

    #[test]
    fn colour_cameras_go_with_sensors_and_are_named() {
        let with = |color: &str| DeviceOptions { color: Some(color.into()), ..Default::default() };
        let error = |uri, color| find(uri, &with(color)).map(|_| ()).unwrap_err().to_string();
        for color in ["", "v4l:", "uvc:0"] {
            let said = error("openni", color);
            assert!(said.contains(&format!("'{color}'")) && said.contains(COLOR_DEVICES), "{said}");
        }
        assert!(error("play:a", "v4l").contains("its own colour"));
        for color in ["v4l", "v4l:/dev/video0"] {
            if cfg!(all(feature = "v4l", target_os = "linux")) {
                assert!(find("openni", &with(color)).is_ok());
            } else {
                let said = error("openni", color);
                assert!(said.contains("--features v4l"), "{said}");
            }
        }
    }
}
