//! Recorded poses: TUM text, Redwood logs, 4x4 matrices. All become `world_from_camera`.

use super::{CaptureError, text};
use crate::math::{Pose, pose_from_xyzw};
use nalgebra::{Matrix3, Matrix4, Rotation3, Translation3, UnitQuaternion};
use std::path::Path;

/// Between two samples further apart than this, a pose is not interpolated: a hand-held camera
/// accelerates within a tenth of a second.
pub const MAX_GAP_S: f64 = 0.1;

/// How far `R^T R` may be from the identity, and a quaternion from unit length. Files round to 4 digits
/// and more; trackers drift by less than this before they re-orthogonalise.
const RIGID_TOLERANCE: f64 = 0.01;

/// Poses sorted by time.
#[derive(Clone, Debug, Default)]
pub struct Trajectory {
    samples: Vec<(f64, Pose)>,
}

impl Trajectory {
    /// Sorts by time; of equal times the first is kept. Times must be finite.
    pub fn new(mut samples: Vec<(f64, Pose)>) -> Self {
        samples.sort_by(|a, b| a.0.total_cmp(&b.0));
        samples.dedup_by(|later, earlier| later.0 == earlier.0);
        Self { samples }
    }

    pub fn len(&self) -> usize {
        self.samples.len()
    }

    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    pub fn map(&mut self, change: impl Fn(&Pose) -> Pose) {
        for (_, pose) in &mut self.samples {
            *pose = change(pose);
        }
    }

    /// The pose at a time: translation linear, rotation spherical between the samples around it.
    /// `None` outside the recorded time and where the samples are more than `max_gap` apart.
    pub fn at(&self, time: f64, max_gap: f64) -> Option<Pose> {
        let after = self.samples.partition_point(|(t, _)| *t < time);
        let (t1, next) = self.samples.get(after)?;
        if *t1 == time {
            return Some(*next);
        }
        let (t0, last) = self.samples.get(after.checked_sub(1)?)?;
        if t1 - t0 > max_gap {
            return None;
        }
        let share = (time - t0) / (t1 - t0);
        let translation = last.translation.vector.lerp(&next.translation.vector, share);
        // Opposite rotations have no shortest way; none occur within a tenth of a second.
        let rotation = last.rotation.try_slerp(&next.rotation, share, 1e-9)?;
        Some(Pose::from_parts(translation.into(), rotation))
    }
}

/// Reads `timestamp tx ty tz qx qy qz qw` lines. A line that is no rigid pose is left out with a
/// warning; a line that is no pose at all is an error.
pub fn read_tum(path: &Path, warnings: &mut Vec<String>) -> Result<Trajectory, CaptureError> {
    let mut samples = Vec::new();
    for (number, line) in text::lines(&text::read(path)?) {
        let values = text::numbers(line).map_err(|p| CaptureError::line(path, number, p))?;
        let &[t, tx, ty, tz, qx, qy, qz, qw] = values.as_slice() else {
            let problem =
                format!("{} numbers; a pose line has 8: t tx ty tz qx qy qz qw", values.len());
            return Err(CaptureError::line(path, number, problem));
        };
        let length = (qx * qx + qy * qy + qz * qz + qw * qw).sqrt();
        let pose = pose_from_xyzw([tx, ty, tz], [qx, qy, qz, qw])
            .filter(|_| t.is_finite() && (length - 1.0).abs() <= RIGID_TOLERANCE);
        match pose {
            Some(pose) => samples.push((t, pose)),
            None => {
                warnings.push(format!("{}:{number}: not a rigid pose, left out", path.display()))
            }
        }
    }
    let backwards = samples.windows(2).filter(|w| w[1].0 <= w[0].0).count();
    if backwards > 0 {
        warnings.push(format!(
            "{}: {backwards} poses are not later than the one before; sorted by time, the first of equal times is kept",
            path.display()
        ));
    }
    Ok(Trajectory::new(samples))
}

/// Reads a Redwood `.log`: blocks of a line of three integers and a camera-to-world 4x4. The result is
/// indexed by the first integer; `None` where a block is absent or not rigid.
pub fn read_log(
    path: &Path,
    warnings: &mut Vec<String>,
) -> Result<Vec<Option<Pose>>, CaptureError> {
    let content = text::read(path)?;
    let mut lines = text::lines(&content);
    let mut poses = Vec::new();
    while let Some((number, head)) = lines.next() {
        let at = |problem: String| CaptureError::line(path, number, problem);
        let index = head.split_whitespace().next().and_then(|w| w.parse::<usize>().ok());
        let index =
            index.ok_or_else(|| at(format!("\"{head}\" does not start with a frame number")))?;
        // A number far beyond the file's length would only take memory.
        if index > content.len() {
            return Err(at(format!("frame number {index} is out of range")));
        }
        let mut rows = [[0.0; 4]; 4];
        for row in &mut rows {
            let (n, line) = lines.next().ok_or_else(|| at("matrix is cut off".into()))?;
            *row = row_of_4(line).map_err(|p| CaptureError::line(path, n, p))?;
        }
        if poses.len() <= index {
            poses.resize(index + 1, None);
        }
        match pose_from_rows(&rows) {
            Ok(pose) => poses[index] = Some(pose),
            Err(problem) => {
                warnings.push(format!("{}:{number}: {problem}; left out", path.display()));
            }
        }
    }
    Ok(poses)
}

/// Reads a file that holds one camera-to-world 4x4.
pub fn read_matrix(path: &Path) -> Result<Pose, CaptureError> {
    let mut rows = [[0.0; 4]; 4];
    let content = text::read(path)?;
    let mut lines = text::lines(&content);
    for row in &mut rows {
        let (n, line) =
            lines.next().ok_or_else(|| CaptureError::file(path, "fewer than 4 rows"))?;
        *row = row_of_4(line).map_err(|p| CaptureError::line(path, n, p))?;
    }
    pose_from_rows(&rows).map_err(|p| CaptureError::file(path, p))
}

fn row_of_4(line: &str) -> Result<[f64; 4], String> {
    let values = text::numbers(line)?;
    let count = values.len();
    values.try_into().map_err(|_| format!("{count} numbers; a row of a 4x4 has 4"))
}

/// A rigid pose from matrix rows; the rotation is replaced by the nearest exact one.
pub fn pose_from_rows(rows: &[[f64; 4]; 4]) -> Result<Pose, String> {
    if rows.as_flattened().iter().any(|v| !v.is_finite()) {
        return Err("pose is not finite".into());
    }
    if rows[3] != [0.0, 0.0, 0.0, 1.0] {
        return Err(format!("last row of the pose is {:?}, not 0 0 0 1", rows[3]));
    }
    let m = Matrix4::from_fn(|r, c| rows[r][c]);
    let rotation: Matrix3<f64> = m.fixed_view::<3, 3>(0, 0).into_owned();
    let off = (rotation.transpose() * rotation - Matrix3::identity()).amax();
    if off > RIGID_TOLERANCE || rotation.determinant() < 0.0 {
        let determinant = rotation.determinant();
        return Err(format!("pose is not rigid: |R'R - 1| = {off:.3}, det R = {determinant:.3}"));
    }
    let svd = rotation.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
        return Err("pose has no rotation".into());
    };
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(u * v_t));
    Ok(Pose::from_parts(Translation3::new(rows[0][3], rows[1][3], rows[2][3]), rotation))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    fn turned(angle: f64, x: f64) -> Pose {
        Pose::new(Vector3::new(x, 0.0, 0.0), Vector3::y() * angle)
    }

    #[test]
    fn between_two_samples_rotation_and_translation_take_their_share() {
        let track = Trajectory::new(vec![(1.1, turned(0.4, 2.0)), (1.0, turned(0.0, 1.0))]);
        let pose = track.at(1.025, MAX_GAP_S * 1.01).unwrap();
        let error = pose.inverse() * turned(0.1, 1.25);
        assert!(error.translation.vector.norm() < 1e-12 && error.rotation.angle() < 1e-12);
    }

    #[test]
    fn nothing_is_made_up_outside_or_across_a_gap() {
        let track = Trajectory::new(vec![(1.0, turned(0.0, 0.0)), (1.2, turned(0.1, 0.0))]);
        assert!(track.at(1.1, MAX_GAP_S).is_none());
        assert!(track.at(0.99, MAX_GAP_S).is_none() && track.at(1.21, MAX_GAP_S).is_none());
        assert!(track.at(1.0, MAX_GAP_S).is_some() && track.at(1.2, MAX_GAP_S).is_some());
        assert!(Trajectory::default().at(0.0, 1.0).is_none());
    }

    #[test]
    fn scaled_sheared_mirrored_and_broken_matrices_are_refused() {
        let good = turned(0.3, 1.0).to_homogeneous();
        let rows = |m: Matrix4<f64>| std::array::from_fn(|r| std::array::from_fn(|c| m[(r, c)]));
        let pose = pose_from_rows(&rows(good)).unwrap();
        assert!((pose.to_homogeneous() - good).amax() < 1e-12);
        let mirrored = good * Matrix4::from_diagonal(&nalgebra::Vector4::new(1.0, -1.0, 1.0, 1.0));
        let scaled = good * Matrix4::from_diagonal(&nalgebra::Vector4::new(1.1, 1.1, 1.1, 1.0));
        let mut broken = good;
        broken[(1, 3)] = f64::NAN;
        let mut projective = good;
        projective[(3, 2)] = 0.1;
        for bad in [mirrored, scaled, broken, projective] {
            assert!(pose_from_rows(&rows(bad)).is_err());
        }
    }
}
