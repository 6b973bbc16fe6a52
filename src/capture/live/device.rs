//! What every driver of a camera gives.

use crate::capture::RawFrame;
use crate::math::Pinhole;
use std::time::Duration;

/// What a device is, for people and for records.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct DeviceInfo {
    /// By which it is opened again.
    pub uri: String,
    pub vendor: String,
    pub name: String,
    /// Of each stream: kind, size, format, frames a second.
    pub modes: Vec<String>,
    /// What the driver does and what is done here: registration, synchronisation, exposure, white balance.
    pub notes: Vec<String>,
}

/// Why a device gives no frames.
#[derive(Clone, Debug, thiserror::Error)]
pub enum DeviceError {
    /// The runtime library or kernel module is missing; the text names what to install.
    #[error("{0}")]
    NoDriver(String),
    /// None is there, or none of that name.
    #[error("{0}")]
    Absent(String),
    /// Another program has it, or its permissions forbid; the text says what to do.
    #[error("{0}")]
    Busy(String),
    /// It was there and is no longer: opening it again may help.
    #[error("{0}")]
    Lost(String),
    /// It does not do what was asked; trying again does not help.
    #[error("{0}")]
    Unsupported(String),
    /// One frame is no good; the next may be.
    #[error("{0}")]
    BadFrame(String),
    /// A recording that is played as a device has come to its end, which is no fault.
    #[error("the recording has come to its end")]
    Ended,
}

/// Opens a device, again where it was lost.
pub trait LiveDriver: Send {
    fn open(&mut self) -> Result<Box<dyn LiveDevice>, DeviceError>;
}

/// A device that streams. It is stopped and closed when dropped.
pub trait LiveDevice: Send {
    fn info(&self) -> &DeviceInfo;

    /// Of the colour picture, to which depth is registered in every frame.
    fn camera(&self) -> Pinhole;

    /// The next pair of depth and colour, at the device's time in seconds; `None` where none came within
    /// `timeout`, which may be exceeded by what a driver call takes. After [`DeviceError::Lost`] the device is
    /// of no more use.
    fn wait(&mut self, timeout: Duration) -> Result<Option<RawFrame>, DeviceError>;
}
