//! Least-squares rigid alignment of two paths (Umeyama 1991, without scale).

use crate::math::Pose;
use nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// The best rigid transform, and what the points leave open in it.
#[derive(Clone, Debug)]
pub struct Alignment {
    pub target_from_source: Pose,
    pub degeneracy: Option<Degeneracy>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Degeneracy {
    /// One path, or both, stays in one point: any rotation fits as well; none is made.
    Standstill,
    /// One path, or both, is a straight line: any rotation about it fits as well.
    StraightLine,
}

impl std::fmt::Display for Degeneracy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Degeneracy::Standstill => {
                "the camera stands still in one of the paths: their rotation is not aligned"
            }
            Degeneracy::StraightLine => {
                "the camera moves on a straight line in one of the paths: rotation about it is open"
            }
        })
    }
}

/// Spread below this share of the coordinates, and singular values below this share of the largest,
/// are rounding: f64 keeps 2^-52 of a coordinate, and a path has some thousand poses.
const RELATIVE_ROUNDING: f64 = 1e-12;

/// Finds R, t that minimise sum |R source + t - target|^2 over equally long lists of points.
pub fn align(source: &[Vector3<f64>], target: &[Vector3<f64>]) -> Alignment {
    let (source_mean, target_mean) = (mean(source), mean(target));
    let (rotation, degeneracy) = match (spread(source, source_mean), spread(target, target_mean)) {
        (Some(source_spread), Some(target_spread)) => {
            let outer = |(s, t): (&Vector3<f64>, &Vector3<f64>)| {
                (t - target_mean) / target_spread * ((s - source_mean) / source_spread).transpose()
            };
            rotation_of(source.iter().zip(target).map(outer).sum())
        }
        _ => (UnitQuaternion::identity(), Some(Degeneracy::Standstill)),
    };
    let translation = target_mean - rotation * source_mean;
    let target_from_source = Pose::from_parts(Translation3::from(translation), rotation);
    Alignment { target_from_source, degeneracy }
}

/// The rotation R that maximises tr(R^T covariance).
fn rotation_of(covariance: Matrix3<f64>) -> (UnitQuaternion<f64>, Option<Degeneracy>) {
    let svd = covariance.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
        return (UnitQuaternion::identity(), Some(Degeneracy::Standstill));
    };
    let sigma = svd.singular_values; // descending
    let straight = sigma[1] <= RELATIVE_ROUNDING * sigma[0];
    // A reflection is not a motion: turn over the least important axis.
    let mirror = (u.determinant() * v_t.determinant()).signum();
    let matrix = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, mirror)) * v_t;
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix));
    (rotation, straight.then_some(Degeneracy::StraightLine))
}

/// Largest distance from the mean; `None` where it is rounding, or a point is not finite.
fn spread(points: &[Vector3<f64>], mean: Vector3<f64>) -> Option<f64> {
    let largest = points.iter().map(|p| p.norm()).fold(0.0, f64::max);
    let spread = points.iter().map(|p| (p - mean).norm()).fold(0.0, f64::max);
    let moves = mean.iter().all(|v| v.is_finite()) && spread > RELATIVE_ROUNDING * largest;
    (moves && spread.is_finite()).then_some(spread)
}

fn mean(points: &[Vector3<f64>]) -> Vector3<f64> {
    points.iter().sum::<Vector3<f64>>() / points.len().max(1) as f64
}
