//! A depth sensor as a live source.

use super::beside::Beside;
use super::camera::{self, Known, Setup};
use super::device_handle::{Device, Sensor, Stream};
use super::feed::{self, ColorSource, Feed, Streams};
use super::ffi;
use super::ffi::VideoMode;
use super::modes::{self, Wanted};
use super::recorder::{OniFiles, OniRecorder};
use super::runtime::Runtime;
use crate::capture::RawFrame;
use crate::capture::live::{ColorDriver, DeviceError, DeviceInfo, LiveDevice, LiveDriver};
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
    /// By how much a colour camera beside the sensor dates its pictures later than depth of the same moment.
    pub color_delay_s: f64,
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
            color_delay_s: 0.0,
            hold_exposure_after: None,
            record: None,
        }
    }
}

/// Opens a sensor through OpenNI2.
pub struct OpenniDriver {
    /// `None`: the first that is there.
    pub uri: Option<String>,
    pub options: OpenniOptions,
    beside: Option<Box<dyn ColorDriver>>,
    /// Where times begin that are the host's.
    epoch: Instant,
}

impl OpenniDriver {
    pub fn new(uri: Option<String>, options: OpenniOptions) -> Self {
        Self { uri, options, beside: None, epoch: Instant::now() }
    }

    /// Colour from another camera, not from the sensor, which need not have any. The options' calibration must
    /// say how the two stand. When either is lost, both are opened again.
    pub fn with_color(self, camera: Box<dyn ColorDriver>) -> Self {
        Self { beside: Some(camera), ..self }
    }
}

impl LiveDriver for OpenniDriver {
    fn open(&mut self) -> Result<Box<dyn LiveDevice>, DeviceError> {
        // First of all: it changes the working directory for a moment.
        let runtime = Runtime::get()?;
        // Before the sensor, which takes longer.
        let beside = match &mut self.beside {
            Some(driver) => {
                Some(Beside::start(driver.open()?, self.options.color_delay_s, self.epoch)?)
            }
            None => None,
        };
        let device = runtime.open(self.uri.as_deref())?;
        // Opened again, it should be the same one.
        let uri = self.uri.get_or_insert_with(|| device.found().uri.clone());
        log::info!("OpenNI2: {uri}");
        Ok(Box::new(OpenniDevice::start(Arc::new(device), beside, &self.options)?))
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
    fn start(
        device: Arc<Device>,
        beside: Option<Beside>,
        options: &OpenniOptions,
    ) -> Result<Self, DeviceError> {
        let found = device.found().clone();
        let problem = |why: String| {
            if device.is_lost() {
                DeviceError::Lost(format!("{} was unplugged while it was opened", found.uri))
            } else {
                DeviceError::Unsupported(format!("{}: {why}", found.uri))
            }
        };
        let mut notes = Vec::new();
        let opened = match beside {
            None => with_own_color(&device, options, &mut notes),
            Some(_) if options.record.is_some() => {
                Err("OpenNI2 records what the sensor gives: no .oni with a colour camera beside it"
                    .into())
            }
            Some(beside) => with_color_beside(&device, beside, options, &mut notes),
        };
        let Opened { feed, modes } = opened.map_err(problem)?;
        let recorder = match &options.record {
            Some(files) => Some(record_to(&files.begin(), &feed, &mut notes).map_err(problem)?),
            None => None,
        };
        feed.start().map_err(problem)?;
        if let ColorSource::Sensor(_) = feed.color() {
            synchronise(&device, options, &mut notes);
        }
        if options.hold_exposure_after.is_none() {
            notes.push("exposure and white balance stay automatic".into());
        }
        let (uri, vendor, name) = (found.uri, found.vendor, found.name);
        let info = DeviceInfo { uri, vendor, name, modes, notes };
        let hold_after = options.hold_exposure_after;
        Ok(Self { _recorder: recorder, feed, device, info, hold_after, first_frame: None })
    }

    fn finish(&mut self, frame: RawFrame) -> RawFrame {
        let started = *self.first_frame.get_or_insert_with(Instant::now);
        if self.hold_after.is_some_and(|after| started.elapsed() >= after) {
            self.hold_after = None;
            self.feed.hold_exposure();
        }
        match self.feed.held() {
            Some(Ok(())) => {
                self.say(format!("exposure and white balance are held since frame {}", frame.index))
            }
            Some(Err(which)) => {
                self.say(format!("{which} cannot be held by this device, and stay automatic"));
            }
            None => {}
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

/// Streams that have not started yet, and their modes in words.
struct Opened {
    feed: Feed,
    modes: Vec<String>,
}

fn with_own_color(
    device: &Arc<Device>,
    options: &OpenniOptions,
    notes: &mut Vec<String>,
) -> Result<Opened, String> {
    let streams = Streams::new(device)?;
    choose_modes(device, &streams, options)?;
    stop_mirroring(&streams.depth, "depth", notes);
    stop_mirroring(&streams.color, "colour", notes);
    let registered = register(device, options.hardware_registration, notes);
    let [depth, color] = streams.modes()?;
    let setup = camera::set_up(&Known {
        depth,
        color_size: camera::size(&color),
        color_fov: streams.color.fov(),
        registered: Some(registered),
        calibration: options.calibration.as_deref(),
        depth_factor: None,
    })?;
    let modes = vec![in_words("depth", &depth), in_words("colour", &color)];
    opened(streams.depth, ColorSource::Sensor(streams.color), setup, modes, notes)
}

fn with_color_beside(
    device: &Arc<Device>,
    beside: Beside,
    options: &OpenniOptions,
    notes: &mut Vec<String>,
) -> Result<Opened, String> {
    let calibration = options.calibration.as_deref();
    let depth = feed::depth_stream(device)?;
    set_depth_mode(device, &depth, None, options.fps)?;
    let mode = feed::mode(&depth, "depth")?;
    let setup = camera::set_up_beside(&mode, beside.size(), calibration)?;
    stop_mirroring(&depth, "depth", notes);
    if register(device, false, notes) {
        return Err(
            "it registers depth to its own colour camera and cannot be told not to, which is of \
             no use to a camera beside it"
                .into(),
        );
    }
    let color = beside.info();
    let mut modes = vec![in_words("depth", &mode)];
    modes.extend_from_slice(&color.modes);
    notes.push(format!("colour is from {} ({} {})", color.uri, color.vendor, color.name));
    notes.extend_from_slice(&color.notes);
    let delay_ms = options.color_delay_s * 1e3;
    notes.push(format!(
        "depth and colour are paired by the host's clock, colour taken as {delay_ms:.1} ms late"
    ));
    opened(depth, ColorSource::Beside(beside), setup, modes, notes)
}

fn opened(
    depth: Stream,
    color: ColorSource,
    setup: Setup,
    modes: Vec<String>,
    notes: &mut Vec<String>,
) -> Result<Opened, String> {
    notes.extend_from_slice(&setup.notes);
    Ok(Opened { feed: Feed::new(depth, color, setup, true)?, modes })
}

fn in_words(name: &str, mode: &VideoMode) -> String {
    format!("{name}: {}", modes::describe(mode))
}

fn choose_modes(device: &Device, streams: &Streams, options: &OpenniOptions) -> Result<(), String> {
    let wanted = Wanted { size: options.size, fps: options.fps };
    let colors = device.modes(Sensor::Color);
    let color =
        modes::choose(&colors, &[ffi::RGB888], wanted).map_err(|e| format!("colour: {e}"))?;
    streams.color.set_mode(color).map_err(|e| format!("colour: {e}"))?;
    // Colour is often offered larger than depth; depth is then resampled.
    let same = [color.width.max(0) as usize, color.height.max(0) as usize];
    set_depth_mode(device, &streams.depth, Some(same), options.fps)
}

/// Of this size where there is one.
fn set_depth_mode(
    device: &Device,
    stream: &Stream,
    size: Option<[usize; 2]>,
    fps: Option<u32>,
) -> Result<(), String> {
    let formats = [ffi::DEPTH_1_MM, ffi::DEPTH_100_UM];
    let depths = device.modes(Sensor::Depth);
    let depth = modes::choose(&depths, &formats, Wanted { size, fps })
        .or_else(|_| modes::choose(&depths, &formats, Wanted { size: None, fps }))
        .map_err(|e| format!("depth: {e}"))?;
    stream.set_mode(depth).map_err(|e| format!("depth: {e}"))
}

/// Frames that stay mirrored are turned round as they are read.
fn stop_mirroring(stream: &Stream, name: &str, notes: &mut Vec<String>) {
    if stream.is_mirrored()
        && let Err(why) = stream.stop_mirroring()
    {
        notes.push(format!("{name} stays mirrored ({why}) and is turned round here"));
    }
}

/// Whether the device registers, asked to do it or not.
fn register(device: &Device, wanted: bool, notes: &mut Vec<String>) -> bool {
    if !device.offers_registration() {
        return false;
    }
    if let Err(why) = device.set_registration(wanted) {
        notes.push(format!("the device offers registration and refuses to change it: {why}"));
    }
    device.registration().unwrap_or(false)
}

fn record_to(path: &Path, feed: &Feed, notes: &mut Vec<String>) -> Result<OniRecorder, String> {
    let name = path.display();
    let recorder = OniRecorder::start(path, &feed.streams(), false)
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
