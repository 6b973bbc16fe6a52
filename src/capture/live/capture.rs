//! The thread that calls the driver.

use super::back_off::BackOff;
use super::queue::{Call, Shared};
use super::source::{Delivery, LiveOptions};
use super::{DeviceError, LiveDevice, LiveDriver};
use crate::capture::RawFrame;
use crate::math::Pinhole;
use std::sync::{Arc, Mutex, TryLockError};
use std::time::{Duration, Instant};

/// How long a device may wait for a frame before it looks whether it should stop.
const WAIT: Duration = Duration::from_millis(100);

/// A call may take this much longer than the longest time without a frame, before its thread is replaced:
/// where it returns, the thread itself sees that there was none.
const OVERDUE: Duration = Duration::from_millis(500);

/// The thread that an earlier one left stuck in the driver is told apart by its `generation`.
pub(super) struct Capture {
    pub shared: Arc<Shared>,
    /// Held only while a device is opened, so that a thread which is stuck in a device leaves it free.
    pub driver: Arc<Mutex<Box<dyn LiveDriver>>>,
    pub generation: usize,
    pub options: LiveOptions,
}

impl Capture {
    /// Until it is stopped, outdated, or there is nothing more to come.
    pub fn run(self) {
        let leaving = Leaving(&self);
        let mut back_off = BackOff::new(self.options.reopen_first, self.options.reopen_longest);
        while self.is_current() {
            let Some(mut device) = self.open(&mut back_off) else { continue };
            self.stream(&mut *device, &mut back_off);
            self.in_driver(self.options.open_timeout, || drop(device));
        }
        drop(leaving);
    }

    fn is_current(&self) -> bool {
        let state = self.shared.lock();
        state.is_current(self.generation) && state.ended.is_none()
    }

    /// Runs a call of the driver, so that others see whether it still returns.
    fn in_driver<T>(&self, may_take: Duration, call: impl FnOnce() -> T) -> T {
        let note = |call| {
            let mut state = self.shared.lock();
            if state.generation == self.generation {
                state.call = call;
            }
        };
        note(Some(Call { since: Instant::now(), may_take }));
        let result = call();
        note(None);
        result
    }

    /// Opens the device, or waits a while where that fails.
    fn open(&self, back_off: &mut BackOff) -> Option<Box<dyn LiveDevice>> {
        let opened = self.in_driver(self.options.open_timeout, || match self.driver.try_lock() {
            Ok(mut driver) => driver.open(),
            Err(TryLockError::Poisoned(driver)) => driver.into_inner().open(),
            Err(TryLockError::WouldBlock) => {
                Err(DeviceError::Busy("the driver is still opening it".into()))
            }
        });
        let mut state = self.shared.lock();
        if !state.is_current(self.generation) {
            return None;
        }
        state.counts.attempts += usize::from(state.outage.is_some());
        let problem = match (opened, &state.opened) {
            (Ok(device), None) => {
                state.opened = Some(Ok((device.info().clone(), device.camera())));
                self.shared.tell_all();
                return Some(device);
            }
            (Ok(device), Some(Ok((_, camera)))) if device.camera() == *camera => {
                return Some(device);
            }
            (Ok(_), Some(_)) => DeviceError::Unsupported(
                "the device came back with another camera: size or focal length differ".into(),
            ),
            (Err(error), None) => {
                state.opened = Some(Err(error));
                state.end(None);
                self.shared.tell_all();
                return None;
            }
            (Err(error), Some(_)) => error,
        };
        log::debug!("camera not opened: {problem}");
        let down = state.outage.as_ref().map(|outage| outage.since.elapsed());
        let given_up =
            self.options.give_up_after.zip(down).is_some_and(|(most, down)| down >= most);
        if given_up || matches!(problem, DeviceError::Unsupported(_)) {
            state.end(Some(problem));
            self.shared.tell_all();
            return None;
        }
        drop(state);
        self.rest(back_off.next());
        None
    }

    /// Takes frames until the device is lost, stalls, or is no longer wanted.
    fn stream(&self, device: &mut dyn LiveDevice, back_off: &mut BackOff) {
        let camera = device.camera();
        let mut last_good = Instant::now();
        // A device that was just opened may take longer.
        let mut limit = self.options.stall.max(self.options.first_frame);
        while self.is_current() {
            let given = self.in_driver(limit + OVERDUE, || device.wait(WAIT));
            let at = Instant::now();
            match given {
                Ok(Some(frame)) => match self.put(frame, at, &camera) {
                    Ok(()) => {
                        // The queue may have been full for long.
                        last_good = Instant::now();
                        limit = self.options.stall;
                        back_off.reset();
                    }
                    Err(reason) => self.bad(&reason),
                },
                Ok(None) => {}
                Err(DeviceError::BadFrame(reason)) => self.bad(&reason),
                Err(DeviceError::Ended) => return self.end(None),
                Err(error @ DeviceError::Unsupported(_)) => return self.end(Some(error)),
                Err(error) => {
                    self.outage(&error.to_string());
                    return self.rest(back_off.next());
                }
            }
            if last_good.elapsed() > limit {
                let stall_s = last_good.elapsed().as_secs_f64();
                self.outage(&format!("no good frame for {stall_s:.1} s"));
                return self.rest(back_off.next());
            }
        }
    }

    /// Hands a frame over; waits for room where none may be dropped.
    fn put(&self, frame: RawFrame, at: Instant, camera: &Pinhole) -> Result<(), String> {
        check_size(&frame, camera)?;
        let mut state = self.shared.lock();
        if !state.is_current(self.generation) {
            return Ok(());
        }
        let arrived = state.accept(frame, at)?;
        match self.options.delivery {
            Delivery::Newest { capacity } => {
                while state.frames.len() >= capacity.max(1) {
                    state.frames.pop_front();
                    state.counts.dropped += 1;
                }
            }
            Delivery::Every => {
                while state.is_current(self.generation) && !state.frames.is_empty() {
                    state = self.shared.wait(state, WAIT);
                }
            }
        }
        state.frames.push_back(arrived);
        self.shared.tell_all();
        Ok(())
    }

    fn bad(&self, reason: &str) {
        self.shared.lock().note_bad(reason);
        // A driver that gives nothing else must not take a core.
        std::thread::sleep(Duration::from_millis(1));
    }

    fn end(&self, error: Option<DeviceError>) {
        let mut state = self.shared.lock();
        if state.is_current(self.generation) {
            state.end(error);
            self.shared.tell_all();
        }
    }

    fn outage(&self, reason: &str) {
        let mut state = self.shared.lock();
        if state.is_current(self.generation) {
            state.begin_outage(reason);
        }
    }

    /// Sleeps, but wakes when the run stops.
    fn rest(&self, time: Duration) {
        let until = Instant::now() + time;
        let mut state = self.shared.lock();
        while state.is_current(self.generation)
            && let Some(left) = until.checked_duration_since(Instant::now())
        {
            state = self.shared.wait(state, left);
        }
    }
}

fn check_size(frame: &RawFrame, camera: &Pinhole) -> Result<(), String> {
    let expected = camera.size();
    for (what, size) in [("colour", frame.color.size()), ("depth", frame.depth_m.size())] {
        if size != expected {
            return Err(format!("its {what} picture is {size}, the camera is {expected}"));
        }
    }
    Ok(())
}

/// Says that the thread has left, also where the driver panicked.
struct Leaving<'a>(&'a Capture);

impl Drop for Leaving<'_> {
    fn drop(&mut self) {
        let mut state = self.0.shared.lock();
        if state.generation != self.0.generation {
            state.stuck -= 1;
            return;
        }
        if std::thread::panicking() {
            let error = DeviceError::Lost("the camera's driver panicked".into());
            if state.opened.is_none() {
                state.opened = Some(Err(error.clone()));
            }
            state.end(Some(error));
        }
        state.left = true;
        drop(state);
        self.0.shared.tell_all();
    }
}
