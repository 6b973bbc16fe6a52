//! What a run leaves behind: pictures, paths, light, meshes, timings, video.
//!
//! Whole files are written under a temporary name in the same folder and then renamed, so that a
//! reader, or a run that was killed, never sees half of one. Logs grow by whole lines, and are
//! valid after each.

mod atomic;
mod buffers;
mod environment;
mod light_log;
mod lines;
mod mesh_file;
mod picture;
mod run_writer;
mod timing_recorder;
mod timings;
mod trajectory_file;
mod video;

pub use atomic::atomic_write;
pub use buffers::{Range, depth_picture, normal_picture, origin_picture, value_picture};
pub use environment::{Panorama, write_environment};
pub use light_log::{LightLog, LightRecord};
pub use lines::LineWriter;
pub use mesh_file::write_ply;
pub use picture::{DEPTH_UNITS_PER_M, write_color_png, write_depth_png};
pub use run_writer::{BufferPicture, OutputPlan, RunWriter};
pub use timing_recorder::TimingRecorder;
pub use timings::{
    FrameTiming, Quantiles, TimingSummary, TimingsLog, csv_field, stage_table, write_timings_json,
};
pub use trajectory_file::TrajectoryWriter;
pub use video::{Video, VideoStart};

use std::path::Path;

#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    #[error(
        "{path}: no space left on the disk; what was written before is whole. \
         Free some space, or choose another output folder"
    )]
    DiskFull { path: String },
    #[error("{path}: cannot write: {source}")]
    Io { path: String, source: std::io::Error },
    #[error("{path}: {problem}")]
    Content { path: String, problem: String },
}

impl OutputError {
    /// Of a file or folder that cannot be written.
    pub(crate) fn io(path: &Path, source: std::io::Error) -> Self {
        let path = path.display().to_string();
        let full = [std::io::ErrorKind::StorageFull, std::io::ErrorKind::QuotaExceeded];
        match source.kind() {
            kind if full.contains(&kind) => OutputError::DiskFull { path },
            _ => OutputError::Io { path, source },
        }
    }

    pub(crate) fn content(path: &Path, problem: impl Into<String>) -> Self {
        OutputError::Content { path: path.display().to_string(), problem: problem.into() }
    }
}

/// The error behind an encoder's, which wraps those of the disk.
fn from_encoder(error: image::ImageError) -> std::io::Error {
    match error {
        image::ImageError::IoError(error) => error,
        other => std::io::Error::other(other.to_string()),
    }
}
