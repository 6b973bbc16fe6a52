//! A colour camera beside the sensor: its pictures, and depth in its time.

use super::clock::Tick;
use super::pairing::MOST_WAITING;
use crate::capture::live::{ColorCamera, ColorCapture, DeviceError, DeviceInfo, HostClock};
use crate::image::{Image, Size};
use std::time::{Duration, Instant};

/// When a picture was taken, and the picture.
type Dated = (f64, Image<[u8; 3]>);

/// Times are seconds of the host's clock since `epoch`.
pub struct Beside {
    capture: ColorCapture,
    info: DeviceInfo,
    size: Size,
    rate_hz: f64,
    delay_s: f64,
    depth_clock: HostClock,
    epoch: Instant,
}

impl Beside {
    /// Its pictures come from another thread: a wait for depth looks so often whether there is one.
    pub const LOOK_EVERY: Duration = Duration::from_millis(5);

    /// `delay_s`: by how much colour is dated later than depth of the same moment.
    pub fn start(
        camera: Box<dyn ColorCamera>,
        delay_s: f64,
        epoch: Instant,
    ) -> Result<Self, DeviceError> {
        Ok(Self {
            info: camera.info().clone(),
            size: camera.size(),
            rate_hz: camera.rate_hz(),
            capture: ColorCapture::start(camera)?,
            delay_s,
            depth_clock: HostClock::default(),
            epoch,
        })
    }

    pub fn info(&self) -> &DeviceInfo {
        &self.info
    }

    pub fn size(&self) -> Size {
        self.size
    }

    pub fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    pub fn capture(&self) -> &ColorCapture {
        &self.capture
    }

    /// Whether pictures that far apart can wait for each other.
    pub fn check(&self, period_s: f64) -> Result<(), String> {
        let most_s = (MOST_WAITING - 1) as f64 * period_s;
        if self.delay_s.abs() <= most_s {
            return Ok(());
        }
        let (delay_ms, most_ms) = (self.delay_s * 1e3, most_s * 1e3);
        Err(format!(
            "a colour delay of {delay_ms:.0} ms: at this rate pictures wait for each other up to \
             {most_ms:.0} ms"
        ))
    }

    /// The next picture, if there is one.
    pub fn take(&self) -> Result<Option<Dated>, DeviceError> {
        let Some(picture) = self.capture.take()? else { return Ok(None) };
        if picture.pixels.size() != self.size {
            let (found, size) = (picture.pixels.size(), self.size);
            return Err(DeviceError::BadFrame(format!("a colour picture of {found}, not {size}")));
        }
        Ok(Some((self.since_epoch_s(picture.taken) - self.delay_s, picture.pixels)))
    }

    /// When a depth frame was taken that came at `arrived`.
    pub fn host_s(&mut self, device: &Tick, arrived: Instant) -> f64 {
        if device.jump_s.is_some() {
            self.depth_clock.forget();
        }
        self.depth_clock.tell(device.seconds, self.since_epoch_s(arrived))
    }

    /// Pictures may be older than the epoch.
    fn since_epoch_s(&self, at: Instant) -> f64 {
        at.saturating_duration_since(self.epoch).as_secs_f64()
            - self.epoch.saturating_duration_since(at).as_secs_f64()
    }
}
