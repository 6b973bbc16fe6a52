//! Is an alignment the truth? What is below a limit is poor, what is far below it wrong.

use super::registration::Fit;
use super::{TrackingIssue, TrackingParams};
use crate::math::Pose;

/// A share below this part of its limit is not only poor but wrong.
const LOST_SHARE: f32 = 0.7;

/// What one frame came to, before the states are looked at.
pub(super) enum Verdict {
    Good(Fit),
    Poor(Fit, TrackingIssue),
    Bad(Option<Fit>, TrackingIssue),
}

/// `before` is the pose of the frame before, where the motion since then is to be plausible.
pub(super) fn judge(fit: Option<Fit>, before: Option<&Pose>, params: &TrackingParams) -> Verdict {
    let Some(fit) = fit.filter(|fit| fit.overlap > 0.0) else {
        return Verdict::Bad(fit, TrackingIssue::NoModel);
    };
    let step = before.map_or_else(Pose::identity, |b| b.inverse() * fit.world_from_camera);
    let (metres, radians) = (step.translation.vector.norm(), step.rotation.angle());
    let implausible =
        metres > f64::from(params.max_step_m) || radians > f64::from(params.max_step_rad);
    let overlap = TrackingIssue::LittleOverlap { share: fit.overlap };
    let inliers = TrackingIssue::FewInliers { share: fit.inlier_share };
    let residual = TrackingIssue::LargeResidual { rms_m: fit.rms_m };
    if implausible {
        let (translation_m, rotation_rad) = (metres as f32, radians as f32);
        let issue = TrackingIssue::ImplausibleMotion { translation_m, rotation_rad };
        Verdict::Bad(Some(fit), issue)
    } else if fit.overlap < LOST_SHARE * params.min_overlap {
        Verdict::Bad(Some(fit), overlap)
    } else if fit.inlier_share < LOST_SHARE * params.min_inlier_share {
        Verdict::Bad(Some(fit), inliers)
    } else if fit.rms_m > 2.0 * params.max_rms_m {
        Verdict::Bad(Some(fit), residual)
    } else if fit.overlap < params.min_overlap {
        Verdict::Poor(fit, overlap)
    } else if fit.inlier_share < params.min_inlier_share {
        Verdict::Poor(fit, inliers)
    } else if fit.rms_m > params.max_rms_m {
        Verdict::Poor(fit, residual)
    } else if fit.rank < 6 {
        Verdict::Poor(fit, TrackingIssue::Underconstrained { rank: fit.rank })
    } else {
        Verdict::Good(fit)
    }
}
