//! Keeps f32 kernels precise far from the world's origin.

use crate::math::Pose;
use nalgebra::{Translation3, Vector3};

/// Steps of the moved origin, metres. A whole number, so that moving there and back is exact.
const STEP_M: f64 = 8.0;

/// Nothing of a run is further from where it began: f32 has steps of 6 cm there.
pub const FARTHEST_M: f64 = 1e6;

/// A run begins no further from its recording's origin: f64 has steps of 0.1 micrometres there, and no place
/// on Earth is as far from its centre by a hundred times.
const FARTHEST_FIRST_M: f64 = 1e9;

/// How far a quaternion's length may be from 1.
const ROUNDING: f64 = 1e-6;

/// A translation of the world's origin to near the first camera; axes stay.
///
/// At 10 km an f32 has steps of 1 mm; within 8 m of the origin they are below 1 micrometre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorldOrigin {
    world_from_local: Vector3<f64>,
}

impl WorldOrigin {
    pub fn near(world_from_camera: &Pose) -> Self {
        let t = world_from_camera.translation.vector;
        Self { world_from_local: t.map(|v| (v / STEP_M).trunc() * STEP_M) }
    }

    pub fn local_from_world(&self, pose: &Pose) -> Pose {
        Translation3::from(-self.world_from_local) * pose
    }

    pub fn world_from_local(&self, pose: &Pose) -> Pose {
        Translation3::from(self.world_from_local) * pose
    }

    /// As [`Self::local_from_world`], for a pose that a camera of this run can have: finite, rigid, and
    /// within [`FARTHEST_M`].
    pub fn local_camera(&self, world_from_camera: &Pose) -> Option<Pose> {
        let local = self.local_from_world(world_from_camera);
        let near = local.translation.vector.iter().all(|v| v.abs() <= FARTHEST_M);
        (near && is_rigid(world_from_camera)).then_some(local)
    }

    /// A point of the world in local axes.
    pub fn local_point(&self, point_in_world: [f64; 3]) -> glam::Vec3 {
        let p = Vector3::from(point_in_world) - self.world_from_local;
        glam::DVec3::new(p.x, p.y, p.z).as_vec3()
    }

    pub fn offset(&self) -> [f64; 3] {
        self.world_from_local.into()
    }
}

/// Whether a run can begin at this pose.
pub fn is_first_camera(world_from_camera: &Pose) -> bool {
    let near = world_from_camera.translation.vector.iter().all(|v| v.abs() <= FARTHEST_FIRST_M);
    near && is_rigid(world_from_camera)
}

/// Whether all is finite and the quaternion one of a rotation.
fn is_rigid(pose: &Pose) -> bool {
    let finite = pose.translation.vector.iter().all(|v| v.is_finite());
    finite && (pose.rotation.coords.norm() - 1.0).abs() <= ROUNDING
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;

    #[test]
    fn there_and_back_is_exact_and_near_recordings_stay() {
        let rotation = UnitQuaternion::from_euler_angles(0.3, -0.2, 1.0);
        let pose = Pose::from_parts(Translation3::new(10_003.25, -8.5, 3.0), rotation);
        let origin = WorldOrigin::near(&pose);
        let local = origin.local_from_world(&pose);
        assert!(local.translation.vector.amax() < STEP_M);
        assert_eq!(origin.world_from_local(&local), pose);
        let near = Pose::translation(1.5, -7.9, 0.2);
        assert_eq!(WorldOrigin::near(&near).offset(), [0.0; 3]);
    }

    #[test]
    fn only_rigid_poses_within_reach_are_those_of_a_camera() {
        let origin = WorldOrigin::near(&Pose::translation(10_003.25, -8.5, 3.0));
        let at = |x: f64| Pose::translation(x, 0.0, 0.0);
        for (x, local) in [(10_000.0, true), (0.0, true), (1.02e6, false), (f64::NAN, false)] {
            assert_eq!(origin.local_camera(&at(x)).is_some(), local, "{x}");
        }
        for (x, first) in [(-6.4e6, true), (1e9, true), (-1.1e9, false), (1e300, false)] {
            assert_eq!(is_first_camera(&at(x)), first, "{x}");
        }
        for w in [0.0, 2.0, f64::NAN, f64::INFINITY] {
            let q = nalgebra::Quaternion::new(w, 0.0, 0.0, 0.0);
            let turned = Pose::from_parts(at(1e4).translation, UnitQuaternion::new_unchecked(q));
            assert!(origin.local_camera(&turned).is_none() && !is_first_camera(&turned), "{w}");
        }
    }
}
