//! A colour camera that streams.

#![allow(unsafe_code, reason = "calls of the kernel")]

use super::buffers::{Buffers, Filled};
use super::modes::{self, Mode, Wanted};
use super::node::{CAPTURE, Identity, Node, hz, zeroed};
use super::{clock, controls, encoding, error, report};
use crate::capture::live::{ColorCamera, ColorDriver, ColorPicture, DeviceError, DeviceInfo};
use crate::capture::pixel_formats::{PixelFormat, Unpacker};
use crate::image::Size;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};
use v4l::v4l_sys as sys;
use v4l::v4l2::vidioc;

/// Of the modes that a driver lists and then refuses, so many are tried.
const MOST_TRIED: usize = 24;

/// A picture that has waited in its buffer for so long is passed over: this machine was busy, and the next are
/// newer.
const STALE: Duration = Duration::from_secs(1);

/// What may be asked of a camera. It is met as nearly as the camera can, and what it became is said.
#[derive(Clone, Debug, PartialEq)]
pub struct V4lOptions {
    /// Else VGA.
    pub size: Option<[usize; 2]>,
    /// Else 30.
    pub fps: Option<u32>,
    /// The first preferred, where size and rate are the same.
    pub formats: Vec<PixelFormat>,
}

impl Default for V4lOptions {
    fn default() -> Self {
        Self { size: None, fps: None, formats: PixelFormat::ALL.into() }
    }
}

/// Opens a camera through V4L2.
#[derive(Clone, Debug, Default)]
pub struct V4lDriver {
    /// A device node; `None`: the first that gives pictures.
    path: Option<PathBuf>,
    options: V4lOptions,
    /// What was opened first.
    known: Option<Identity>,
}

impl V4lDriver {
    pub fn new(path: Option<PathBuf>, options: V4lOptions) -> Self {
        Self { path, options, known: None }
    }
}

impl ColorDriver for V4lDriver {
    fn open(&mut self) -> Result<Box<dyn ColorCamera>, DeviceError> {
        let path = match &self.path {
            Some(path) => path.clone(),
            None => report::first(self.known.as_ref())?,
        };
        let camera = V4lCamera::open(&path, &self.options)?;
        // Opened again, it should be the same one.
        let known = self.known.get_or_insert_with(|| camera.identity.clone());
        if known.card != camera.identity.card {
            return Err(DeviceError::Absent(format!(
                "{} is another camera now: {}, where it was {}",
                path.display(),
                camera.identity.card,
                known.card
            )));
        }
        Ok(Box::new(camera))
    }
}

struct V4lCamera {
    // Dropped before the node's last holder.
    buffers: Buffers,
    node: Arc<Node>,
    identity: Identity,
    info: DeviceInfo,
    size: Size,
    rate_hz: f64,
    started: Instant,
    unpacker: Unpacker,
    /// Conversion shares no threads with the run: it must not wait for a stage of the pipeline.
    threads: rayon::ThreadPool,
    said_undated: bool,
}

/// What a driver has agreed to.
struct Agreed {
    mode: Mode,
    stride: usize,
}

impl V4lCamera {
    fn open(path: &Path, options: &V4lOptions) -> Result<Self, DeviceError> {
        let explain = |doing: &'static str| move |e| error::explain(path, doing, &e);
        let unsupported =
            |why: String| DeviceError::Unsupported(format!("{}: {why}", path.display()));
        let node = Node::open(path).map_err(explain("opening"))?;
        let (identity, flags) = node.capabilities().map_err(explain("asking what it is"))?;
        report::check(flags).map_err(unsupported)?;
        let wanted = Wanted::new(options.size, options.fps);
        let offered = node.offers(wanted.size).map_err(explain("asking for its formats"))?;
        let ranked = modes::ranked(&offered, &options.formats, &wanted).map_err(unsupported)?;
        let agreed = agree(&node, &ranked, wanted.rate_hz)?;
        let Mode { format, size, rate_hz } = agreed.mode;
        let unpacker = Unpacker::new(format, size, agreed.stride).map_err(unsupported)?;
        controls::release(&node);
        let node = Arc::new(node);
        let started = Instant::now();
        let buffers = Buffers::start(&node).map_err(explain("starting"))?;
        let threads = rayon::ThreadPoolBuilder::new().num_threads(1).build();
        let threads = threads.map_err(|e| DeviceError::Lost(e.to_string()))?;
        let mut notes = notes(options, &agreed.mode);
        notes.push(times_in_words(buffers.flags).into());
        let info = DeviceInfo {
            uri: format!("v4l:{}", path.display()),
            vendor: identity.driver.clone(),
            name: identity.card.clone(),
            modes: vec![format!("colour: {}", agreed.mode)],
            notes,
        };
        log::info!("{}: {}, {}", info.uri, info.name, info.modes.join(", "));
        let rate_hz = rate_hz.unwrap_or(wanted.rate_hz);
        Ok(Self {
            buffers,
            node,
            identity,
            info,
            size,
            rate_hz,
            started,
            unpacker,
            threads,
            said_undated: false,
        })
    }
}

/// Sets the first of these modes that the driver takes and whose pictures can be read.
fn agree(node: &Node, ranked: &[Mode], wanted_hz: f64) -> Result<Agreed, DeviceError> {
    let mut refused = Vec::new();
    for mode in ranked.iter().take(MOST_TRIED) {
        match set(node, mode) {
            Ok(Ok(stride)) => {
                let rate_hz = set_rate(node, mode.rate_hz.unwrap_or(wanted_hz)).or(mode.rate_hz);
                return Ok(Agreed { mode: Mode { rate_hz, ..*mode }, stride });
            }
            Ok(Err(why)) => refused.push(why),
            Err(error) => {
                let error = error::explain(&node.path, "setting its format", &error);
                if matches!(error, DeviceError::Busy(_)) {
                    return Err(error);
                }
                refused.push(format!("{mode}: {error}"));
            }
        }
    }
    refused.dedup();
    let (path, refused) = (node.path.display(), refused.join("; "));
    Err(DeviceError::Unsupported(format!("{path}: no mode that can be read: {refused}")))
}

/// The stride; else why the driver's answer is of no use.
fn set(node: &Node, mode: &Mode) -> std::io::Result<Result<usize, String>> {
    let mut format = sys::v4l2_format { type_: CAPTURE, ..zeroed() };
    let wanted = u32::from_le_bytes(mode.format.fourcc());
    // SAFETY: numbers in any member; this is the one of captured pictures.
    let mut pix = unsafe { format.fmt.pix };
    (pix.width, pix.height) = (mode.size.width as u32, mode.size.height as u32);
    pix.pixelformat = wanted;
    pix.field = sys::v4l2_field_V4L2_FIELD_NONE;
    format.fmt.pix = pix;
    node.call(vidioc::VIDIOC_S_FMT, &mut format)?;
    // SAFETY: as above.
    let pix = unsafe { format.fmt.pix };
    let size = Size::new(pix.width as usize, pix.height as usize);
    Ok(if pix.pixelformat != wanted || size != mode.size {
        let found = String::from_utf8_lossy(&pix.pixelformat.to_le_bytes()).into_owned();
        Err(format!("{mode} is listed, and becomes {size} {found}"))
    } else if !matches!(pix.field, sys::v4l2_field_V4L2_FIELD_NONE | sys::v4l2_field_V4L2_FIELD_ANY)
    {
        Err(format!("{mode} comes in fields (interlaced)"))
    } else {
        encoding::check(mode.format, &pix).map(|()| pix.bytesperline as usize)
    })
}

/// The rate that it became; `None` where the driver has none to set.
fn set_rate(node: &Node, wanted_hz: f64) -> Option<f64> {
    let mut parameters = sys::v4l2_streamparm { type_: CAPTURE, ..zeroed() };
    node.call(vidioc::VIDIOC_G_PARM, &mut parameters).ok()?;
    // SAFETY: numbers in any member; this is the one of captured pictures.
    let mut capture = unsafe { parameters.parm.capture };
    if capture.capability & sys::V4L2_CAP_TIMEPERFRAME != 0 {
        let denominator = (wanted_hz * 1000.0).round() as u32;
        capture.timeperframe = sys::v4l2_fract { numerator: 1000, denominator };
        parameters.parm.capture = capture;
        if let Err(error) = node.call(vidioc::VIDIOC_S_PARM, &mut parameters) {
            log::debug!("{}: setting its rate: {error}", node.path.display());
        }
    }
    // SAFETY: as above.
    hz(unsafe { parameters.parm.capture }.timeperframe)
}

/// What of the wishes was not met.
fn notes(options: &V4lOptions, mode: &Mode) -> Vec<String> {
    let mut notes = Vec::new();
    let asked = options.size.map(|[width, height]| Size::new(width, height));
    if let Some(asked) = asked.filter(|asked| *asked != mode.size) {
        notes.push(format!("colour of {asked} is not offered: it is {}", mode.size));
    }
    let asked =
        options.fps.filter(|fps| mode.rate_hz.is_some_and(|hz| (hz - f64::from(*fps)).abs() > 0.5));
    if let Some(asked) = asked {
        notes.push(format!("colour at {asked} a second is not offered: it is {mode}"));
    }
    notes.iter().for_each(|note| log::warn!("{note}"));
    notes
}

fn times_in_words(flags: u32) -> &'static str {
    match (clock::is_monotonic(flags), clock::is_of_exposure(flags)) {
        (true, true) => "colour is dated by the driver, at the start of its exposure",
        (true, false) => "colour is dated by the driver, when its last byte came",
        (false, _) => {
            "the driver does not say when a picture was taken: colour is dated when it is read"
        }
    }
}

impl ColorCamera for V4lCamera {
    fn info(&self) -> &DeviceInfo {
        &self.info
    }

    fn size(&self) -> Size {
        self.size
    }

    fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    fn wait(&mut self, timeout: Duration) -> Result<Option<ColorPicture>, DeviceError> {
        let (unpacker, threads, started) = (&mut self.unpacker, &self.threads, self.started);
        let mut undated = false;
        let read = |filled: Filled| {
            let arrived = Instant::now();
            let bad = |why: &str| {
                DeviceError::BadFrame(format!("colour picture {}: {why}", filled.sequence))
            };
            if filled.flags & sys::V4L2_BUF_FLAG_ERROR != 0 {
                return Err(bad("the driver marks it as damaged"));
            }
            let taken = clock::taken(filled.timestamp, filled.flags, started);
            undated = taken.is_none();
            let taken = taken.unwrap_or(arrived);
            if arrived.saturating_duration_since(taken) > STALE {
                return Ok(None);
            }
            let pixels = threads.install(|| unpacker.picture(filled.bytes)).map_err(|e| bad(&e))?;
            Ok(Some(ColorPicture { taken, pixels }))
        };
        let picture = self.buffers.next(timeout, read);
        let picture =
            picture.map_err(|e| error::explain(&self.node.path, "waiting for a picture", &e))?;
        if undated && !std::mem::replace(&mut self.said_undated, true) {
            log::warn!(
                "{}: a picture without a time that can be: dated when it is read",
                self.info.uri
            );
        }
        picture.unwrap_or(Ok(None))
    }

    fn hold_exposure(&mut self) -> Result<(), String> {
        controls::hold(&*self.node)
    }
}
