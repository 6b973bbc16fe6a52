//! The tracker against scenes whose depth and normals are known exactly.

mod alignment;
mod degenerate;
mod states;

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

/// The tracker with a filter that changes nothing: what is left is the alignment itself.
fn unfiltered() -> TrackingParams {
    TrackingParams { filter_radius: 0, ..Default::default() }
}

fn is_finite(t: &Tracking) -> bool {
    let pose = t.world_from_camera.to_homogeneous();
    pose.iter().all(|v| v.is_finite())
        && t.inlier_share.is_finite()
        && t.overlap.is_finite()
        && t.rms_m.is_finite()
        && !t.condition.is_nan()
}

/// Half a turn around the scene in small steps.
fn orbit(count: usize) -> Vec<Pose> {
    (0..count)
        .map(|i| {
            let a = -0.9 + 0.9 * i as f64 / (count - 1) as f64;
            look_at([1.5 * a.cos(), 1.5 * a.sin(), 0.9], [-0.1, 0.15, 0.1])
        })
        .collect()
}

fn position_error_m(got: &Tracking, truth: &Pose) -> f64 {
    (got.world_from_camera.translation.vector - truth.translation.vector).norm()
}

/// Run in release: `cargo test --release --lib time_tracking -- --ignored --nocapture`.
#[test]
#[ignore = "measures time"]
fn time_tracking_640x480() {
    let (scene, camera) = (AnalyticScene::corner(), camera(640, 480));
    let poses = orbit(40);
    let mut tracker = Tracker::new(&TrackingParams::default(), camera);
    let mut render = |view: &View, out: &mut GBuffer| *out = scene.render(view);
    let mut model = None;
    let mut times_ms = Vec::new();
    for (index, pose) in poses.iter().enumerate() {
        let mut newest = frame(&scene, camera, *pose, index);
        newest.world_from_camera = Some(*pose);
        add_noise(&mut newest, index as u32);
        let start = std::time::Instant::now();
        let got = tracker.track(&newest, model.as_ref(), &mut render);
        times_ms.push(start.elapsed().as_secs_f64() * 1e3);
        assert!(got.may_fuse(), "{got:?}");
        model = Some(scene.render(&View::perspective(camera, got.world_from_camera)));
    }
    times_ms.remove(0);
    times_ms.sort_by(f64::total_cmp);
    println!(
        "tracking 640x480: least {:.1} ms, median {:.1} ms, most {:.1} ms",
        times_ms[0],
        times_ms[times_ms.len() / 2],
        times_ms[times_ms.len() - 1]
    );
}
