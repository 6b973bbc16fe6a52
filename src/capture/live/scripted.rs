//! A device that does what a test says.

use super::{DeviceError, DeviceInfo, LiveDevice, LiveDriver};
use crate::capture::RawFrame;
use crate::image::{Image, Size};
use crate::math::Pinhole;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

pub const SIZE: Size = Size::new(4, 3);

/// One thing that a device does when it is asked for a frame.
#[derive(Clone, Debug)]
pub enum Act {
    /// At this time of the device.
    Frame(f64),
    /// A frame of another size.
    Small(f64),
    Fail(DeviceError),
    /// No frame for this long, in pieces of the timeout.
    Silence(Duration),
    /// The call does not return until the script is released.
    Hang,
    Panic,
}

/// One after another, over all openings.
#[derive(Clone, Default)]
pub struct Script {
    acts: Arc<Mutex<VecDeque<Act>>>,
    /// Errors of the openings to come.
    pub openings: Arc<Mutex<VecDeque<DeviceError>>>,
    pub opened: Arc<AtomicUsize>,
    pub closed: Arc<AtomicUsize>,
    released: Arc<AtomicBool>,
    /// What opening takes.
    pub opening: Duration,
    /// Whether the second and later openings give another camera.
    pub other_camera: bool,
}

impl Script {
    pub fn new(acts: impl IntoIterator<Item = Act>) -> Self {
        let acts = Arc::new(Mutex::new(acts.into_iter().collect()));
        Self { acts, ..Self::default() }
    }

    pub fn frames(times: impl IntoIterator<Item = f64>) -> impl Iterator<Item = Act> {
        times.into_iter().map(Act::Frame)
    }

    pub fn driver(&self) -> Box<dyn LiveDriver> {
        Box::new(self.clone())
    }

    /// Lets calls that hang return.
    pub fn release(&self) {
        self.released.store(true, Ordering::SeqCst);
    }
}

impl LiveDriver for Script {
    fn open(&mut self) -> Result<Box<dyn LiveDevice>, DeviceError> {
        std::thread::sleep(self.opening);
        if let Some(error) = self.openings.lock().unwrap().pop_front() {
            return Err(error);
        }
        let before = self.opened.fetch_add(1, Ordering::SeqCst);
        let fx = if self.other_camera && before > 0 { 6.0 } else { 5.0 };
        Ok(Box::new(Scripted { script: self.clone(), info: DeviceInfo::default(), fx }))
    }
}

struct Scripted {
    script: Script,
    info: DeviceInfo,
    fx: f32,
}

impl Drop for Scripted {
    fn drop(&mut self) {
        self.script.closed.fetch_add(1, Ordering::SeqCst);
    }
}

impl LiveDevice for Scripted {
    fn info(&self) -> &DeviceInfo {
        &self.info
    }

    fn camera(&self) -> Pinhole {
        let Size { width, height } = SIZE;
        Pinhole { width, height, fx: self.fx, fy: 5.0, cx: 1.5, cy: 1.0 }
    }

    fn wait(&mut self, timeout: Duration) -> Result<Option<RawFrame>, DeviceError> {
        let act = self.script.acts.lock().unwrap().pop_front();
        match act.unwrap_or(Act::Fail(DeviceError::Ended)) {
            Act::Frame(time_s) => Ok(Some(frame(SIZE, time_s))),
            Act::Small(time_s) => Ok(Some(frame(Size::new(2, 3), time_s))),
            Act::Fail(error) => Err(error),
            Act::Silence(time) => {
                std::thread::sleep(time.min(timeout));
                if let Some(left) = time.checked_sub(timeout).filter(|left| !left.is_zero()) {
                    self.script.acts.lock().unwrap().push_front(Act::Silence(left));
                }
                Ok(None)
            }
            Act::Hang => {
                while !self.script.released.load(Ordering::SeqCst) {
                    std::thread::sleep(Duration::from_millis(5));
                }
                Ok(None)
            }
            Act::Panic => panic!("as the script says"),
        }
    }
}

fn frame(size: Size, timestamp_s: f64) -> RawFrame {
    RawFrame {
        index: 77, // the device's own count is nobody's concern
        timestamp_s,
        color: Image::new(size, [1, 2, 3]),
        depth_m: Image::new(size, 1.5),
        world_from_camera: None,
        exposure_s: None,
    }
}
