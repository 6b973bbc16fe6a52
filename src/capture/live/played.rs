//! A recording that plays as a device: frames come at their times, or as fast as they are taken.

use super::{DeviceError, DeviceInfo, LiveDevice, LiveDriver};
use crate::capture::{
    CaptureError, CaptureOptions, FrameSource, RawFrame, Sequence, open_sequence,
};
use crate::math::Pinhole;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// For how long a device that was lost on purpose is not there.
const AWAY: Duration = Duration::from_millis(250);

/// Plays the recording of a folder.
pub struct PlayedDriver {
    folder: PathBuf,
    paced: bool,
    looped: bool,
    progress: Arc<Mutex<Progress>>,
}

/// It goes on from device to device, as the room before a camera does.
#[derive(Debug, Default)]
struct Progress {
    /// Frames played, or passed over.
    next: usize,
    /// When the first frame was due.
    began: Option<Instant>,
    lose_at: Vec<usize>,
    lost: Option<Instant>,
}

impl PlayedDriver {
    /// `paced`: frames come no sooner than their times say, and are over when nobody takes them.
    pub fn new(folder: &Path, paced: bool) -> Self {
        Self { folder: folder.to_owned(), paced, looped: false, progress: Arc::default() }
    }

    /// Plays it forth and back without end, so that the camera's path has no jump; times go on rising.
    pub fn looped(self, looped: bool) -> Self {
        Self { looped, ..self }
    }

    /// Loses the device before each of these frames, once each.
    pub fn losing_device_before(self, frames: &[usize]) -> Self {
        self.progress().lose_at = frames.to_vec();
        self
    }

    fn progress(&self) -> std::sync::MutexGuard<'_, Progress> {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl LiveDriver for PlayedDriver {
    fn open(&mut self) -> Result<Box<dyn LiveDevice>, DeviceError> {
        if self.progress().lost.is_some_and(|lost| lost.elapsed() < AWAY) {
            return Err(DeviceError::Absent("the played device is away".into()));
        }
        // Decoding shares no threads with the run: it must not wait for a stage of the pipeline.
        let threads = rayon::ThreadPoolBuilder::new().num_threads(1).build();
        let threads = threads.map_err(|error| DeviceError::Lost(error.to_string()))?;
        let recording = open_sequence(&self.folder, &CaptureOptions::default())
            .map_err(|error| DeviceError::Absent(error.to_string()))?;
        let mut device = PlayedDevice {
            info: info(&self.folder, &recording),
            recording,
            threads,
            paced: self.paced,
            looped: self.looped,
            progress: self.progress.clone(),
        };
        device.pass_over_what_is_gone();
        Ok(Box::new(device))
    }
}

fn info(folder: &Path, recording: &Sequence) -> DeviceInfo {
    let found = recording.info();
    let from = |what: &str, source: &str| format!("{what}: {source}");
    DeviceInfo {
        uri: format!("play:{}", folder.display()),
        vendor: "kinlight".into(),
        name: "recording".into(),
        modes: vec![format!("{} registered frames of {}", found.pairs, recording.camera().size())],
        notes: vec![from("layout", found.layout.name()), from("camera", &found.camera_from)],
    }
}

struct PlayedDevice {
    info: DeviceInfo,
    recording: Sequence,
    threads: rayon::ThreadPool,
    paced: bool,
    looped: bool,
    progress: Arc<Mutex<Progress>>,
}

impl PlayedDevice {
    /// The frame of the recording that is played as number `played`, and its time after the first one's;
    /// `None` after the last.
    fn frame_at(&self, played: usize) -> Option<(usize, f64)> {
        let since_first = |index: usize| {
            Some(self.recording.timestamp_s(index)? - self.recording.timestamp_s(0)?)
        };
        let last = self.recording.pairs().checked_sub(1)?;
        if !self.looped || last == 0 {
            return Some((played, since_first(played)?));
        }
        let (round, at) = (played / last, played % last);
        let whole_s = since_first(last)?;
        let (index, in_round_s) = match round.is_multiple_of(2) {
            true => (at, since_first(at)?),
            false => (last - at, whole_s - since_first(last - at)?),
        };
        Some((index, round as f64 * whole_s + in_round_s))
    }

    /// When a frame is due; frames after the last are never.
    fn due(&self, played: usize, began: Instant) -> Option<Instant> {
        let (_, at_s) = self.frame_at(played)?;
        Some(began + Duration::try_from_secs_f64(at_s).unwrap_or_default())
    }

    /// What a camera that was away has not seen.
    fn pass_over_what_is_gone(&mut self) {
        let mut progress = self.progress.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(began) = progress.began.filter(|_| self.paced) else { return };
        let now = Instant::now();
        while self.due(progress.next, began).is_some_and(|due| due < now) {
            progress.next += 1;
        }
    }
}

impl LiveDevice for PlayedDevice {
    fn info(&self) -> &DeviceInfo {
        &self.info
    }

    fn camera(&self) -> Pinhole {
        self.recording.camera()
    }

    fn wait(&mut self, timeout: Duration) -> Result<Option<RawFrame>, DeviceError> {
        let mut progress = self.progress.lock().unwrap_or_else(PoisonError::into_inner);
        let played = progress.next;
        let Some((index, since_first_s)) = self.frame_at(played) else {
            return Err(DeviceError::Ended);
        };
        if let Some(lose) = progress.lose_at.iter().position(|&at| at <= played) {
            progress.lose_at.swap_remove(lose);
            progress.lost = Some(Instant::now());
            return Err(DeviceError::Lost("the played device went away".into()));
        }
        let began = *progress.began.get_or_insert_with(Instant::now);
        drop(progress);
        if let (true, Some(due)) = (self.paced, self.due(played, began)) {
            let early = due.saturating_duration_since(Instant::now());
            std::thread::sleep(early.min(timeout));
            if early > timeout {
                return Ok(None);
            }
        }
        self.progress.lock().unwrap_or_else(PoisonError::into_inner).next = played + 1;
        let recording = &mut self.recording;
        match self.threads.install(|| recording.frame(index)) {
            Ok(frame) if played == index => Ok(Some(frame)),
            Ok(frame) => {
                let first_s = recording.timestamp_s(0).unwrap_or_default();
                Ok(Some(RawFrame { timestamp_s: first_s + since_first_s, ..frame }))
            }
            Err(error @ CaptureError::Frame { .. }) => {
                Err(DeviceError::BadFrame(error.to_string()))
            }
            Err(error) => Err(DeviceError::Lost(error.to_string())),
        }
    }
}
