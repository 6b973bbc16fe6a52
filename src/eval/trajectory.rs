//! Camera paths: absolute trajectory error and relative pose error as the TUM RGB-D benchmark
//! defines them (Sturm et al. 2012, Sec. V).

mod align;

#[cfg(test)]
mod tests;

pub use align::{Alignment, Degeneracy, align};

use super::EvalError;
use crate::math::Pose;

/// Poses further apart in time are not of the same frame (the TUM tools' default).
pub const MATCH_TOLERANCE_S: f64 = 0.02;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimedPose {
    pub timestamp_s: f64,
    pub world_from_camera: Pose,
}

/// Summary of a set of errors, in their own unit.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct ErrorStatistics {
    pub rmse: f64,
    pub mean: f64,
    pub median: f64,
    pub max: f64,
}

/// Absolute trajectory error: distances between camera centres after the best rigid alignment
/// (rotation and translation, no scale).
#[derive(Clone, Debug, serde::Serialize)]
pub struct AbsoluteError {
    pub matched: usize,
    /// Poses of the estimate and of the reference, matched or not.
    pub estimated: usize,
    pub reference: usize,
    pub translation_m: ErrorStatistics,
    /// Set where the path leaves part of the alignment open. The error itself is the same for
    /// every best alignment, but says little: few motions were put to the test.
    pub degeneracy: Option<Degeneracy>,
    #[serde(skip)]
    pub reference_from_estimate: Pose,
}

/// Relative pose error: motion over `step` matched poses, estimate against reference.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub struct RelativeError {
    pub pairs: usize,
    pub step: usize,
    pub translation_m: ErrorStatistics,
    pub rotation_deg: ErrorStatistics,
}

/// Pairs (estimate, reference) of indices within `tolerance_s`: nearest in time first, each pose
/// used once, in order of the estimate's time.
pub fn associate(
    estimate: &[TimedPose],
    reference: &[TimedPose],
    tolerance_s: f64,
) -> Vec<(usize, usize)> {
    let mut by_time: Vec<usize> = (0..reference.len()).collect();
    by_time.sort_by(|&a, &b| reference[a].timestamp_s.total_cmp(&reference[b].timestamp_s));

    let mut candidates = Vec::new();
    for (e, pose) in estimate.iter().enumerate() {
        let earliest = pose.timestamp_s - tolerance_s;
        let first = by_time.partition_point(|&r| reference[r].timestamp_s < earliest);
        for &r in &by_time[first..] {
            let apart = (reference[r].timestamp_s - pose.timestamp_s).abs();
            if apart <= tolerance_s {
                candidates.push((apart, e, r));
            } else if reference[r].timestamp_s > pose.timestamp_s {
                break;
            }
        }
    }
    candidates.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));

    let mut estimate_taken = vec![false; estimate.len()];
    let mut reference_taken = vec![false; reference.len()];
    let mut pairs = Vec::new();
    for (_, e, r) in candidates {
        if !estimate_taken[e] && !reference_taken[r] {
            (estimate_taken[e], reference_taken[r]) = (true, true);
            pairs.push((e, r));
        }
    }
    pairs.sort_by(|a, b| estimate[a.0].timestamp_s.total_cmp(&estimate[b.0].timestamp_s));
    pairs
}

/// ATE of `estimate`. Fails with fewer than three matched poses.
pub fn absolute_error(
    estimate: &[TimedPose],
    reference: &[TimedPose],
    tolerance_s: f64,
) -> Result<AbsoluteError, EvalError> {
    let pairs = matched(estimate, reference, tolerance_s, 3)?;
    let centre = |pose: &TimedPose| pose.world_from_camera.translation.vector;
    let from: Vec<_> = pairs.iter().map(|&(e, _)| centre(&estimate[e])).collect();
    let to: Vec<_> = pairs.iter().map(|&(_, r)| centre(&reference[r])).collect();
    let Alignment { target_from_source, degeneracy } = align(&from, &to);
    let errors = from.iter().zip(&to).map(|(from, to)| {
        ((target_from_source * nalgebra::Point3::from(*from)).coords - to).norm()
    });
    Ok(AbsoluteError {
        matched: pairs.len(),
        estimated: estimate.len(),
        reference: reference.len(),
        translation_m: statistics(errors.collect())?,
        degeneracy,
        reference_from_estimate: target_from_source,
    })
}

/// RPE of `estimate` over `step` matched poses (1: from each to the next, that is drift a frame).
pub fn relative_error(
    estimate: &[TimedPose],
    reference: &[TimedPose],
    tolerance_s: f64,
    step: usize,
) -> Result<RelativeError, EvalError> {
    let step = step.max(1);
    let pairs = matched(estimate, reference, tolerance_s, step + 1)?;
    let (mut translations, mut rotations) = (Vec::new(), Vec::new());
    for (&(e0, r0), &(e1, r1)) in pairs.iter().zip(&pairs[step..]) {
        let motion = |poses: &[TimedPose], from: usize, to: usize| {
            poses[from].world_from_camera.inv_mul(&poses[to].world_from_camera)
        };
        let error = motion(reference, r0, r1).inv_mul(&motion(estimate, e0, e1));
        translations.push(error.translation.vector.norm());
        rotations.push(error.rotation.angle().to_degrees());
    }
    Ok(RelativeError {
        pairs: translations.len(),
        step,
        translation_m: statistics(translations)?,
        rotation_deg: statistics(rotations)?,
    })
}

fn matched(
    estimate: &[TimedPose],
    reference: &[TimedPose],
    tolerance_s: f64,
    needed: usize,
) -> Result<Vec<(usize, usize)>, EvalError> {
    let pairs = associate(estimate, reference, tolerance_s);
    if pairs.len() < needed {
        let (matched, estimated) = (pairs.len(), estimate.len());
        return Err(EvalError::FewMatches { matched, estimated, tolerance_s, needed });
    }
    Ok(pairs)
}

fn statistics(mut errors: Vec<f64>) -> Result<ErrorStatistics, EvalError> {
    if errors.iter().any(|e| !e.is_finite()) {
        return Err(EvalError::Undefined("a pose of the path is not finite".into()));
    }
    errors.sort_by(f64::total_cmp);
    let n = errors.len();
    let middle = errors[(n - 1) / 2] + errors[n / 2];
    Ok(ErrorStatistics {
        rmse: (errors.iter().map(|e| e * e).sum::<f64>() / n as f64).sqrt(),
        mean: errors.iter().sum::<f64>() / n as f64,
        median: 0.5 * middle,
        max: errors[n - 1],
    })
}
