//! What the capture thread and the taker of its frames share.

use super::clock::{DeviceClock, Told};
use super::source::{Delivery, LiveOptions};
use super::{DeviceError, DeviceInfo, LiveCounts};
use crate::capture::RawFrame;
use crate::math::Pinhole;
use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

pub(super) struct Arrived {
    pub frame: RawFrame,
    /// At this machine.
    pub at: Instant,
}

/// A call of the driver that has not returned.
#[derive(Clone, Copy, Debug)]
pub(super) struct Call {
    pub since: Instant,
    /// It is given up after this long.
    pub may_take: Duration,
}

impl Call {
    pub fn is_stuck(&self) -> bool {
        self.since.elapsed() > self.may_take
    }
}

/// Since when there is no device.
pub(super) struct Outage {
    pub since: Instant,
}

pub(super) struct State {
    pub frames: VecDeque<Arrived>,
    pub counts: LiveCounts,
    pub clock: DeviceClock,
    pub outage: Option<Outage>,
    /// What the first device that was opened is, or why there is none.
    pub opened: Option<Result<(DeviceInfo, Pinhole), DeviceError>>,
    /// There will be no more frames; the error is taken out when it is told.
    pub ended: Option<Option<DeviceError>>,
    pub stopped: bool,
    /// Number of the capture thread that counts. One that a driver does not let go of is replaced by the
    /// next, and finds itself outdated should it ever return.
    pub generation: usize,
    /// Where that thread is inside the driver.
    pub call: Option<Call>,
    /// Outdated threads that are still in the driver.
    pub stuck: usize,
    /// Whether the thread that counts has left.
    pub left: bool,
}

/// Locks never wait for a driver: nothing calls one while it holds this.
pub(super) struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

impl Shared {
    pub fn new(options: &LiveOptions) -> Self {
        let state = State {
            frames: VecDeque::new(),
            counts: LiveCounts::default(),
            clock: DeviceClock::new(options.delivery != Delivery::Every),
            outage: None,
            opened: None,
            ended: None,
            stopped: false,
            generation: 0,
            call: None,
            stuck: 0,
            left: false,
        };
        Self { state: Mutex::new(state), changed: Condvar::new() }
    }

    /// A thread that panicked while it held the lock (none should) leaves a state that is still whole.
    pub fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn tell_all(&self) {
        self.changed.notify_all();
    }

    pub fn wait<'a>(
        &self,
        state: MutexGuard<'a, State>,
        at_most: Duration,
    ) -> MutexGuard<'a, State> {
        let (state, _) =
            self.changed.wait_timeout(state, at_most).unwrap_or_else(PoisonError::into_inner);
        state
    }

    pub fn stop(&self) {
        self.lock().stopped = true;
        self.tell_all();
    }

    pub fn counts(&self) -> LiveCounts {
        let state = self.lock();
        let down_s = state.outage.as_ref().map_or(0.0, |o| o.since.elapsed().as_secs_f64());
        LiveCounts { down_s: state.counts.down_s + down_s, ..state.counts }
    }
}

impl State {
    pub fn is_current(&self, generation: usize) -> bool {
        !self.stopped && self.generation == generation
    }

    pub fn end(&mut self, error: Option<DeviceError>) {
        self.ended.get_or_insert(error);
    }

    /// Notes, once for each, that the device is gone.
    pub fn begin_outage(&mut self, reason: &str) {
        if self.outage.is_none() {
            log::warn!("camera lost: {reason}; it is opened again");
            self.counts.outages += 1;
            self.outage = Some(Outage { since: Instant::now() });
        }
    }

    fn end_outage(&mut self) {
        if let Some(outage) = self.outage.take() {
            let down = outage.since.elapsed();
            self.counts.recoveries += 1;
            self.counts.down_s += down.as_secs_f64();
            log::info!("camera back after {} ms", down.as_millis());
        }
    }

    /// A good frame ends an outage; its time is made to rise.
    ///
    /// # Errors
    /// Says why the frame is no good.
    pub fn accept(&mut self, mut frame: RawFrame, at: Instant) -> Result<Arrived, String> {
        frame.timestamp_s = match self.clock.tell(frame.timestamp_s, at) {
            Told::Time(time_s) => time_s,
            Told::Jump { time_s, by_s } => {
                self.counts.clock_jumps += 1;
                if self.counts.clock_jumps == 1 {
                    log::warn!(
                        "the camera's clock jumped by {by_s:.3} s: times are shifted so that they rise \
                         (said once; jumps are counted)"
                    );
                }
                time_s
            }
            Told::None => {
                return Err(format!("its time is {}, again or not at all", frame.timestamp_s));
            }
        };
        self.end_outage();
        self.counts.captured += 1;
        Ok(Arrived { frame, at })
    }

    pub fn note_bad(&mut self, reason: &str) {
        self.counts.bad += 1;
        match self.counts.bad {
            1 => log::warn!("bad frame left out: {reason} (said once; they are counted)"),
            _ => log::debug!("bad frame left out: {reason}"),
        }
    }
}
