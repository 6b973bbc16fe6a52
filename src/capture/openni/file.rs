//! `.oni` recordings as a source of frames, played by OpenNI2 itself.

use super::camera::{self, Known};
use super::device_handle::{Device, Stream};
use super::feed::{ColorSource, Feed, Streams};
use super::ffi::VideoMode;
use super::runtime::Runtime;
use crate::capture::{CaptureError, FrameSource, RawFrame};
use crate::image::Size;
use crate::math::Pinhole;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// A player that has delivered nothing in this time never will.
const PATIENCE: Duration = Duration::from_secs(2);

/// It decodes one frame in this time, nearly always.
const SETTLE: Duration = Duration::from_millis(50);

/// What may be said about a recording instead of being found out.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OniOptions {
    pub calibration: Option<PathBuf>,
    /// Depth units per metre.
    pub depth_factor: Option<f64>,
}

/// What a recording says of itself.
#[derive(Clone, Debug, PartialEq)]
pub struct OniInfo {
    /// Depth and colour frames in the file.
    pub counts: [usize; 2],
    /// Of depth and of colour pictures.
    pub sizes: [Size; 2],
    /// Nominal frames a second; 30 where it does not say.
    pub rate_hz: f64,
    /// Depth units per metre.
    pub depth_factor: f64,
    /// Of delivered frames, and where it is from.
    pub camera: Pinhole,
    pub camera_from: String,
    /// Depth counts as recorded through the colour camera.
    pub registered: bool,
    /// Frames are undistorted as they are read.
    pub undistorted: bool,
    /// What was assumed.
    pub notes: Vec<String>,
}

/// An opened recording. Frames come in order; going back opens it again, because the player's own seeking
/// crashes.
#[derive(Debug)]
pub struct OniSource {
    path: PathBuf,
    options: OniOptions,
    info: OniInfo,
    /// `None` after it could not be opened again.
    player: Option<Player>,
    next: usize,
}

/// OpenNI2's player of recordings, and how to live with its thread. That thread walks the list of streams
/// without a lock, whenever it is not waiting for its next frame to be asked for: a stream that is destroyed
/// meanwhile crashes it.
struct Player {
    /// `None` only while it is dropped.
    feed: Option<Feed>,
    device: Arc<Device>,
    /// The thread has met something that it cannot read, and goes round without ever waiting.
    astray: bool,
    _claim: Claim,
}

impl Drop for Player {
    fn drop(&mut self) {
        if self.astray {
            // Streams that stay are better than a crash.
            std::mem::forget(self.feed.take());
        } else {
            // After a frame the thread needs a moment to read the next and wait. It always does: the player
            // is set to start over at the end.
            std::thread::sleep(SETTLE);
        }
    }
}

impl std::fmt::Debug for Player {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Player").field("file", self.device.found()).finish_non_exhaustive()
    }
}

/// A file that is being played: the library would give a second reader the first one's player, at its place.
struct Claim(PathBuf);

static PLAYING: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

impl Claim {
    fn new(path: &Path) -> Result<Self, String> {
        let real = path.canonicalize().map_err(|e| e.to_string())?;
        let mut playing = PLAYING.lock().unwrap_or_else(PoisonError::into_inner);
        if !playing.insert(real.clone()) {
            return Err("it is being read already; OpenNI2 plays a file once at a time".into());
        }
        Ok(Self(real))
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        PLAYING.lock().unwrap_or_else(PoisonError::into_inner).remove(&self.0);
    }
}

impl OniSource {
    /// # Errors
    /// OpenNI2 is not there, the file is no recording with depth and colour, or nothing can be assumed of
    /// its camera.
    pub fn open(path: &Path, options: &OniOptions) -> Result<Self, CaptureError> {
        // Said by the system, not by OpenNI2, which only says that it cannot.
        std::fs::File::open(path).map_err(|e| CaptureError::io(path, e))?;
        let opened = Player::open(path, options).map_err(|why| CaptureError::file(path, why))?;
        let (path, options) = (path.to_owned(), options.clone());
        Ok(Self { path, options, info: opened.1, player: Some(opened.0), next: 0 })
    }

    pub fn info(&self) -> &OniInfo {
        &self.info
    }

    /// One pair, wherever the source is; the source goes on after it.
    pub fn frame(&mut self, index: usize) -> Result<RawFrame, CaptureError> {
        if index < self.next || self.player.is_none() {
            self.player = None;
            let opened = Player::open(&self.path, &self.options);
            self.player = Some(opened.map_err(|why| CaptureError::file(&self.path, why))?.0);
            self.next = 0;
        }
        loop {
            let wanted = self.next == index;
            match self.advance(wanted) {
                Ok(Some(frame)) if wanted => return Ok(frame),
                Err(error) if wanted => return Err(error),
                // Before the one that is wanted; each counts.
                Ok(Some(_)) | Err(_) => {}
                Ok(None) => {
                    let problem = format!("the recording ends after {} pairs", self.next);
                    return Err(CaptureError::Frame { frame: index, problem });
                }
            }
        }
    }

    /// The next pair; only counted where `process` is off. A pair that cannot be delivered is an error and
    /// counts, too.
    fn advance(&mut self, process: bool) -> Result<Option<RawFrame>, CaptureError> {
        let (frame, counts) = (self.next, self.info.counts);
        let Some(player) = &mut self.player else { return Ok(None) };
        let step = player.pair(counts, process);
        if !matches!(step, Ok(None)) {
            self.next += 1;
        }
        let problem = |problem| CaptureError::Frame { frame, problem };
        step.map(|pair| pair.map(|pair| RawFrame { index: frame, ..pair })).map_err(problem)
    }
}

impl Player {
    fn open(path: &Path, options: &OniOptions) -> Result<(Self, OniInfo), String> {
        let claim = Claim::new(path)?;
        let runtime = Runtime::get().map_err(|e| e.to_string())?;
        let device = runtime.open_file(path).map_err(|why| {
            format!("OpenNI2 cannot play it ({why}): no .oni recording, or one without its index")
        })?;
        let device = Arc::new(device);
        let streams = Streams::new(&device)?;
        let modes = streams.modes()?;
        device.play_by_request().map_err(|e| format!("playing frame by frame: {e}"))?;
        let counts = [&streams.depth, &streams.color].map(Stream::frame_count);
        let [Some(depths), Some(colors)] = counts else {
            return Err("it does not say how many frames it has".into());
        };
        let setup = camera::set_up(&Known {
            depth: modes[0],
            color_size: camera::size(&modes[1]),
            color_fov: streams.color.fov(),
            registered: device.registration(),
            calibration: options.calibration.as_deref(),
            depth_factor: options.depth_factor,
        })?;
        let mut notes = setup.notes.clone();
        if streams.color.is_mirrored() || streams.depth.is_mirrored() {
            notes.push("recorded mirrored, and turned round as frames are read".into());
        }
        let info = OniInfo {
            counts: [depths, colors],
            sizes: modes.map(|m| camera::size(&m)),
            rate_hz: rate_hz(&modes[1]),
            depth_factor: options.depth_factor.unwrap_or_else(|| camera::depth_factor(&modes[0])),
            camera: setup.rig.camera,
            camera_from: setup.camera_from.clone(),
            registered: setup.registered,
            undistorted: setup.rig.undistorts(),
            notes,
        };
        let color = ColorSource::Sensor(streams.color);
        let feed = Feed::new(streams.depth, color, setup, false)?;
        feed.start()?;
        Ok((Self { feed: Some(feed), device, astray: false, _claim: claim }, info))
    }

    /// The next pair, or `None` behind the last. Every wait has an end, also where a file was cut off.
    fn pair(&mut self, counts: [usize; 2], process: bool) -> Result<Option<RawFrame>, String> {
        let (file, Some(feed)) = (&self.device.found().uri, &mut self.feed) else {
            return Ok(None);
        };
        loop {
            if let Some(pair) = feed.take(process)? {
                return Ok(Some(pair));
            }
            if self.astray || feed.started_over || (0..2).all(|i| feed.highest[i] >= counts[i]) {
                return Ok(None);
            }
            let read = feed.read(PATIENCE);
            for jump_s in feed.jumps_s.drain(..) {
                log::warn!("{file}: times jump by {jump_s:.3} s");
            }
            self.astray = !read.map_err(|e| e.to_string())?;
            if self.astray || feed.started_over {
                let highest = feed.highest;
                log::warn!("{file}: of {counts:?} depth and colour frames {highest:?} can be read");
            }
        }
    }
}

fn rate_hz(mode: &VideoMode) -> f64 {
    if mode.fps > 0 { f64::from(mode.fps) } else { crate::capture::layout::ASSUMED_RATE_HZ }
}

impl FrameSource for OniSource {
    fn camera(&self) -> Pinhole {
        self.info.camera
    }

    /// At most: frames without a partner are not delivered.
    fn len(&self) -> Option<usize> {
        Some(self.info.counts[0].min(self.info.counts[1]))
    }

    fn next_frame(&mut self) -> Result<Option<RawFrame>, CaptureError> {
        self.advance(true)
    }
}
