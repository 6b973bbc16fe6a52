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
        let moved = displacement_m(&newest, camera, &from, &truth);
        // Alone the alignment is limited by partners being half a pixel (1.5 mm) away along the surface
        // while normals turn, on the ball and at edges. The bilateral filter rounds box and ball.
        for (params, limit_m) in [(unfiltered(), 1e-4), (TrackingParams::default(), 6e-4)] {
            let got = track_step(&scene, &params, camera, from, &newest);
            let error = displacement_m(&newest, camera, &got.world_from_camera, &truth);
            assert_eq!(got.state, TrackingState::Tracking, "{got:?}");
            assert_eq!((got.issue, got.rank), (None, 6));
            assert!(error < limit_m, "moved {moved} m, error {error} m, {got:?}");
            assert!(error < 0.2 * moved, "moved {moved} m, error {error} m, {got:?}");
            let q = got.world_from_camera.rotation.coords.norm();
            assert!((q - 1.0).abs() < 1e-15, "a rotation stays a rotation: {q}");
        }
    }
}

#[test]
fn recovers_motions_in_sensor_noise() {
    let (scene, camera, from) = (AnalyticScene::corner(), camera(320, 240), corner_pose());
    for (seed, step) in motions().into_iter().enumerate() {
        let truth = from * step;
        let mut newest = frame(&scene, camera, truth, 1);
        add_noise(&mut newest, seed as u32);
        let got = track_step(&scene, &TrackingParams::default(), camera, from, &newest);
        let error = displacement_m(&newest, camera, &got.world_from_camera, &truth);
        assert_eq!(got.state, TrackingState::Tracking, "{got:?}");
        // the filter's 0.6 mm, and the mean of 5 mm noise over 10^4 independent windows
        assert!(error < 8e-4, "{error} m, {got:?}");
    }
}

#[test]
fn the_distance_from_the_worlds_origin_does_not_matter() {
    let camera = camera(160, 120);
    // A power of two, so that the scene itself moves exactly.
    let far = Vec3::new(128.0, -64.0, 128.0);
    let scene = AnalyticScene::corner();
    let moved = AnalyticScene::new(
        scene.shapes.iter().map(|shape| shifted(shape, far)).collect::<Vec<_>>(),
    );
    let shift = Translation3::new(f64::from(far.x), f64::from(far.y), f64::from(far.z));
    let step = motion([0.02, -0.015, 0.025], [1.0, -1.5, 2.0]);
    let from = shift * corner_pose();
    let newest = frame(&moved, camera, from * step, 1);
    let got = track_step(&moved, &unfiltered(), camera, from, &newest);
    let error = displacement_m(&newest, camera, &got.world_from_camera, &(from * step));
    // The rays of the made picture are rounded to 2^-17 m = 8 um at 128 m, the alignment is not.
    assert!(error < 3e-4, "{error} m {got:?}");
}

fn shifted(shape: &Shape, by: Vec3) -> Shape {
    match *shape {
        Shape::Plane { normal, offset } => Shape::Plane { normal, offset: offset + normal.dot(by) },
        Shape::Sphere { centre, radius } => Shape::Sphere { centre: centre + by, radius },
        Shape::Box { min, max } => Shape::Box { min: min + by, max: max + by },
    }
}

/// Tracks a small motion in a scene that leaves `6 - rank` motions open. Returns the estimated motion
/// in the axes of the camera.
fn degenerate(shapes: Vec<Shape>, step: Pose, rank: usize) -> Pose {
    let scene = AnalyticScene::new(shapes);
    let camera = camera(160, 120);
    let newest = frame(&scene, camera, step, 1);
    let got = track_step(&scene, &unfiltered(), camera, Pose::identity(), &newest);
    assert!(is_finite(&got));
    assert_eq!(got.state, TrackingState::Degraded, "{got:?}");
    assert_eq!(got.issue, Some(TrackingIssue::Underconstrained { rank }), "{got:?}");
    assert!(!got.may_fuse());
    got.world_from_camera
}

#[test]
fn a_wall_leaves_three_motions_open() {
    let wall = Shape::Plane { normal: -Vec3::Z, offset: -1.5 };
    let got = degenerate(vec![wall], motion([0.03, -0.02, 0.01], [1.0, 0.5, 2.0]), 3);
    let (t, r) = (got.translation.vector, got.rotation.scaled_axis());
    // Half the tilt (0.0195) times the distance (0.01) is the only way from one into the other.
    assert!(
        t.xy().norm() < 1.2e-4 && r.z.abs() < 1e-6,
        "along the wall, about its normal: {t} {r}"
    );
    // what can be seen is found: the wall's distance, and its tilt
    let wall_in_camera = |pose: Pose| (pose.rotation.inverse() * Vector3::z(), pose.translation.z);
    let (normal, z) = wall_in_camera(got);
    let (true_normal, true_z) = wall_in_camera(motion([0.03, -0.02, 0.01], [1.0, 0.5, 2.0]));
    assert!((z - true_z).abs() < 1e-4, "{z}");
    // Rotation about the normal is the one part of it that is missing; it turns the tilt with it.
    assert!((normal.z - true_normal.z).abs() < 1e-4, "{normal}");
}

#[test]
fn two_planes_leave_one_motion_open() {
    let s = 0.5f32.sqrt();
    let ridge = |x: f32| {
        let normal = Vec3::new(x, 0.0, -s);
        Shape::Plane { normal, offset: normal.dot(Vec3::new(0.0, 0.0, 2.0)) }
    };
    let got = degenerate(vec![ridge(s), ridge(-s)], motion([0.02, 0.03, 0.01], [0.5; 3]), 5);
    let t = got.translation.vector;
    assert!(t.y.abs() < 2e-3, "along the edge: {t}");
    assert!((t - Vector3::new(0.02, 0.0, 0.01)).norm() < 2e-3, "across it: {t}");
}

#[test]
fn a_ball_leaves_three_rotations_open() {
    let centre = Vec3::new(0.0, 0.0, 1.2);
    let ball = Shape::Sphere { centre, radius: 0.5 };
    let step = motion([0.01, 0.02, -0.01], [0.4, 0.3, 2.0]);
    let got = degenerate(vec![ball], step, 3);
    // only where the ball is can be known
    let centre = Point3::new(0.0, 0.0, 1.2);
    let error = (got.inverse() * centre - step.inverse() * centre).norm();
    assert!(error < 1e-3, "{error}");
    assert!(got.rotation.scaled_axis().z.abs() < 1e-3, "{got}");
}

#[test]
fn a_corridor_leaves_one_motion_open() {
    let side = |normal: Vec3| Shape::Plane { normal, offset: -1.0 };
    let walls = [Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y].map(side).to_vec();
    let got = degenerate(walls, motion([0.02, -0.01, 0.04], [0.3, 0.2, -0.4]), 5);
    let t = got.translation.vector;
    assert!(t.z.abs() < 2e-3, "along the corridor: {t}");
    assert!((t.xy() - Vector3::new(0.02, -0.01, 0.0).xy()).norm() < 2e-3, "across: {t}");
}

#[test]
fn hardly_any_depth_is_no_pose_and_nothing_breaks() {
    let (scene, camera, pose) = (AnalyticScene::corner(), camera(67, 43), corner_pose());
    let good = frame(&scene, camera, pose, 0);
    let mut one_pixel = good.clone();
    one_pixel.depth_m.fill(0.0);
    one_pixel.depth_m[(30, 20)] = 1.0;
    let mut nan = good.clone();
    nan.depth_m.fill(f32::NAN);
    let mut infinite = good.clone();
    infinite.depth_m.fill(f32::INFINITY);
    for bad in [one_pixel, nan, infinite] {
        let got = track_step(&scene, &TrackingParams::default(), camera, pose, &bad);
        assert!(is_finite(&got));
        assert_eq!(got.state, TrackingState::Lost);
        assert!(matches!(got.issue, Some(TrackingIssue::NoDepth { .. })), "{got:?}");
        assert_eq!(got.world_from_camera, pose);
    }
    let small = RgbdFrame { depth_m: Image::new(Size::new(3, 2), 1.0), ..Default::default() };
    let got = track_step(&scene, &TrackingParams::default(), camera, pose, &small);
    assert_eq!(got.issue, Some(TrackingIssue::WrongSize { width: 3, height: 2 }));

    // enough depth to try, but in a picture with holes, NaN and nothing in the model
    let mut holes = good.clone();
    for (i, depth) in holes.depth_m.as_mut_slice().iter_mut().enumerate() {
        *depth = [*depth, 0.0, f32::NAN, *depth, 1e30, -1.0, *depth][i % 7];
    }
    let got = track_step(&scene, &TrackingParams::default(), camera, pose, &holes);
    assert!(is_finite(&got) && got.state == TrackingState::Tracking, "{got:?}");
    assert!(position_error_m(&got, &pose) < 5e-3, "{got:?}");
    let view = View::perspective(camera, pose);
    let mut broken = scene.render(&view);
    broken.depth_m.fill(f32::NAN);
    for model in [GBuffer::empty(view), broken] {
        let mut tracker = started(&TrackingParams::default(), camera, pose);
        let got = tracker.track(&good, Some(&model), &mut |_, _| {});
        assert!(is_finite(&got));
        assert_eq!((got.state, got.issue), (TrackingState::Lost, Some(TrackingIssue::NoModel)));
    }
}

#[test]
fn odd_sizes_track() {
    let (scene, camera, from) = (AnalyticScene::corner(), camera(67, 43), corner_pose());
    let step = motion([0.01, -0.01, 0.02], [1.0, 1.0, -1.0]);
    let newest = frame(&scene, camera, from * step, 1);
    let got = track_step(&scene, &unfiltered(), camera, from, &newest);
    let error = displacement_m(&newest, camera, &got.world_from_camera, &(from * step));
    assert_eq!(got.state, TrackingState::Tracking);
    // a pixel is 25 mm wide here
    assert!(error < 3e-3, "{error} m");
}

#[test]
fn results_do_not_depend_on_threads() {
    let (scene, camera, from) = (AnalyticScene::corner(), camera(160, 120), corner_pose());
    let mut newest = frame(&scene, camera, from * motion([0.02; 3], [1.0; 3]), 1);
    add_noise(&mut newest, 3);
    let results = [1, 2, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let got =
            pool.install(|| track_step(&scene, &TrackingParams::default(), camera, from, &newest));
        (got.world_from_camera, got.rms_m, got.condition, got.inlier_share)
    });
    assert_eq!(results[0], results[1]);
    assert_eq!(results[0], results[2]);
}

#[test]
fn a_moving_object_neither_stops_nor_bends_the_track() {
    let (scene, camera, from) = (AnalyticScene::corner(), camera(160, 120), corner_pose());
    let truth = from * motion([0.01, 0.005, 0.0], [0.5, 0.5, 0.0]);
    let mut newest = frame(&scene, camera, truth, 1);
    for y in 40..120 {
        for x in 60..130 {
            newest.depth_m[(x, y)] = 0.5; // a hand over 29 % of the picture
        }
    }
    let got = track_step(&scene, &TrackingParams::default(), camera, from, &newest);
    assert_eq!(got.state, TrackingState::Tracking, "{got:?}");
    assert!(got.inlier_share < 0.75, "the hand has no partners: {got:?}");
    let still = frame(&scene, camera, truth, 1);
    let error = displacement_m(&still, camera, &got.world_from_camera, &truth);
    assert!(error < 2e-3, "{error} m");
}

/// Follows `poses` with a map that is always exact.
fn follow(
    tracker: &mut Tracker,
    scene: &AnalyticScene,
    camera: Pinhole,
    poses: &[Pose],
    spoil: impl Fn(usize, &mut RgbdFrame),
) -> Vec<Tracking> {
    let mut render = |view: &View, out: &mut GBuffer| *out = scene.render(view);
    let mut model: Option<GBuffer> = None;
    let mut results = Vec::new();
    for (index, pose) in poses.iter().enumerate() {
        let mut newest = frame(scene, camera, *pose, index);
        newest.world_from_camera = Some(*pose);
        spoil(index, &mut newest);
        let got = tracker.track(&newest, model.as_ref(), &mut render);
        assert!(is_finite(&got));
        if got.may_fuse() || model.is_some() {
            model = Some(scene.render(&View::perspective(camera, got.world_from_camera)));
        }
        results.push(got);
    }
    results
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

fn states(results: &[Tracking]) -> Vec<TrackingState> {
    results.iter().map(|t| t.state).collect()
}

fn position_error_m(got: &Tracking, truth: &Pose) -> f64 {
    (got.world_from_camera.translation.vector - truth.translation.vector).norm()
}

#[test]
fn a_covered_lens_is_lost_and_found_again() {
    use TrackingState::*;
    let camera = camera(160, 120);
    for on_lost in [OnLost::Hold, OnLost::Relocalise, OnLost::Stop, OnLost::Reset] {
        let params = TrackingParams { on_lost, ..Default::default() };
        let mut tracker = Tracker::new(&params, camera);
        let poses = vec![corner_pose(); 15];
        let cover = |i: usize, f: &mut RgbdFrame| {
            if (3..13).contains(&i) {
                f.depth_m.fill(0.0);
            }
        };
        let results = follow(&mut tracker, &AnalyticScene::corner(), camera, &poses, cover);
        let mut expected = vec![Init, Tracking, Tracking];
        expected.extend([Lost; 10]);
        expected.extend([Relocalising, Tracking]);
        assert_eq!(states(&results), expected, "{on_lost:?}");
        assert!(results[3..14].iter().all(|t| !t.may_fuse()));
        assert!(results[3..13].iter().all(|t| t.world_from_camera == results[2].world_from_camera));
    }
}

#[test]
fn a_teleport_is_lost_and_relocalised() {
    use TrackingState::*;
    let (scene, camera) = (AnalyticScene::corner(), camera(160, 120));
    let mut poses = orbit(40);
    let away = poses[39].translation.vector - poses[4].translation.vector;
    assert!(away.norm() > 1.0);
    let back = poses[4] * motion([0.02, 0.01, -0.03], [2.0, -1.0, 1.0]);
    poses.extend([back; 16]);

    let params = TrackingParams::default();
    let results = follow(&mut Tracker::new(&params, camera), &scene, camera, &poses, |_, _| {});
    assert_eq!(results[0].state, Init);
    assert!(states(&results[1..40]).iter().all(|&s| s == Tracking), "{:?}", states(&results));
    let (found, states) = (&results[40..], states(&results[40..]));
    // The floor fits a little wherever one stands, so the first frames may be degraded.
    let lost = states.iter().position(|&s| s == Lost).unwrap();
    assert!(lost <= params.max_degraded_frames);
    assert!(states[..lost].iter().all(|&s| s == Degraded), "{states:?}");
    assert_eq!(states[lost..lost + 3], [Lost, Relocalising, Tracking]);
    assert!(states[lost + 2..].iter().all(|&s| s == Tracking), "{states:?}");
    assert!(position_error_m(&found[15], &back) < 2e-3, "{}", position_error_m(&found[15], &back));

    // without keyframes it stays lost, where it was, and fuses nothing
    let hold = TrackingParams { on_lost: OnLost::Hold, ..Default::default() };
    let results = follow(&mut Tracker::new(&hold, camera), &scene, camera, &poses, |_, _| {});
    assert!(results[40..].iter().all(|t| !t.may_fuse()));
    assert_eq!(results[55].state, Lost);
    assert_eq!(results[55].world_from_camera, results[39].world_from_camera);
}

#[test]
fn an_unknown_place_is_not_taken_for_a_known_one() {
    let (scene, camera) = (AnalyticScene::corner(), camera(160, 120));
    let mut tracker = Tracker::new(&TrackingParams::default(), camera);
    let seen = follow(&mut tracker, &scene, camera, &orbit(20), |_, _| {});
    assert_eq!(seen[19].state, TrackingState::Tracking);
    let elsewhere = AnalyticScene::new([
        Shape::Plane { normal: -Vec3::Z, offset: -1.4 },
        Shape::Plane { normal: Vec3::new(0.6, 0.0, -0.8), offset: -1.2 },
        Shape::Sphere { centre: Vec3::new(-0.3, 0.2, 1.1), radius: 0.3 },
    ]);
    let mut model = scene.render(&View::perspective(camera, seen[19].world_from_camera));
    for index in 20..30 {
        let newest = frame(&elsewhere, camera, Pose::identity(), index);
        let mut render = |view: &View, out: &mut GBuffer| *out = scene.render(view);
        let got = tracker.track(&newest, Some(&model), &mut render);
        assert!(!got.may_fuse(), "{got:?}");
        model = scene.render(&View::perspective(camera, got.world_from_camera));
    }
}

#[test]
fn recorded_and_static_poses() {
    use TrackingState::*;
    let (scene, camera, poses) = (AnalyticScene::corner(), camera(67, 43), orbit(4));
    let forget = |i: usize, f: &mut RgbdFrame| {
        if i == 2 {
            f.world_from_camera = None;
        }
    };
    let recorded = TrackingParams { mode: PoseMode::Recorded, ..Default::default() };
    let results = follow(&mut Tracker::new(&recorded, camera), &scene, camera, &poses, forget);
    assert_eq!(states(&results), [Init, Tracking, Lost, Tracking]);
    assert_eq!(results[2].issue, Some(TrackingIssue::NoRecordedPose));
    for i in [0, 1, 3] {
        assert_eq!(results[i].world_from_camera, poses[i]);
    }

    let fixed = TrackingParams { mode: PoseMode::Static, ..Default::default() };
    let results = follow(&mut Tracker::new(&fixed, camera), &scene, camera, &poses, |_, _| {});
    assert_eq!(states(&results), [Init, Tracking, Tracking, Tracking]);
    assert!(results.iter().all(|t| t.world_from_camera == poses[0]));
}

#[test]
fn a_blind_first_frame_does_not_start_the_map() {
    use TrackingState::*;
    let (scene, camera) = (AnalyticScene::corner(), camera(67, 43));
    let blind = |i: usize, f: &mut RgbdFrame| {
        if i < 2 {
            f.depth_m.fill(0.0);
        }
    };
    let mut tracker = Tracker::new(&TrackingParams::default(), camera);
    let results = follow(&mut tracker, &scene, camera, &[corner_pose(); 4], blind);
    assert_eq!(states(&results), [Lost, Lost, Init, Tracking]);
    assert_eq!(results[2].world_from_camera, corner_pose(), "the recorded pose of that frame");
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
