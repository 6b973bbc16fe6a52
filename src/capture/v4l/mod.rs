//! Colour cameras through V4L2, on Linux.
//!
//! [`V4lDriver`] opens one to stand beside a depth sensor; [`nodes`] says what there is.

mod buffers;
mod camera;
mod clock;
mod controls;
mod encoding;
mod error;
mod modes;
mod node;
mod report;

pub use camera::{V4lDriver, V4lOptions};
pub use report::{FormatReport, NodeReport, nodes};
