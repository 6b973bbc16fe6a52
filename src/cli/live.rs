//! What the commands for cameras share: which device, for how long, and Ctrl-C.

use super::args::parse_size;
use super::{CliError, interrupt};
use clap::Args;
use kinlight::capture::live::{Delivery, LiveOptions, LiveSource, drivers};
use kinlight::capture::openni::{OniFiles, OpenniOptions};
use std::collections::VecDeque;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::time::{Duration, Instant};

#[derive(Debug, Args)]
pub struct DeviceArgs {
    /// The camera: openni is the first depth sensor that OpenNI2 finds, openni:URI a certain one; play:FOLDER
    /// plays a recording as one.
    #[arg(long, value_name = "URI", default_value = "openni")]
    pub device: String,
    #[command(flatten)]
    pub sensor: SensorArgs,
    /// End after this long (ms, s, min or h).
    #[arg(long, value_name = "30s", value_parser = parse_time)]
    pub duration: Option<Duration>,
    /// End after this many frames.
    #[arg(long, value_name = "N")]
    pub frames: Option<NonZeroUsize>,
    /// Drop nothing: the device waits until a frame is wanted (for recordings that are played; a camera
    /// would fall behind).
    #[arg(long)]
    pub every_frame: bool,
    /// Play a recording forth and back without end.
    #[arg(long = "loop")]
    pub looped: bool,
    /// Open the device again when no frame has come for this long.
    #[arg(long, value_name = "2s", value_parser = parse_time, default_value = "2s")]
    pub stall: Duration,
    /// End when the device stays away for this long [default: wait for it].
    #[arg(long, value_name = "60s", value_parser = parse_time)]
    pub give_up_after: Option<Duration>,
    /// Lose a played device before each of these frames: the way to try what a run does then.
    #[arg(long, value_name = "FRAME", value_delimiter = ',', hide = true)]
    pub lose_device_at: Vec<usize>,
}

/// What is asked of a sensor.
#[derive(Debug, Args)]
pub struct SensorArgs {
    /// Cameras of the sensor, and how they stand to each other [default: its field of view].
    #[arg(long, value_name = "FILE")]
    pub calibration: Option<PathBuf>,
    /// Colour from another camera than the sensor's own: v4l is the first, v4l:/dev/video0 a certain one.
    /// The calibration must have [depth] and [color_from_depth].
    #[arg(long, value_name = "URI", requires = "calibration")]
    pub color_device: Option<String>,
    /// That camera dates its pictures so much later than depth of the same moment, or earlier (-12ms).
    #[arg(long, value_name = "12ms", value_parser = parse_delay, allow_hyphen_values = true)]
    #[arg(requires = "color_device")]
    pub color_delay: Option<f64>,
    /// Size of the colour picture [default: 640,480, or what is nearest].
    #[arg(long, value_name = "W,H", value_parser = parse_size)]
    pub size: Option<(usize, usize)>,
    /// Frames a second [default: 30, or what is nearest].
    #[arg(long)]
    pub fps: Option<u32>,
    /// Hold exposure and white balance after this long [default: they stay automatic].
    #[arg(long, value_name = "2s", value_parser = parse_time)]
    pub hold_exposure_after: Option<Duration>,
    /// Register depth to colour by the calibration, not in the device.
    #[arg(long)]
    pub own_registration: bool,
}

impl SensorArgs {
    fn options(&self) -> OpenniOptions {
        OpenniOptions {
            size: self.size.map(<[usize; 2]>::from),
            fps: self.fps,
            calibration: self.calibration.clone(),
            hardware_registration: !self.own_registration,
            color_delay_s: self.color_delay.unwrap_or(0.0),
            hold_exposure_after: self.hold_exposure_after,
            ..OpenniOptions::default()
        }
    }
}

/// A camera that is running.
pub struct Camera {
    pub source: LiveSource,
    /// The recording that is played.
    pub recording: Option<PathBuf>,
}

impl DeviceArgs {
    /// Opens the camera; Ctrl-C ends it from now on. `capacity`: frames that may wait for the run.
    pub fn open(&self, capacity: usize) -> Result<Camera, CliError> {
        self.open_with(capacity, self.sensor.options(), LiveOptions::default())
    }

    /// Opens a sensor that OpenNI2 records to `files`; its end waits for them for `close_timeout`.
    pub fn open_recording(
        &self,
        capacity: usize,
        files: &OniFiles,
        close_timeout: Duration,
    ) -> Result<Camera, CliError> {
        let sensor = OpenniOptions { record: Some(files.clone()), ..self.sensor.options() };
        self.open_with(capacity, sensor, LiveOptions { close_timeout, ..LiveOptions::default() })
    }

    /// Whether it is a sensor of OpenNI2's.
    pub fn is_openni(&self) -> bool {
        self.device == "openni" || self.device.starts_with("openni:")
    }

    fn open_with(
        &self,
        capacity: usize,
        openni: OpenniOptions,
        live: LiveOptions,
    ) -> Result<Camera, CliError> {
        let asked = drivers::DeviceOptions {
            unpaced: self.every_frame,
            looped: self.looped,
            lose_at: self.lose_device_at.clone(),
            openni,
            color: self.sensor.color_device.clone(),
        };
        let named =
            drivers::find(&self.device, &asked).map_err(|e| CliError::Usage(e.to_string()))?;
        let options = LiveOptions {
            delivery: match self.every_frame {
                true => Delivery::Every,
                false => Delivery::Newest { capacity },
            },
            stall: self.stall,
            give_up_after: self.give_up_after,
            most_frames: self.frames.map(NonZeroUsize::get),
            most_time: self.duration,
            ..live
        };
        let source = LiveSource::open(named.driver, options)
            .map_err(|e| CliError::Device(format!("{}: {e}", self.device)))?;
        let info = source.info();
        log::info!("camera {}: {} {}, {}", info.uri, info.vendor, info.name, info.modes.join(", "));
        for note in &info.notes {
            log::debug!("camera: {note}");
        }
        let monitor = source.monitor();
        interrupt::on_interrupt(move || monitor.stop())?;
        Ok(Camera { source, recording: named.recording })
    }
}

/// A number with ms, s, min or h behind it, up to a year.
pub fn parse_time(text: &str) -> Result<Duration, String> {
    let text = text.trim();
    let units = [("ms", 1e-3), ("min", 60.0), ("s", 1.0), ("h", 3600.0)];
    let split = units.iter().find_map(|(name, s)| text.strip_suffix(name).map(|n| (n, s)));
    let (number, unit_s) = split.ok_or("a unit is needed: ms, s, min or h")?;
    let number: f64 = number.trim_end().parse().map_err(|_| format!("'{number}' is no number"))?;
    let seconds = number * unit_s;
    match seconds > 0.0 && seconds <= 366.0 * 86_400.0 {
        true => Ok(Duration::from_secs_f64(seconds)),
        false => Err("it must be above 0 and at most a year".into()),
    }
}

/// Seconds of a time with a sign or without.
fn parse_delay(text: &str) -> Result<f64, String> {
    let text = text.trim();
    let (sign, size) = match text.strip_prefix('-') {
        Some(size) => (-1.0, size),
        None => (1.0, text.strip_prefix('+').unwrap_or(text)),
    };
    Ok(sign * parse_time(size)?.as_secs_f64())
}

/// Frames a second over the last second.
#[derive(Default)]
pub struct Rate {
    at: VecDeque<Instant>,
}

impl Rate {
    /// Counts a frame.
    pub fn tick(&mut self) {
        let now = Instant::now();
        self.at.push_back(now);
        while self.at.front().is_some_and(|at| now.duration_since(*at) > Duration::from_secs(1)) {
            self.at.pop_front();
        }
    }

    pub fn per_second(&self) -> f64 {
        match (self.at.front(), self.at.back()) {
            (Some(first), Some(last)) if last > first => {
                (self.at.len() - 1) as f64 / last.duration_since(*first).as_secs_f64()
            }
            _ => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn delays_have_a_sign() {
        for (text, s) in [("12ms", 0.012), ("+12ms", 0.012), ("-12ms", -0.012), ("-1.5s", -1.5)] {
            assert_eq!(parse_delay(text), Ok(s), "{text}");
        }
        for bad in ["12", "--1s", "-", "-0s"] {
            assert!(parse_delay(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn times_have_units() {
        for (text, ms) in [("250ms", 250), ("1.5s", 1500), ("2 min", 120_000), ("1h", 3_600_000)] {
            assert_eq!(parse_time(text), Ok(Duration::from_millis(ms)), "{text}");
        }
        for bad in ["5", "s", "-1s", "0s", "nans", "infs", "9e9h", ""] {
            assert!(parse_time(bad).is_err(), "{bad}");
        }
    }
}
