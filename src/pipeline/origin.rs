//! Keeps f32 kernels precise far from the world's origin.

use crate::math::Pose;
use nalgebra::{Translation3, Vector3};

/// Steps of the moved origin, metres. A whole number, so that moving there and back is exact.
const STEP_M: f64 = 8.0;

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

    /// A point of the world in local axes.
    pub fn local_point(&self, point_in_world: [f64; 3]) -> glam::Vec3 {
        let p = Vector3::from(point_in_world) - self.world_from_local;
        glam::DVec3::new(p.x, p.y, p.z).as_vec3()
    }

    pub fn offset(&self) -> [f64; 3] {
        self.world_from_local.into()
    }
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
}
