//! Losing the camera, finding it again, and poses that are given.

use super::*;

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

fn states(results: &[Tracking]) -> Vec<TrackingState> {
    results.iter().map(|t| t.state).collect()
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
