//! What is here, found out by trying. A driver may crash or hang in any of these: call them in a process that
//! may be lost.

#![allow(unsafe_code, reason = "calls of a C library")]

use super::device_handle::{Device, Sensor, Stream};
use super::ffi;
use super::library;
use super::modes::{self, Wanted};
use super::runtime::{FoundDevice, Runtime};
use crate::capture::live::DeviceError;
use libloading::Library;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// So long a device may take to its first frames: projectors warm up.
const FIRST_FRAMES: Duration = Duration::from_secs(4);

/// An OpenNI2 that can be loaded.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LoadedLibrary {
    /// Where the loader has found it.
    pub path: PathBuf,
    pub version: String,
    /// Where it looks for drivers, and what their names end with.
    pub drivers_folder: PathBuf,
    pub driver_ending: String,
}

/// What a device offers, and whether frames come.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SensorDetail {
    pub depth_modes: Vec<String>,
    pub color_modes: Vec<String>,
    /// It registers depth to colour itself.
    pub registers: bool,
    /// It exposes depth and colour together; `None` where not both streams run.
    pub synchronises: Option<bool>,
    /// Milliseconds from the start of its streams to the first frame.
    pub first_depth_ms: Option<u64>,
    pub first_color_ms: Option<u64>,
    /// Why it does not stream.
    pub stream_error: Option<String>,
}

pub fn library() -> Result<LoadedLibrary, String> {
    let (api, name) = library::find()?;
    // SAFETY: it takes nothing and gives a structure of four numbers.
    let ffi::Version { major, minor, maintenance, build } = unsafe { (api.version)() };
    let path = library::origin(&api).unwrap_or_else(|| name.into());
    let (drivers_folder, driver_ending) = library::drivers_of(&path);
    let version = format!("{major}.{minor}.{maintenance}.{build}");
    // Unloading it would run more of its code.
    std::mem::forget(api);
    Ok(LoadedLibrary { path, version, drivers_folder, driver_ending })
}

/// Loads a driver as OpenNI2 does.
pub fn driver(path: &Path) -> Result<(), String> {
    // SAFETY: loading runs the driver's initialisers, as OpenNI2 would run them. It stays loaded: its threads
    // may need it.
    let driver = unsafe { library::load_at_once(path) }.map_err(|e| e.to_string())?;
    let driver = std::mem::ManuallyDrop::new(driver);
    // SAFETY: the symbol is not called.
    let made = unsafe { Library::get::<*const ()>(&driver, b"oniDriverCreate\0") };
    made.map(drop).map_err(|_| "it is no OpenNI2 driver: it has no oniDriverCreate".to_owned())
}

pub fn announced() -> Result<Vec<FoundDevice>, DeviceError> {
    Runtime::get()?.devices()
}

/// Opens the device and runs both its streams until each has given a frame. Tells what it is `doing`.
pub fn sensor(uri: &str, doing: &mut dyn FnMut(&str)) -> Result<SensorDetail, DeviceError> {
    doing("loading its driver");
    let runtime = Runtime::get()?;
    doing("opening it");
    let device = Arc::new(runtime.open(Some(uri))?);
    let described = |sensor| device.modes(sensor).iter().map(modes::describe).collect();
    let mut detail = SensorDetail {
        depth_modes: described(Sensor::Depth),
        color_modes: described(Sensor::Color),
        registers: device.offers_registration(),
        ..SensorDetail::default()
    };
    doing("starting its streams");
    match started(&device) {
        Ok(streams) => {
            detail.synchronises = match &streams[..] {
                [_, _] => Some(device.enable_sync().is_ok()),
                _ => None,
            };
            doing("waiting for its first frames");
            if let Err(why) = first_frames(runtime, &streams, &mut detail) {
                detail.stream_error = Some(why);
            }
            doing("stopping its streams");
            streams.iter().for_each(|(_, stream)| stream.stop());
        }
        Err(why) => detail.stream_error = Some(why),
    }
    doing("closing it");
    drop(device);
    Ok(detail)
}

/// The streams that it has, in the modes that a run would take where it has these.
fn started(device: &Arc<Device>) -> Result<Vec<(Sensor, Stream)>, String> {
    let formats = |sensor| match sensor {
        Sensor::Depth => &[ffi::DEPTH_1_MM, ffi::DEPTH_100_UM][..],
        Sensor::Color => &[ffi::RGB888][..],
    };
    let mut streams = Vec::new();
    for sensor in [Sensor::Depth, Sensor::Color] {
        let offered = device.modes(sensor);
        if offered.is_empty() {
            continue;
        }
        let problem = |why| format!("its {} stream does not start: {why}", name(sensor));
        let stream = Stream::new(device, sensor).map_err(problem)?;
        let mode = modes::choose(&offered, formats(sensor), Wanted::default()).map_err(problem)?;
        stream.set_mode(mode).map_err(problem)?;
        streams.push((sensor, stream));
    }
    if streams.is_empty() {
        return Err("it has neither a depth nor a colour stream".into());
    }
    let failed = streams.iter().find_map(|(sensor, stream)| Some((sensor, stream.start().err()?)));
    let Some((sensor, why)) = failed else { return Ok(streams) };
    let why = format!("its {} stream does not start: {why}", name(*sensor));
    // Before any is destroyed.
    streams.iter().for_each(|(_, stream)| stream.stop());
    Err(why)
}

fn name(sensor: Sensor) -> &'static str {
    match sensor {
        Sensor::Depth => "depth",
        Sensor::Color => "colour",
    }
}

fn first_frames(
    runtime: &Runtime,
    streams: &[(Sensor, Stream)],
    detail: &mut SensorDetail,
) -> Result<(), String> {
    let began = Instant::now();
    let mut waiting: Vec<_> = streams.iter().collect();
    while !waiting.is_empty() {
        let left = FIRST_FRAMES.saturating_sub(began.elapsed());
        let mut handles: Vec<_> = waiting.iter().map(|(_, stream)| stream.raw()).collect();
        let milliseconds = left.as_millis().min(1 << 20) as i32;
        // SAFETY: the streams live on, and are of this runtime.
        let ready = unsafe { runtime.wait_for_any(&mut handles, milliseconds) };
        let Some(which) = ready.map_err(|e| e.to_string())? else {
            let missing: Vec<_> = waiting.iter().map(|(sensor, _)| name(*sensor)).collect();
            let waited_s = FIRST_FRAMES.as_secs();
            return Err(format!(
                "it gave no {} frame within {waited_s} s",
                missing.join(" and no ")
            ));
        };
        let (sensor, stream) = waiting.swap_remove(which);
        stream.read().map_err(|e| e.to_string())?;
        let after_ms = Some(began.elapsed().as_millis() as u64);
        match sensor {
            Sensor::Depth => detail.first_depth_ms = after_ms,
            Sensor::Color => detail.first_color_ms = after_ms,
        }
    }
    Ok(())
}
