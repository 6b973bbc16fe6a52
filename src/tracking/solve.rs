//! Solves the 6x6 system of one iteration, and says which motions it leaves open.

use crate::math::Pose;
use nalgebra::{Matrix6, SymmetricEigen, Translation3, UnitQuaternion, Vector3, Vector6};

/// A small rigid motion: rotation vector (radians), then translation (metres).
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    pub rotation: Vector3<f64>,
    pub translation: Vector3<f64>,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Solution {
    pub step: Step,
    /// Number of observable motions, 0 to 6.
    pub rank: usize,
    /// Largest over smallest eigenvalue; infinite where the smallest is not positive.
    pub condition: f64,
}

impl Solution {
    const NONE: Self = Self {
        step: Step {
            rotation: Vector3::new(0.0, 0.0, 0.0),
            translation: Vector3::new(0.0, 0.0, 0.0),
        },
        rank: 0,
        condition: f64::INFINITY,
    };
}

/// Solves `a x = b`. Translations are counted in units of `length_m`, so that all six unknowns are
/// of the same kind; eigenvectors below `min_eigenvalue_ratio` of the largest eigenvalue then span the
/// motions that cannot be observed, and the step along them is zero.
pub(super) fn solve(
    a: &Matrix6<f64>,
    b: &Vector6<f64>,
    length_m: f64,
    min_eigenvalue_ratio: f64,
) -> Solution {
    let finite = a.iter().chain(b.iter()).all(|v| v.is_finite());
    if !(finite && length_m.is_finite() && length_m > 0.0) {
        return Solution::NONE;
    }
    let unit = Vector6::new(1.0, 1.0, 1.0, length_m, length_m, length_m);
    let a = Matrix6::from_fn(|r, c| a[(r, c)] * unit[r] * unit[c]);
    let b = b.component_mul(&unit);
    // 1000 sweeps are far beyond what a finite symmetric 6x6 matrix needs; the limit is there so that
    // no input can loop for ever.
    let Some(eigen) = SymmetricEigen::try_new(a, f64::EPSILON, 1000) else { return Solution::NONE };
    let largest = eigen.eigenvalues.max();
    if largest.is_nan() || largest <= 0.0 {
        return Solution::NONE;
    }
    let smallest = eigen.eigenvalues.min();
    let (mut x, mut rank) = (Vector6::zeros(), 0);
    for (&value, direction) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        if value > min_eigenvalue_ratio.max(f64::EPSILON) * largest {
            x += direction * (direction.dot(&b) / value);
            rank += 1;
        }
    }
    let x = x.component_mul(&unit);
    Solution {
        step: Step {
            rotation: x.fixed_rows::<3>(0).into_owned(),
            translation: x.fixed_rows::<3>(3).into_owned(),
        },
        rank,
        condition: if smallest > 0.0 { largest / smallest } else { f64::INFINITY },
    }
}

impl Step {
    /// Exponential map of se(3).
    pub fn exp(&self) -> Pose {
        let angle = self.rotation.norm();
        // (1 - cos a) / a^2 and (a - sin a) / a^3, by their series where the quotient cancels
        let (first, second) = if angle < 1e-4 {
            (0.5 - angle * angle / 24.0, 1.0 / 6.0 - angle * angle / 120.0)
        } else {
            ((1.0 - angle.cos()) / angle.powi(2), (angle - angle.sin()) / angle.powi(3))
        };
        let turned = self.rotation.cross(&self.translation);
        let translation = self.translation + turned * first + self.rotation.cross(&turned) * second;
        Pose::from_parts(
            Translation3::from(translation),
            UnitQuaternion::from_scaled_axis(self.rotation),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix4;

    #[test]
    fn exponential_is_the_matrix_exponential() {
        for scale in [0.0, 1e-9, 0.9e-4, 1.1e-4, 0.3, 2.0] {
            let step = Step {
                rotation: Vector3::new(0.3, -0.8, 0.5) * scale,
                translation: Vector3::new(1.0, 0.4, -0.7),
            };
            let mut twist = Matrix4::zeros();
            twist.fixed_view_mut::<3, 3>(0, 0).copy_from(&step.rotation.cross_matrix());
            twist.fixed_view_mut::<3, 1>(0, 3).copy_from(&step.translation);
            let (mut series, mut term) = (Matrix4::identity(), Matrix4::identity());
            for n in 1..40 {
                term = term * twist / f64::from(n);
                series += term;
            }
            let difference = (step.exp().to_homogeneous() - series).abs().max();
            // series of 40 terms of size at most 2^n / n!; 1e-4 quotients cancel to 1e-8 * 1e-16 / 1e-12
            assert!(difference < 1e-11, "{scale}: {difference:e}");
        }
    }

    #[test]
    fn the_step_in_the_null_space_is_zero() {
        // rows that see rotation about y, and translation along z only
        let mut a = Matrix6::zeros();
        a[(1, 1)] = 40.0;
        a[(5, 5)] = 10.0;
        let b = Vector6::new(3.0, 4.0, 5.0, 6.0, 7.0, 8.0);
        let solution = solve(&a, &b, 2.0, 1e-6);
        assert_eq!(solution.rank, 2);
        assert_eq!(solution.condition, f64::INFINITY);
        assert!((solution.step.rotation - Vector3::new(0.0, 0.1, 0.0)).norm() < 1e-15);
        assert!((solution.step.translation - Vector3::new(0.0, 0.0, 0.8)).norm() < 1e-15);
    }

    #[test]
    fn broken_systems_have_rank_zero_and_no_step() {
        let zero = (Matrix6::zeros(), Vector6::zeros(), 1.0);
        let nan = (Matrix6::identity() * f64::NAN, Vector6::zeros(), 1.0);
        let no_length = (Matrix6::identity(), Vector6::zeros(), 0.0);
        for (a, b, length) in [zero, nan, no_length] {
            let solution = solve(&a, &b, length, 1e-5);
            assert_eq!(solution.rank, 0);
            assert_eq!(solution.step.exp(), Pose::identity());
        }
    }
}
