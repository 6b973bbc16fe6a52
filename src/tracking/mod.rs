//! Camera pose from depth: frame-to-model projective ICP (Newcombe et al. 2011), loss and recovery.

use crate::math::Pose;

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
    NoModel,
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

/// Result for one frame. Losing the camera is a result, not an error.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Tracking {
    #[serde(skip)]
    pub world_from_camera: Pose,
    pub state: TrackingState,
    pub issue: Option<TrackingIssue>,
    /// Share of valid depth pixels that found a partner.
    pub inlier_share: f32,
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
    /// Below: degraded; below half of it: lost.
    pub min_inlier_share: f32,
    /// Above: degraded; above twice of it: lost.
    pub max_rms_m: f32,
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
            min_inlier_share: 0.3,
            max_rms_m: 0.03,
            min_eigenvalue_ratio: 1e-5,
            max_step_m: 0.3,
            max_step_rad: 0.5,
        }
    }
}
