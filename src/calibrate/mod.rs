//! Measures cameras: from pictures of boards, lit surfaces and charts to the calibration that every
//! source reads.
//!
//! Photometry is solved here: the [response] curve from an exposure stack, the [vignetting] from flat
//! fields, the colour matrix from a [chart]. So is the depth camera that delivers [disparities](disparity).
//! With the feature `opencv`, boards are found in pictures (`corners`), and lenses (`intrinsics`) and the place of a
//! depth camera beside the colour camera (`extrinsics`) are solved for.

pub mod board;
pub mod chart;
#[cfg(feature = "opencv")]
pub mod corners;
pub mod coverage;
#[cfg(feature = "opencv")]
mod crossing;
pub mod disparity;
#[cfg(feature = "opencv")]
pub mod extrinsics;
#[cfg(feature = "opencv")]
pub mod geometry;
#[cfg(feature = "opencv")]
pub mod intrinsics;
mod levenberg;
pub mod pictures;
pub mod response;
#[cfg(feature = "opencv")]
mod uncertainty;
pub mod vignetting;

use crate::capture::CaptureError;
use crate::output::OutputError;

#[derive(Debug, thiserror::Error)]
pub enum CalibrateError {
    #[error(transparent)]
    Capture(#[from] CaptureError),
    #[error(transparent)]
    Output(#[from] OutputError),
    /// What was asked for cannot be done, whatever the pictures hold.
    #[error("{0}")]
    Options(String),
    /// The pictures do not determine what was asked for.
    #[error("{0}")]
    Data(String),
    #[cfg(feature = "opencv")]
    #[error("OpenCV: {0}")]
    OpenCv(#[from] opencv::Error),
}
