//! Scenes and pictures that do not determine the pose.

use super::*;

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
    let no_pixels = Pinhole { width: 0, height: 0, ..camera };
    let nothing = GBuffer::empty(View::perspective(no_pixels, pose));
    for model in [GBuffer::empty(view), broken, nothing] {
        let mut tracker = started(&TrackingParams::default(), camera, pose);
        let got = tracker.track(&good, Some(&model), &mut |_, _| {});
        assert!(is_finite(&got));
        assert_eq!((got.state, got.issue), (TrackingState::Lost, Some(TrackingIssue::NoModel)));
    }
}
