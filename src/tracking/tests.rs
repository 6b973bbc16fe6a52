//! The tracker against scenes whose depth and normals are known exactly.

use super::*;
use crate::capture::RgbdFrame;
use crate::geometry::GBuffer;
use crate::image::{Image, Size};
use crate::math::random::Rng;
use crate::math::{Pinhole, View};
use crate::scene::analytic::{AnalyticScene, Shape};
use glam::Vec3;
use nalgebra::{Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

fn camera(width: usize, height: usize) -> Pinhole {
    let (w, h) = (width as f32, height as f32);
    Pinhole { width, height, fx: 0.82 * w, fy: 0.82 * w, cx: 0.5 * w - 0.5, cy: 0.5 * h - 0.5 }
}

fn look_at(eye: [f64; 3], target: [f64; 3]) -> Pose {
    let (eye, target) = (Vector3::from(eye), Vector3::from(target));
    let forward = (target - eye).normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let axes = Matrix3::from_columns(&[right, forward.cross(&right), forward]);
    Pose::from_parts(
        Translation3::from(eye),
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes)),
    )
}

/// A place from which the corner scene shows floor, walls, box and ball.
fn corner_pose() -> Pose {
    look_at([1.0, -1.1, 0.9], [-0.1, 0.15, 0.1])
}

fn motion(translation_m: [f64; 3], rotation_deg: [f64; 3]) -> Pose {
    Pose::from_parts(
        Translation3::from(translation_m),
        UnitQuaternion::from_scaled_axis(Vector3::from(rotation_deg).map(f64::to_radians)),
    )
}

/// What the camera delivers: exact depth, intensity by the direction of the surface.
fn frame(
    scene: &AnalyticScene,
    camera: Pinhole,
    world_from_camera: Pose,
    index: usize,
) -> RgbdFrame {
    let seen = scene.render(&View::perspective(camera, world_from_camera));
    let normals = &seen.normals;
    let planes = normals.x.as_slice().iter().zip(normals.y.as_slice()).zip(normals.z.as_slice());
    let intensity = planes.map(|((x, y), z)| 120.0 + 60.0 * x + 40.0 * y + 20.0 * z).collect();
    RgbdFrame {
        index,
        intensity: Image::from_vec(camera.size(), intensity),
        depth_m: seen.depth_m,
        ..Default::default()
    }
}

/// Axial noise of a Kinect (Nguyen, Izadi, Lovell, 2012), in steps of its disparity.
fn add_noise(frame: &mut RgbdFrame, seed: u32) {
    let mut rng = Rng::new(&[seed, 0x5eed]);
    for depth in frame.depth_m.as_mut_slice() {
        if *depth > 0.0 {
            *depth += (0.0012 + 0.0019 * (*depth - 0.4).powi(2)) * rng.normal();
            *depth = 348.0 / (348.0 / *depth).round();
        }
    }
}

/// A tracker that has seen its first frame at `pose`.
fn started(params: &TrackingParams, camera: Pinhole, pose: Pose) -> Tracker {
    let mut tracker = Tracker::new(params, camera);
    tracker.reset(pose);
    tracker
}

/// Tracks one frame taken at `truth` against the map as seen from `from`.
fn track_step(
    scene: &AnalyticScene,
    params: &TrackingParams,
    camera: Pinhole,
    from: Pose,
    newest: &RgbdFrame,
) -> Tracking {
    let model = scene.render(&View::perspective(camera, from));
    let mut render = |_: &View, _: &mut GBuffer| panic!("the model at hand serves");
    started(params, camera, from).track(newest, Some(&model), &mut render)
}

/// Mean distance, in metres, between where two poses put the points of a frame.
fn displacement_m(frame: &RgbdFrame, camera: Pinhole, a: &Pose, b: &Pose) -> f64 {
    let view = View::perspective(camera, Pose::identity());
    let (mut sum, mut count) = (0.0, 0.0);
    for y in 0..camera.height {
        for x in 0..camera.width {
            let depth = frame.depth_m[(x, y)];
            if depth > 0.0 {
                let p = view.unproject(glam::Vec2::new(x as f32, y as f32), depth).as_dvec3();
                let p = Point3::new(p.x, p.y, p.z);
                sum += (a * p - b * p).norm();
                count += 1.0;
            }
        }
    }
    sum / count
}

fn is_finite(t: &Tracking) -> bool {
    let pose = t.world_from_camera.to_homogeneous();
    pose.iter().all(|v| v.is_finite())
        && t.inlier_share.is_finite()
        && t.overlap.is_finite()
        && t.rms_m.is_finite()
        && !t.condition.is_nan()
}

fn motions() -> Vec<Pose> {
    let mut all = Vec::new();
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            for (metres, degrees) in [(0.005, 0.3), (0.02, 1.0), (0.05, 2.5)] {
                let mut unit = [0.0; 3];
                unit[axis] = sign;
                all.push(motion(unit.map(|v| v * metres), [0.0; 3]));
                all.push(motion([0.0; 3], unit.map(|v| v * degrees)));
            }
        }
    }
    all.push(motion([0.02, -0.015, 0.025], [1.0, -1.5, 2.0]));
    all.push(motion([-0.03, 0.02, 0.01], [-2.0, 1.0, -0.5]));
    all
}

#[test]
fn recovers_known_motions() {
    let (scene, camera, from) = (AnalyticScene::corner(), camera(320, 240), corner_pose());
    for step in motions() {
        let truth = from * step;
        let newest = frame(&scene, camera, truth, 1);
        let got = track_step(&scene, &TrackingParams::default(), camera, from, &newest);
        let moved = displacement_m(&newest, camera, &from, &truth);
        let error = displacement_m(&newest, camera, &got.world_from_camera, &truth);
        println!(
            "{:6.2} mm -> {:6.3} mm {:?} {got:?}",
            1e3 * moved,
            1e3 * error,
            step.translation.vector
        );
        assert_eq!(got.state, TrackingState::Tracking, "{got:?}");
        assert_eq!(got.rank, 6);
        assert!(error < 0.001, "{moved} m: {error} m, {got:?}");
    }
}

#[test]
fn recovers_motions_in_noise() {
    let (scene, camera, from) = (AnalyticScene::corner(), camera(320, 240), corner_pose());
    for (seed, step) in motions().into_iter().enumerate() {
        let truth = from * step;
        let mut newest = frame(&scene, camera, truth, 1);
        add_noise(&mut newest, seed as u32);
        let got = track_step(&scene, &TrackingParams::default(), camera, from, &newest);
        let error = displacement_m(&newest, camera, &got.world_from_camera, &truth);
        println!("{:6.3} mm {:?} {} {}", 1e3 * error, got.state, got.inlier_share, got.rms_m);
        assert_eq!(got.state, TrackingState::Tracking, "{got:?}");
        assert!(error < 0.002, "{error} m, {got:?}");
    }
}
