//! Depth sensors and `.oni` recordings through OpenNI2, which is loaded where it is installed.
//!
//! [`OpenniDriver`] gives live frames, [`OniSource`] those of a recording, [`OniRecorder`] makes one.
//! Below them: [`Runtime`], [`Device`], [`Stream`] and [`FrameRef`] own what the C interface hands out.

mod beside;
mod camera;
mod clock;
mod device;
mod device_handle;
mod feed;
mod ffi;
mod file;
mod library;
mod modes;
mod pairing;
mod picture;
pub mod probe;
mod recorder;
mod runtime;

pub use device::{OpenniDevice, OpenniDriver, OpenniOptions};
pub use device_handle::{Device, FrameRef, Sensor, Stream};
pub use ffi::VideoMode;
pub use file::{OniInfo, OniOptions, OniSource};
pub use library::{INSTALL_ADVICE, LIBRARY_VARIABLE};
pub use probe::{LoadedLibrary, SensorDetail};
pub use recorder::{OniFiles, OniRecorder};
pub use runtime::{FoundDevice, Runtime};
