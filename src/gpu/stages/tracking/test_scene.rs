//! What both backends are shown: the corner scene of [`AnalyticScene`] with a sensor's noise and holes.

use crate::capture::RgbdFrame;
use crate::image::Image;
use crate::math::random::Rng;
use crate::math::{Pinhole, Pose, View};
use crate::scene::analytic::AnalyticScene;
use nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

pub fn camera(width: usize, height: usize) -> Pinhole {
    let (w, h) = (width as f32, height as f32);
    Pinhole { width, height, fx: 0.82 * w, fy: 0.81 * w, cx: 0.5 * w - 0.7, cy: 0.5 * h - 0.4 }
}

/// A place from which the corner scene shows floor, walls, box and ball.
pub fn corner_pose() -> Pose {
    look_at([1.0, -1.1, 0.9])
}

/// From `eye` to the middle of the corner scene.
pub fn look_at(eye: [f64; 3]) -> Pose {
    let eye = Vector3::from(eye);
    let forward = (Vector3::new(-0.1, 0.15, 0.1) - eye).normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let axes = Matrix3::from_columns(&[right, forward.cross(&right), forward]);
    let rotation = Rotation3::from_matrix_unchecked(axes);
    Pose::from_parts(Translation3::from(eye), UnitQuaternion::from_rotation_matrix(&rotation))
}

pub fn motion(translation_m: [f64; 3], rotation_deg: [f64; 3]) -> Pose {
    Pose::new(Vector3::from(translation_m), Vector3::from(rotation_deg).map(f64::to_radians))
}

/// The corner scene from [`corner_pose`].
pub fn corner_frame(camera: Pinhole, seed: u32) -> RgbdFrame {
    frame(&AnalyticScene::corner(), camera, corner_pose(), seed)
}

/// What a camera delivers: depth with noise of a millimetre and with holes, intensity by the direction of
/// the surface.
pub fn frame(
    scene: &AnalyticScene,
    camera: Pinhole,
    world_from_camera: Pose,
    seed: u32,
) -> RgbdFrame {
    let seen = scene.render(&View::perspective(camera, world_from_camera));
    let mut rng = Rng::new(&[seed]);
    let noisy = |&d: &f32| match (rng.uniform() < 0.02, d > 0.0) {
        (false, true) => d + 0.002 * (rng.uniform() - 0.5),
        _ => 0.0,
    };
    let depth_m = seen.depth_m.as_slice().iter().map(noisy).collect();
    let n = &seen.normals;
    let normals = n.x.as_slice().iter().zip(n.y.as_slice()).zip(n.z.as_slice());
    let intensity = normals.map(|((x, y), z)| 120.0 + 60.0 * x + 40.0 * y + 20.0 * z);
    RgbdFrame {
        color_srgb: Image::new(camera.size(), [0; 3]),
        color: Image::new(camera.size(), [0.2; 3]),
        intensity: Image::from_vec(camera.size(), intensity.collect()),
        depth_m: Image::from_vec(camera.size(), depth_m),
        ..RgbdFrame::default()
    }
}
