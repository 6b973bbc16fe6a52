//! What a colour camera beside a depth sensor gives.

use super::{DeviceError, DeviceInfo};
use crate::image::{Image, Size};
use std::time::{Duration, Instant};

/// One picture of a colour camera.
#[derive(Clone, Debug)]
pub struct ColorPicture {
    /// When it was taken, by the host's clock, as well as the driver knows.
    pub taken: Instant,
    /// 8-bit sRGB.
    pub pixels: Image<[u8; 3]>,
}

/// Opens a colour camera, again where it was lost.
pub trait ColorDriver: Send {
    fn open(&mut self) -> Result<Box<dyn ColorCamera>, DeviceError>;
}

/// A colour camera that streams. It is stopped and closed when dropped.
pub trait ColorCamera: Send {
    fn info(&self) -> &DeviceInfo;

    /// Of every picture.
    fn size(&self) -> Size;

    /// Nominal pictures a second.
    fn rate_hz(&self) -> f64;

    /// The next picture; `None` where none came within `timeout`, which may be exceeded by what a driver call
    /// takes. After [`DeviceError::Lost`] the camera is of no more use.
    fn wait(&mut self, timeout: Duration) -> Result<Option<ColorPicture>, DeviceError>;

    /// Exposure and white balance stay as they are now.
    ///
    /// # Errors
    /// Says what cannot be held and stays automatic.
    fn hold_exposure(&mut self) -> Result<(), String>;
}
