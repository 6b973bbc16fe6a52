//! Poses, views, spherical harmonics, quantiles, and rays through boxes.

pub mod bvh;
pub mod color;
mod distribution;
mod fibonacci;
pub mod random;
pub mod sh;
mod statistics;
mod view;

pub use distribution::Distribution;
pub use fibonacci::{fibonacci_sphere, fibonacci_sphere_f64};
pub use statistics::{median, quantile};
pub use view::{Orthographic, Pinhole, Projection, View};

/// Rigid transform in f64; named `a_from_b`, so that `a_from_b * b_from_c` reads itself.
pub type Pose = nalgebra::Isometry3<f64>;

/// The same transform for f32 kernels.
pub fn affine_from_pose(pose: &Pose) -> glam::Affine3A {
    let q = pose.rotation.coords;
    let t = pose.translation.vector;
    glam::Affine3A::from_rotation_translation(
        glam::DQuat::from_xyzw(q.x, q.y, q.z, q.w).as_quat(),
        glam::DVec3::new(t.x, t.y, t.z).as_vec3(),
    )
}

/// Unit vector, or `None` where the length is zero or not finite.
pub fn unit(v: glam::Vec3) -> Option<glam::Vec3> {
    v.try_normalize()
}

/// Builds a pose from translation and a quaternion as stored in files (x y z w, any length but zero).
pub fn pose_from_xyzw(translation: [f64; 3], [x, y, z, w]: [f64; 4]) -> Option<Pose> {
    let q = nalgebra::Quaternion::new(w, x, y, z);
    let finite = translation.iter().all(|v| v.is_finite()) && q.norm().is_finite();
    (finite && q.norm() > 1e-6).then(|| {
        Pose::from_parts(
            nalgebra::Translation3::from(translation),
            nalgebra::UnitQuaternion::from_quaternion(q),
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn affine_moves_points_like_the_pose() {
        let pose = pose_from_xyzw([0.3, -1.2, 2.0], [0.1, -0.4, 0.2, 0.7]).unwrap();
        let p = pose * nalgebra::Point3::new(0.5, 0.25, -1.5);
        let q = affine_from_pose(&pose).transform_point3(glam::Vec3::new(0.5, 0.25, -1.5));
        // f32 rounding of a value near 2: 2^-23 * 2, a few operations
        assert!((glam::DVec3::new(p.x, p.y, p.z) - q.as_dvec3()).length() < 2e-6);
    }

    #[test]
    fn broken_quaternions_are_no_pose() {
        assert!(pose_from_xyzw([0.0; 3], [0.0; 4]).is_none());
        assert!(pose_from_xyzw([0.0; 3], [f64::NAN, 0.0, 0.0, 1.0]).is_none());
        assert!(pose_from_xyzw([f64::INFINITY, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]).is_none());
    }
}
