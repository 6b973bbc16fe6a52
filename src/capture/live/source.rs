//! A live camera as a source of frames.

use super::capture::Capture;
use super::queue::{Call, Shared, State};
use super::{DeviceError, DeviceInfo, LiveCounts, LiveDriver, LiveSummary};
use crate::capture::{Arrival, CaptureError, FrameSource, RawFrame};
use crate::math::Pinhole;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Which frames reach the taker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Delivery {
    /// The newest ones: of `capacity` frames that wait, the oldest is dropped for a new one.
    Newest { capacity: usize },
    /// All of them: the device waits for the taker. For recordings that are played as devices.
    Every,
}

#[derive(Clone, Debug)]
pub struct LiveOptions {
    pub delivery: Delivery,
    /// A device that gives no good frame for this long is opened again; for its first it may take
    /// `first_frame`, where that is longer.
    pub stall: Duration,
    pub first_frame: Duration,
    /// Time between attempts to open it: the first, and the longest that the doubling leads to.
    pub reopen_first: Duration,
    pub reopen_longest: Duration,
    /// The source ends where the device stays away for longer.
    pub give_up_after: Option<Duration>,
    /// For opening and closing.
    pub open_timeout: Duration,
    /// How long the end of the source waits for the driver before it leaves the capture thread behind.
    pub close_timeout: Duration,
    /// The source ends after this many frames, or this long after it was opened.
    pub most_frames: Option<usize>,
    pub most_time: Option<Duration>,
}

impl Default for LiveOptions {
    fn default() -> Self {
        Self {
            delivery: Delivery::Newest { capacity: 1 },
            stall: Duration::from_secs(2),
            first_frame: Duration::from_secs(6),
            reopen_first: Duration::from_millis(100),
            reopen_longest: Duration::from_secs(5),
            give_up_after: None,
            open_timeout: Duration::from_secs(15),
            close_timeout: Duration::from_millis(1500),
            most_frames: None,
            most_time: None,
        }
    }
}

/// So many threads may be stuck in the driver at once; with one more it is hopeless.
const MOST_STUCK: usize = 4;

/// Frames of a camera that is running, in order and with rising times, numbered as they are delivered.
///
/// A device that is lost or stalls is opened again, without an end unless one is set; frames after a gap
/// carry their times. A driver call that does not return is left behind in its thread, and the device is
/// opened anew by another.
pub struct LiveSource {
    shared: Arc<Shared>,
    driver: Arc<Mutex<Box<dyn LiveDriver>>>,
    options: LiveOptions,
    info: DeviceInfo,
    camera: Pinhole,
    began: Instant,
    arrival: Option<Arrival>,
}

/// Looks at a source, and ends it, from another thread.
#[derive(Clone)]
pub struct Monitor(Arc<Shared>);

impl Monitor {
    pub fn counts(&self) -> LiveCounts {
        self.0.counts()
    }

    /// Ends the source: whoever waits for a frame is told that there are no more.
    pub fn stop(&self) {
        self.0.stop();
    }

    /// Whether the device is gone, for now.
    pub fn is_down(&self) -> bool {
        self.0.lock().outage.is_some()
    }
}

impl LiveSource {
    /// Opens the device and starts to capture.
    ///
    /// # Errors
    /// The device cannot be opened, or not in time.
    pub fn open(driver: Box<dyn LiveDriver>, options: LiveOptions) -> Result<Self, DeviceError> {
        let shared = Arc::new(Shared::new(&options));
        let driver = Arc::new(Mutex::new(driver));
        start_thread(&shared, &driver, 0, &options)?;
        let deadline = Instant::now() + options.open_timeout;
        let mut state = shared.lock();
        let (info, camera) = loop {
            if let Some(opened) = &state.opened {
                break opened.clone()?;
            }
            let Some(left) = deadline.checked_duration_since(Instant::now()) else {
                state.stopped = true;
                let waited_s = options.open_timeout.as_secs_f64();
                return Err(DeviceError::Lost(format!(
                    "the driver has not opened the device within {waited_s:.0} s"
                )));
            };
            state = shared.wait(state, left);
        };
        drop(state);
        Ok(Self { shared, driver, options, info, camera, began: Instant::now(), arrival: None })
    }

    pub fn info(&self) -> &DeviceInfo {
        &self.info
    }

    pub fn monitor(&self) -> Monitor {
        Monitor(self.shared.clone())
    }

    pub fn counts(&self) -> LiveCounts {
        self.shared.counts()
    }

    /// Waits for the next frame; `None` at the end.
    fn take(&mut self) -> Result<Option<(RawFrame, Instant)>, DeviceError> {
        let shared = self.shared.clone();
        let mut state = shared.lock();
        loop {
            if state.stopped || self.is_over(state.counts.delivered) {
                return Ok(None);
            }
            if let Some(arrived) = state.frames.pop_front() {
                let mut frame = arrived.frame;
                frame.index = state.counts.delivered;
                state.counts.delivered += 1;
                state.counts.last_age = arrived.at.elapsed();
                shared.tell_all();
                return Ok(Some((frame, arrived.at)));
            }
            if let Some(ended) = &mut state.ended {
                return ended.take().map_or(Ok(None), Err);
            }
            if let Some(call) = state.call.filter(Call::is_stuck) {
                self.replace(&mut state, call)?;
            }
            state = shared.wait(state, Duration::from_millis(50));
        }
    }

    fn is_over(&self, delivered: usize) -> bool {
        let enough = self.options.most_frames.is_some_and(|most| delivered >= most);
        enough || self.options.most_time.is_some_and(|most| self.began.elapsed() >= most)
    }

    /// Leaves the capture thread in the driver call that does not return, and starts another.
    fn replace(&self, state: &mut State, call: Call) -> Result<(), DeviceError> {
        if state.stuck == MOST_STUCK {
            state.stopped = true;
            let reason = format!("{MOST_STUCK} calls of its driver have not returned");
            return Err(DeviceError::Lost(reason));
        }
        let stuck_s = call.since.elapsed().as_secs_f64();
        state.begin_outage(&format!("its driver has not returned for {stuck_s:.1} s"));
        state.stuck += 1;
        state.generation += 1;
        state.call = None;
        start_thread(&self.shared, &self.driver, state.generation, &self.options)
    }
}

fn start_thread(
    shared: &Arc<Shared>,
    driver: &Arc<Mutex<Box<dyn LiveDriver>>>,
    generation: usize,
    options: &LiveOptions,
) -> Result<(), DeviceError> {
    let (shared, driver, options) = (shared.clone(), driver.clone(), options.clone());
    let capture = Capture { shared, driver, generation, options };
    std::thread::Builder::new()
        .name("capture".into())
        .spawn(move || capture.run())
        .map(drop) // whether it has left is in the shared state
        .map_err(|error| DeviceError::Lost(format!("no capture thread: {error}")))
}

impl FrameSource for LiveSource {
    fn camera(&self) -> Pinhole {
        self.camera
    }

    /// Of a camera nobody knows how many frames there will be.
    fn len(&self) -> Option<usize> {
        None
    }

    /// The next frame; `None` at the end. An error is the camera's end.
    fn next_frame(&mut self) -> Result<Option<RawFrame>, CaptureError> {
        let asked = Instant::now();
        let taken = self.take().map_err(|error| {
            CaptureError::Sequence(format!("camera {}: {error}", self.info.uri))
        })?;
        Ok(taken.map(|(frame, at)| {
            self.arrival = Some(Arrival { waited: asked.elapsed(), age: at.elapsed() });
            frame
        }))
    }

    fn arrival(&self) -> Option<Arrival> {
        self.arrival
    }

    fn live(&self) -> Option<LiveSummary> {
        Some(LiveSummary { device: self.info.clone(), counts: self.counts() })
    }
}

/// Stops the capture thread; where its driver does not return, it is left behind.
impl Drop for LiveSource {
    fn drop(&mut self) {
        self.shared.stop();
        let deadline = Instant::now() + self.options.close_timeout;
        let mut state = self.shared.lock();
        while !state.left {
            let Some(left) = deadline.checked_duration_since(Instant::now()) else {
                log::warn!("the camera's driver does not return; its thread is left behind");
                return;
            };
            state = self.shared.wait(state, left);
        }
    }
}
