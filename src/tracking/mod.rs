//! Camera pose from depth: frame-to-model projective ICP (Newcombe et al. 2011), loss and recovery.
//!
//! ```text
//! depth ─> bilateral ─> pyramid (depth, normals) ─┐
//! model picture ──────────────────────────────────┴─> registration ─> judgement ─> state, pose
//!                                                       (association, 6x6 sums, solve)
//! ```
//!
//! The states know nothing of where pictures lie: what they need of a device is the trait `PicturePair`.
//! [`Tracker`] is that of the host's memory.
//!
//! Choices that the paper leaves open:
//! - Partners are looked up in the full-size model picture at every level; the frame alone has a pyramid.
//!   Alignment is computed in the axes of the model's view, so the distance from the world's origin costs
//!   no precision.
//! - Pairs weigh by the inverse variance of a Kinect's depth noise, with a Huber limit. Without the
//!   noise weights the error per frame grows by 15 to 30 %; the Huber limit hardly matters beside the
//!   distance gate.
//! - The next pose is guessed by constant velocity. At full rate it changes nothing; at every 8th frame of a
//!   hand-held recording all frames are tracked instead of half of them.
//! - Success is judged by the share of those pixels that *fall on the map*, so that looking at new places
//!   is no fault. On real recordings right alignments have a share of 0.6 to 0.95, wrong ones below 0.5;
//!   the RMS does not tell them apart (7 mm occurs in both).
//! - Right alignments of real recordings have conditions up to 1400, a noisy wall at 1.5 m above 10 000
//!   once ten frames are averaged (at 2.5 m 5000 after thirty): hence `min_eigenvalue_ratio`.

mod bilateral;
mod follower;
mod host;
mod judgement;
mod keyframes;
mod normal_equations;
mod padded;
mod picture_pair;
mod pyramid;
mod registration;
mod solve;

#[cfg(test)]
mod tests;

#[cfg(feature = "gpu")]
pub(crate) use bilateral::Bilateral;
#[cfg(feature = "gpu")]
pub(crate) use follower::Follower;
pub use host::Tracker;
#[cfg(feature = "gpu")]
pub(crate) use keyframes::{COLUMNS, MIN_CELL_DEPTH, ROWS, Thumbnail};
#[cfg(feature = "gpu")]
pub(crate) use normal_equations::{DEPTH_NOISE, Gates, Sums, TERMS, rows_of_inverse};
#[cfg(all(test, feature = "gpu"))]
pub(crate) use normal_equations::{ModelView, Reduction};
pub use picture_pair::FrameTag;
#[cfg(feature = "gpu")]
pub(crate) use picture_pair::{ModelPicture, PicturePair};
#[cfg(all(test, feature = "gpu"))]
pub(crate) use pyramid::Pyramid;
#[cfg(feature = "gpu")]
pub(crate) use pyramid::{DEPTH_RANGE_M, edge_m, level_cameras};

use crate::math::Pose;

/// Kernels work on this many pixels at a time.
const LANES: usize = 16;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PoseMode {
    #[default]
    Track,
    /// Poses of the recording.
    Recorded,
    /// The camera does not move.
    Static,
}

/// What to do when the camera is lost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OnLost {
    /// End the run.
    Stop,
    /// Keep the last pose and try again from there.
    Hold,
    /// Forget the map and start anew at the last pose.
    Reset,
    /// Compare with keyframes and continue from the one that fits.
    #[default]
    Relocalise,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum TrackingState {
    Init,
    Tracking,
    /// A pose is given, but not one to fuse with.
    Degraded,
    Lost,
    Relocalising,
}

/// Why a pose is not trusted.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum TrackingIssue {
    /// The frame is not of the camera's size.
    WrongSize {
        width: usize,
        height: usize,
    },
    /// Nothing of the map is in view.
    NoModel,
    /// Little of the frame's depth falls on surfaces that the map knows.
    LittleOverlap {
        share: f32,
    },
    NoDepth {
        valid_share: f32,
    },
    FewInliers {
        share: f32,
    },
    LargeResidual {
        rms_m: f32,
    },
    /// The 6x6 system leaves motions open; `rank` of 6 were observable.
    Underconstrained {
        rank: usize,
    },
    ImplausibleMotion {
        translation_m: f32,
        rotation_rad: f32,
    },
    /// The recording has no pose for this frame.
    NoRecordedPose,
}

impl std::fmt::Display for TrackingIssue {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::WrongSize { width, height } => write!(f, "a frame of {width}x{height} pixels"),
            Self::NoModel => write!(f, "nothing of the map in view"),
            Self::LittleOverlap { share } => write!(f, "{:.1} % fall on the map", 100.0 * share),
            Self::NoDepth { valid_share } => {
                write!(f, "{:.1} % of the pixels have depth", 100.0 * valid_share)
            }
            Self::FewInliers { share } => write!(f, "{:.1} % fit the map", 100.0 * share),
            Self::LargeResidual { rms_m } => {
                write!(f, "residual of {:.1} mm", 1e3 * rms_m)
            }
            Self::Underconstrained { rank } => {
                write!(f, "{rank} of 6 motions can be observed")
            }
            Self::ImplausibleMotion { translation_m, rotation_rad } => write!(
                f,
                "a step of {:.0} mm and {:.1} degrees",
                1e3 * translation_m,
                rotation_rad.to_degrees()
            ),
            Self::NoRecordedPose => write!(f, "the recording has no pose"),
        }
    }
}

/// Result for one frame. Losing the camera is a result, not an error.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Tracking {
    #[serde(skip)]
    pub world_from_camera: Pose,
    pub state: TrackingState,
    pub issue: Option<TrackingIssue>,
    /// Of the pixels that fall on surfaces of the map, those that fit it. This and the numbers below are
    /// 0 where no alignment was made.
    pub inlier_share: f32,
    /// Of the pixels with depth, those that fall on surfaces of the map.
    pub overlap: f32,
    /// Point-to-plane RMS over the inliers.
    pub rms_m: f32,
    /// Largest over smallest eigenvalue of the 6x6 system (translations in units of the mean depth).
    pub condition: f64,
    pub rank: usize,
}

impl Tracking {
    /// Only a frame that is well tracked may change the map.
    pub fn may_fuse(&self) -> bool {
        matches!(self.state, TrackingState::Init | TrackingState::Tracking)
    }
}

/// Reconstruct stage, camera part.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrackingParams {
    pub mode: PoseMode,
    pub on_lost: OnLost,
    /// Iterations per level, finest first.
    pub iterations: Vec<usize>,
    /// Bilateral filter of the depth: radius in pixels, standard deviations in pixels and metres.
    pub filter_radius: usize,
    pub filter_sigma_px: f32,
    pub filter_sigma_m: f32,
    /// Partners further apart than this, or with normals at a larger angle, are no partners.
    pub max_distance_m: f32,
    pub max_angle_rad: f32,
    /// Iteration stops where the step is smaller (metres and radians).
    pub convergence: f64,
    /// Below: degraded; below 0.7 of it: lost.
    pub min_inlier_share: f32,
    /// Below: degraded; below 0.7 of it: lost.
    pub min_overlap: f32,
    /// Above: degraded; above twice of it: lost.
    pub max_rms_m: f32,
    /// Lost after this many degraded frames in a row, not counting those that are well aligned but
    /// leave motions open.
    pub max_degraded_frames: usize,
    /// Eigenvalues of the 6x6 system below this share of the largest are not observable.
    pub min_eigenvalue_ratio: f64,
    /// A step from one frame to the next beyond this is implausible.
    pub max_step_m: f32,
    pub max_step_rad: f32,
}

impl Default for TrackingParams {
    fn default() -> Self {
        Self {
            mode: PoseMode::default(),
            on_lost: OnLost::default(),
            iterations: vec![10, 5, 4],
            filter_radius: 3,
            filter_sigma_px: 3.0,
            filter_sigma_m: 0.03,
            max_distance_m: 0.1,
            max_angle_rad: 0.5,
            convergence: 1e-5,
            min_inlier_share: 0.5,
            min_overlap: 0.1,
            max_rms_m: 0.03,
            max_degraded_frames: 10,
            min_eigenvalue_ratio: 2e-4,
            max_step_m: 0.3,
            max_step_rad: 0.5,
        }
    }
}
