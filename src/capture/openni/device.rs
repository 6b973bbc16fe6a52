//! A depth sensor as a live source.

use super::camera::{self, Known};
use super::device_handle::{Device, Sensor};
use super::feed::{Feed, Streams};
use super::ffi;
use super::modes::{self, Wanted};
use super::recorder::{OniFiles, OniRecorder};
use super::runtime::Runtime;
use crate::capture::RawFrame;
use crate::capture::live::{DeviceError, DeviceInfo, LiveDevice, LiveDriver};
use crate::math::Pinhole;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How often a wait looks whether the device is still there.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// A clock that jumps all the time must not fill the memory.
const MOST_NOTES: usize = 40;

/// What may be asked of a sensor.
#[derive(Clone, Debug)]
pub struct OpenniOptions {
    /// Of the colour picture; depth takes the same where it can. Else VGA, or what is nearest to it.
    pub size: Option<[usize; 2]>,
    /// Of both streams. Else 30, or what is nearest to it.
    pub fps: Option<u32>,
    /// Cameras, and how depth is registered where the device does not do it.
    pub calibration: Option<PathBuf>,
    /// Depth registered by the device where it can; otherwise, and where this is off, by the calibration.
    pub hardware_registration: bool,
    /// Depth and colour exposed together where the device can.
    pub sync: bool,
    /// Exposure and white balance are automatic for so long and then held; `None`: always automatic.
    pub hold_exposure_after: Option<Duration>,
    /// Records with OpenNI2's own recorder while streaming; a device that is opened again continues in
    /// another file.
    pub record: Option<OniFiles>,
}

impl Default for OpenniOptions {
    fn default() -> Self {
        Self {
            size: None,
            fps: None,
            calibration: None,
            hardware_registration: true,
            sync: true,
            hold_exposure_after: None,
            record: None,
        }
    }
}

/// Opens a sensor through OpenNI2.
#[derive(Clone, Debug, Default)]
pub struct OpenniDriver {
    /// `None`: the first that is there.
    pub uri: Option<String>,
    pub options: OpenniOptions,
}

impl OpenniDriver {
    pub fn new(uri: Option<String>, options: OpenniOptions) -> Self {
        Self { uri, options }
    }
}

impl LiveDriver for OpenniDriver {
    fn open(&mut self) -> Result<Box<dyn LiveDevice>, DeviceError> {
        let device = Runtime::get()?.open(self.uri.as_deref())?;
        // Opened again, it should be the same one.
        let uri = self.uri.get_or_insert_with(|| device.found().uri.clone());
        log::info!("OpenNI2: {uri}");
        Ok(Box::new(OpenniDevice::start(Arc::new(device), &self.options)?))
    }
}

/// A sensor that streams.
pub struct OpenniDevice {
    // Dropped in this order: the recorder writes what it still has before its streams go.
    _recorder: Option<OniRecorder>,
    feed: Feed,
    device: Arc<Device>,
    info: DeviceInfo,
    hold_after: Option<Duration>,
    first_frame: Option<Instant>,
}

impl OpenniDevice {
    fn start(device: Arc<Device>, options: &OpenniOptions) -> Result<Self, DeviceError> {
        let found = device.found().clone();
        let problem = |why: String| {
            if device.is_lost() {
                DeviceError::Lost(format!("{} was unplugged while it was opened", found.uri))
            } else {
                DeviceError::Unsupported(format!("{}: {why}", found.uri))
            }
        };
        let streams = Streams::new(&device).map_err(problem)?;
        choose_modes(&device, &streams, options).map_err(problem)?;
        let mut notes = Vec::new();
        stop_mirroring(&streams, &mut notes);
        let registered = register(&device, options, &mut notes);
        let [depth, color] = streams.modes().map_err(problem)?;
        let setup = camera::set_up(&Known {
            depth,
            color,
            color_fov: streams.color.fov(),
            registered: Some(registered),
            calibration: options.calibration.as_deref(),
            depth_factor: None,
        })
        .map_err(problem)?;
        notes.extend_from_slice(&setup.notes);
        let feed = Feed::new(streams, setup, true).map_err(problem)?;
        let recorder = match &options.record {
            Some(files) => Some(record_to(&files.begin(), &feed, &mut notes).map_err(problem)?),
            None => None,
        };
        feed.start().map_err(problem)?;
        synchronise(&device, options, &mut notes);
        if options.hold_exposure_after.is_none() {
            notes.push("exposure and white balance stay automatic".into());
        }
        let info = DeviceInfo {
            uri: found.uri,
            vendor: found.vendor,
            name: found.name,
            modes: [("depth", depth), ("colour", color)]
                .map(|(name, mode)| format!("{name}: {}", modes::describe(&mode)))
                .into(),
            notes,
        };
        let hold_after = options.hold_exposure_after;
        Ok(Self { _recorder: recorder, feed, device, info, hold_after, first_frame: None })
    }

    fn finish(&mut self, frame: RawFrame) -> RawFrame {
        let started = *self.first_frame.get_or_insert_with(Instant::now);
        if self.hold_after.is_some_and(|after| started.elapsed() >= after) {
            self.hold_after = None;
            let [_, color] = self.feed.streams();
            let note = match color.lock_exposure() {
                Ok(()) => {
                    format!("exposure and white balance are held since frame {}", frame.index)
                }
                Err(which) => format!("{which} cannot be held by this device, and stay automatic"),
            };
            self.say(note);
        }
        frame
    }

    fn say(&mut self, note: String) {
        log::warn!("{}: {note}", self.info.uri);
        if self.info.notes.len() < MOST_NOTES {
            self.info.notes.push(note);
        }
    }
}

impl Drop for OpenniDevice {
    fn drop(&mut self) {
        log::info!("{}: {} frames without a partner", self.info.uri, self.feed.alone());
    }
}

impl LiveDevice for OpenniDevice {
    fn info(&self) -> &DeviceInfo {
        &self.info
    }

    fn camera(&self) -> Pinhole {
        self.feed.camera()
    }

    fn wait(&mut self, timeout: Duration) -> Result<Option<RawFrame>, DeviceError> {
        let end = Instant::now() + timeout;
        loop {
            if let Some(frame) = self.feed.take(true).map_err(DeviceError::BadFrame)? {
                return Ok(Some(self.finish(frame)));
            }
            if self.device.is_lost() {
                return Err(DeviceError::Lost(format!("{} was unplugged", self.info.uri)));
            }
            let left = end.saturating_duration_since(Instant::now());
            let read = self.feed.read(left.min(LOOK_EVERY));
            for jump_s in std::mem::take(&mut self.feed.jumps_s) {
                self.say(format!(
                    "the device's clock jumped by {jump_s:.3} s; times go on without"
                ));
            }
            if !read? && left.is_zero() {
                return Ok(None);
            }
        }
    }
}

fn choose_modes(device: &Device, streams: &Streams, options: &OpenniOptions) -> Result<(), String> {
    let wanted = Wanted { size: options.size, fps: options.fps };
    let colors = device.modes(Sensor::Color);
    let color =
        modes::choose(&colors, &[ffi::RGB888], wanted).map_err(|e| format!("colour: {e}"))?;
    streams.color.set_mode(color).map_err(|e| format!("colour: {e}"))?;

    let formats = [ffi::DEPTH_1_MM, ffi::DEPTH_100_UM];
    let depths = device.modes(Sensor::Depth);
    // Colour is often offered larger than depth; depth is then resampled.
    let same = Some([color.width.max(0) as usize, color.height.max(0) as usize]);
    let depth = modes::choose(&depths, &formats, Wanted { size: same, fps: options.fps })
        .or_else(|_| modes::choose(&depths, &formats, Wanted { size: None, fps: options.fps }))
        .map_err(|e| format!("depth: {e}"))?;
    streams.depth.set_mode(depth).map_err(|e| format!("depth: {e}"))
}

/// Frames that stay mirrored are turned round as they are read.
fn stop_mirroring(streams: &Streams, notes: &mut Vec<String>) {
    for (name, stream) in [("depth", &streams.depth), ("colour", &streams.color)] {
        if stream.is_mirrored()
            && let Err(why) = stream.stop_mirroring()
        {
            notes.push(format!("{name} stays mirrored ({why}) and is turned round here"));
        }
    }
}

/// Whether the device registers.
fn register(device: &Device, options: &OpenniOptions, notes: &mut Vec<String>) -> bool {
    if !device.offers_registration() {
        return false;
    }
    if let Err(why) = device.set_registration(options.hardware_registration) {
        notes.push(format!("the device offers registration and refuses to change it: {why}"));
    }
    device.registration().unwrap_or(false)
}

fn record_to(path: &Path, feed: &Feed, notes: &mut Vec<String>) -> Result<OniRecorder, String> {
    let name = path.display();
    let recorder = OniRecorder::start(path, feed.streams(), false)
        .map_err(|why| format!("{name} cannot be recorded: {why}"))?;
    notes.push(format!("OpenNI2 records to {name}"));
    Ok(recorder)
}

fn synchronise(device: &Device, options: &OpenniOptions, notes: &mut Vec<String>) {
    notes.push(match (options.sync, options.sync.then(|| device.enable_sync())) {
        (true, Some(Ok(()))) => "depth and colour are synchronised by the device".into(),
        _ => "depth and colour are paired by their times".into(),
    });
}
