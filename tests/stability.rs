//! The pipeline as a whole at its limits: far from the origin, for a long time, with the smallest and
//! largest settings, with a covered lens, and with objects in impossible places.

mod common;

use common::recording::{Recording, demo_folder, small_demo};
use glam::Vec3;
use kinlight::capture::RawFrame;
use kinlight::config::Settings;
use kinlight::eval::light::angle_deg;
use kinlight::geometry::Origin;
use kinlight::image::Image;
use kinlight::math::{Pose, sh};
use kinlight::pipeline::{FrameOutcome, Pipeline, PipelineError};
use kinlight::scene::{Placement, Similarity, VirtualObject, VirtualScene};
use kinlight::timing::StageTimes;
use kinlight::tracking::{OnLost, PoseMode, TrackingState};
use nalgebra::Translation3;

/// For pictures of 160x120.
fn quick() -> Settings {
    let mut settings = Settings::preset("ours-fast-mobile").unwrap();
    settings.surface.auxiliary_resolution = 128;
    settings
}

/// Towards the demo's lamp (`light.json`).
const LAMP: Vec3 = Vec3::new(-0.6895, -0.0847, 0.7193);

fn demo_scene() -> VirtualScene {
    VirtualScene::load(&demo_folder().join("scene.toml")).unwrap()
}

fn pipeline(recording: &Recording, settings: &Settings, scene: VirtualScene) -> Pipeline {
    settings.validate().unwrap();
    Pipeline::new(settings.clone(), recording.camera, scene).unwrap()
}

fn process(pipeline: &mut Pipeline, frame: &RawFrame) -> FrameOutcome {
    pipeline.process(frame.clone(), StageTimes::default()).unwrap()
}

fn direction(outcome: &FrameOutcome) -> Vec3 {
    outcome.light.light.dominant_direction().expect("a light with two bands and more has one")
}

/// Every number that a frame ends in.
fn assert_finite(pipeline: &Pipeline, outcome: &FrameOutcome, what: &str) {
    let light = &outcome.light;
    assert!(light.light.coefficients.as_flattened().iter().all(|c| c.is_finite()), "{what}");
    assert!(light.residual.is_finite() && light.deviation.iter().all(|d| d.is_finite()), "{what}");
    let shading = pipeline.shading().unwrap_or_else(|| panic!("{what}: not composed"));
    for image in [&shading.real, &shading.merged] {
        assert!(image.as_slice().as_flattened().iter().all(|v| v.is_finite()), "{what}");
    }
    let (real, merged) = pipeline.geometry().unwrap();
    for buffer in [real, merged] {
        assert!(buffer.depth_m.as_slice().iter().all(|d| d.is_finite() && *d >= 0.0), "{what}");
        for normals in [&buffer.normals.x, &buffer.normals.y, &buffer.normals.z] {
            assert!(normals.as_slice().iter().all(|n| n.is_finite()), "{what}");
        }
    }
}

fn virtual_pixels(pipeline: &Pipeline) -> usize {
    let merged = pipeline.geometry().unwrap().1;
    merged.origin.as_slice().iter().filter(|&&o| o == Origin::Virtual).count()
}

/// Share of pixels with a channel that differs by more than `steps`.
fn share_beyond(a: &Image<[u8; 3]>, b: &Image<[u8; 3]>, steps: u8) -> f64 {
    let beyond = a.as_slice().iter().zip(b.as_slice());
    let beyond = beyond.filter(|(a, b)| (0..3).any(|c| a[c].abs_diff(b[c]) > steps)).count();
    beyond as f64 / a.size().pixels() as f64
}

#[test]
fn ten_kilometres_from_the_origin_nothing_changes() {
    let near = small_demo(8);
    let shift = Translation3::new(10_000.0, -10_000.0, 500.0);
    let mut far = near.clone();
    for frame in &mut far.frames {
        frame.world_from_camera = frame.world_from_camera.map(|pose| shift * pose);
    }
    // Objects have f32 positions, at 10 km a multiple of 1/1024 m; this is one.
    let scene = |offset: Vec3| {
        let mut scene = demo_scene();
        let position = Vec3::new(0.0, -0.16015625, 0.0) + offset;
        let place = Similarity::standing(position, Vec3::Z, 0.0, 1.0);
        scene.objects[0].placement = Placement::Placed(place);
        scene
    };
    let far_scene = scene(Vec3::new(10_000.0, -10_000.0, 500.0));

    let mut at_home = pipeline(&near, &quick(), scene(Vec3::ZERO));
    let mut away = pipeline(&far, &quick(), far_scene);
    let mut spots = 0;
    for (a, b) in near.frames.iter().zip(&far.frames) {
        let (home, there) = (process(&mut at_home, a), process(&mut away, b));
        assert_eq!(home.tracking.state, there.tracking.state);
        let expected = shift * home.tracking.world_from_camera;
        let error = expected.inverse() * there.tracking.world_from_camera;
        // The nearest origin leaves 4 m of the 500: f32 steps of 0.5 um instead of 0.06. Measured:
        // 1 um and 0.0008 degrees. In one frame a point of the transfer's grid, of every 4th pixel, sees past a
        // rim on one side alone: 79 of 19200 pixels around it differ by more than 1, none by more than 8.
        assert!(error.translation.vector.norm() < 1e-5 && error.rotation.angle() < 1e-5);
        let angle = angle_deg(direction(&home), direction(&there)).unwrap();
        assert!(angle < 0.01, "{angle}");
        let beyond = share_beyond(at_home.composed(), away.composed(), 1);
        spots += usize::from(beyond > 0.0);
        assert!(beyond < 0.006, "{beyond}");
        assert_eq!(share_beyond(at_home.composed(), away.composed(), 8), 0.0);
        assert!(virtual_pixels(&away) > 100);
    }
    assert!(spots <= 2, "{spots} of 8 frames");
}

/// The first frame of the demo 300 times.
fn standing_still(mode: PoseMode) -> Vec<FrameOutcome> {
    let recording = small_demo(1);
    let mut settings = quick();
    settings.tracking.mode = mode;
    let mut pipeline = pipeline(&recording, &settings, demo_scene());
    (0..300)
        .map(|index| {
            let timestamp_s = index as f64 / 30.0;
            process(&mut pipeline, &RawFrame { index, timestamp_s, ..recording.frames[0].clone() })
        })
        .collect()
}

fn strength(outcome: &FrameOutcome) -> f64 {
    outcome.light.light.luminance().iter().map(|c| f64::from(c * c)).sum::<f64>().sqrt()
}

/// How far the light of the frames after the first hundred is from that of the hundredth: degrees,
/// and the relative change of its strength.
fn drift_of_light(outcomes: &[FrameOutcome]) -> (f64, f64) {
    let settled = &outcomes[99];
    let largest = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max);
    let angles =
        outcomes[100..].iter().map(|o| angle_deg(direction(settled), direction(o)).unwrap());
    let gains = outcomes[100..].iter().map(|o| (strength(o) / strength(settled) - 1.0).abs());
    (largest(&mut { angles }), largest(&mut { gains }))
}

#[test]
fn the_same_frame_three_hundred_times_gives_a_light_that_does_not_drift() {
    let fixed = standing_still(PoseMode::Static);
    let (angle, gain) = drift_of_light(&fixed);
    eprintln!("fixed: {angle} degrees, {gain}");
    let moved = |from: usize, to: usize| {
        let (from, to) = (&fixed[from], &fixed[to]);
        [angle_deg(direction(from), direction(to)).unwrap(), (strength(to) - strength(from)).abs()]
    };
    let hundreds = [moved(0, 99), moved(99, 199), moved(199, 299)];
    eprintln!("in each hundred frames: {hundreds:?}");
    // The lamp is held by what is remembered and goes up its valley ever more slowly. It ends: 900 frames give
    // 0.405 degrees and 0.15 % from the hundredth on, and from the 800th on the same light to the last bit.
    assert!(angle < 0.5 && gain < 2e-3, "{angle} {gain}");
    for (before, after) in hundreds.iter().zip(&hundreds[1..]) {
        // Measured: 0.07 and 0.28 of the degrees, 0.02 and 0.36 of the strength.
        assert!(after[0] < 0.5 * before[0] && after[1] < 0.5 * before[1], "{hundreds:?}");
    }

    let tracked = standing_still(PoseMode::Track);
    assert!(tracked[1..].iter().all(|o| o.tracking.state == TrackingState::Tracking));
    let first = tracked[0].tracking.world_from_camera;
    let last = first.inverse() * tracked[299].tracking.world_from_camera;
    let (angle, gain) = drift_of_light(&tracked);
    eprintln!("tracked: {angle} degrees, {gain}, {} m", last.translation.vector.norm());
    // The pose creeps (measured: 1.9 mm in 300 frames, with voxels of 31 mm), and the map with it; the light,
    // which nothing holds but the frames that it remembers, follows by 0.9 degrees and 2.1 %.
    assert!(last.translation.vector.norm() < 3e-3, "{last}");
    assert!(angle < 2.0 && gain < 0.04, "{angle} {gain}");
}

#[test]
fn the_smallest_and_the_largest_settings_run() {
    let recording = small_demo(3);
    let run = |assignments: &[&str]| {
        let mut settings = quick();
        assignments.iter().for_each(|a| settings.assign(a).unwrap());
        let mut pipeline = pipeline(&recording, &settings, demo_scene());
        let outcomes: Vec<_> =
            recording.frames.iter().map(|frame| process(&mut pipeline, frame)).collect();
        let last = outcomes[2].clone();
        assert_finite(&pipeline, &last, &assignments.join(" "));
        assert!(virtual_pixels(&pipeline) > 100, "{assignments:?}");
        assert!(last.tracking.may_fuse(), "{assignments:?}: {:?}", last.tracking);
        assert!(last.light.valid(), "{assignments:?}: {:?}", last.light.rejection);
        last.light
            .light
            .dominant_direction()
            .iter()
            .for_each(|d| assert!((d.length() - 1.0).abs() < 1e-5, "{assignments:?}: {d}"));
        last
    };
    // With voxels of 25 cm nothing can be aligned to.
    for (resolution, poses) in [(8, "recorded"), (64, "track"), (512, "track")] {
        let last =
            run(&[&format!("volume.resolution={resolution}"), &format!("tracking.mode={poses}")]);
        assert!(last.volume_bytes < 1 << 30, "{resolution}: {}", last.volume_bytes);
    }
    for bands in 1..=sh::MAX_BANDS {
        let last = run(&[&format!("transfer.bands={bands}")]);
        assert_eq!(last.light.light.coefficients.len(), bands * bands);
        let found = last.light.light.dominant_direction();
        assert_eq!(found.is_some(), bands > 1, "one band has no direction");
        // Measured on these 1000 pixels: 27, 26 and 34 degrees with 3, 4 and 5 bands. Two bands say
        // too little of shadows, and six ask for more than this view tells.
        if (3..=5).contains(&bands) {
            let angle = angle_deg(direction(&last), LAMP).unwrap();
            assert!(angle < 45.0, "{bands} bands: {angle}");
        }
    }
    for directions in [4, 256] {
        run(&[&format!("transfer.directions={directions}")]);
    }
    for assignment in [
        "transfer.subsampling=8",
        "surface.auxiliary_resolution=8",
        "compositing.gauss_radius=0",
        "dyn_geo.taps=1",
        "bounce.enabled=false",
        "light.channels=rgb",
        "light.memory=0",
        "volume.max_weight=1",
        "tracking.iterations=[1]",
    ] {
        run(&[assignment]);
    }
}

/// Frames 6 to 10 of the demo as a covered lens gives them.
fn covered() -> Recording {
    let mut recording = small_demo(16);
    for frame in &mut recording.frames[6..11] {
        frame.depth_m.fill(0.0);
        frame.color.fill([3; 3]);
    }
    recording
}

fn on_lost(on_lost: OnLost) -> Settings {
    let mut settings = quick();
    settings.tracking.on_lost = on_lost;
    settings.volume.resolution = 128;
    settings
}

#[test]
fn a_covered_lens_leaves_the_map_alone_and_tracking_resumes() {
    let recording = covered();
    for policy in [OnLost::Hold, OnLost::Relocalise] {
        let mut pipeline = pipeline(&recording, &on_lost(policy), demo_scene());
        let before: Vec<_> =
            recording.frames[..6].iter().map(|f| process(&mut pipeline, f)).collect();
        assert!(before.iter().all(|o| o.tracking.may_fuse() && o.composed));
        let (mesh, light) = (pipeline.mesh(), before[5].light.light.clone());
        assert!(mesh.triangles.len() > 1000);
        for frame in &recording.frames[6..11] {
            let outcome = process(&mut pipeline, frame);
            assert_eq!(outcome.tracking.state, TrackingState::Lost, "{policy:?}");
            assert!(!outcome.composed && !outcome.light.valid());
            assert_eq!(outcome.light.light, light, "the last light stays");
            assert_eq!(pipeline.composed(), &frame.color, "nothing is composed");
            assert!(pipeline.geometry().is_none() && pipeline.shading().is_none());
            assert!(pipeline.mesh() == mesh, "{policy:?}: the map changed while lost");
        }
        let after: Vec<_> =
            recording.frames[11..].iter().map(|f| process(&mut pipeline, f)).collect();
        let states: Vec<_> = after.iter().map(|o| o.tracking.state).collect();
        assert_eq!(states[0], TrackingState::Relocalising, "{policy:?}");
        assert_eq!(states[1..], [TrackingState::Tracking; 4], "{policy:?}");
        for outcome in &after[1..] {
            let error =
                outcome.recorded_pose.unwrap().inverse() * outcome.tracking.world_from_camera;
            // Measured 1.8 mm and 0.1 degrees.
            assert!(error.translation.vector.norm() < 5e-3, "{policy:?}");
            assert!(error.rotation.angle() < 5e-3, "{policy:?}");
            assert!(outcome.composed && outcome.light.valid());
        }
        assert!(pipeline.mesh() != mesh, "fusion goes on");
    }
}

#[test]
fn a_covered_lens_may_empty_the_map_or_stop_the_run() {
    let recording = covered();
    let mut started_anew = pipeline(&recording, &on_lost(OnLost::Reset), demo_scene());
    let states: Vec<_> = recording
        .frames
        .iter()
        .map(|frame| {
            let state = process(&mut started_anew, frame).tracking.state;
            let empty = started_anew.mesh().triangles.is_empty();
            // Two frames make the first triangles (`volume.mesh_min_weight`).
            let expected = matches!(frame.index, 0 | 6..=11);
            assert_eq!(empty, expected, "frame {}", frame.index);
            state
        })
        .collect();
    assert_eq!(states[1..6], [TrackingState::Tracking; 5]);
    assert!(!states[6..11].contains(&TrackingState::Tracking), "{states:?}");
    assert_eq!(states[11], TrackingState::Init);
    assert_eq!(states[12..], [TrackingState::Tracking; 4]);

    let mut stopped = pipeline(&recording, &on_lost(OnLost::Stop), demo_scene());
    recording.frames[..6].iter().for_each(|frame| _ = process(&mut stopped, frame));
    let mesh = stopped.mesh();
    let error = stopped.process(recording.frames[6].clone(), StageTimes::default()).unwrap_err();
    assert!(matches!(error, PipelineError::Lost { frame: 6, .. }), "{error}");
    assert!(error.to_string().contains("0.0 % of the pixels have depth"), "{error}");
    assert!(stopped.mesh() == mesh);
}

#[test]
fn objects_in_impossible_places_give_finite_pictures() {
    let recording = small_demo(3);
    let camera: Pose = recording.frames[0].world_from_camera.unwrap();
    let in_front = |metres: f64| {
        let p = camera * nalgebra::Point3::new(0.0, 0.0, metres);
        Vec3::new(p.x as f32, p.y as f32, p.z as f32)
    };
    let model = demo_scene().objects[0].model.clone();
    // (what, position, scale, whether it is seen)
    let cases = [
        ("larger than the room", in_front(1.0), 100.0, None),
        ("behind the camera", in_front(-1.0), 1.0, Some(false)),
        ("half behind the camera", in_front(0.0) - Vec3::Z * 0.5, 8.0, None),
        ("around the camera", in_front(0.0) - Vec3::Z, 20.0, None),
        ("exactly at the camera", in_front(0.0), 1.0, None),
        ("below the floor", Vec3::new(0.0, 0.0, -3.0), 1.0, Some(false)),
        ("a kilometre away", in_front(1000.0), 1.0, Some(false)),
        ("tiny", in_front(0.5), 1e-6, None),
        ("where it belongs", Vec3::new(0.0, -0.16, 0.0), 1.0, Some(true)),
    ];
    for (what, position, scale, seen) in cases {
        let place = Similarity::standing(position, Vec3::Z, 0.0, scale);
        let object = VirtualObject { model: model.clone(), placement: Placement::Placed(place) };
        for bounce in [true, false] {
            let mut settings = quick();
            settings.bounce.enabled = bounce;
            let scene = VirtualScene::from_objects([object.clone()]);
            let mut pipeline = pipeline(&recording, &settings, scene);
            for frame in &recording.frames {
                let outcome = process(&mut pipeline, frame);
                assert_finite(&pipeline, &outcome, what);
                assert!(outcome.light.valid(), "{what}: virtual objects do not disturb the light");
            }
            let pixels = virtual_pixels(&pipeline);
            assert!(seen.is_none_or(|seen| seen == (pixels > 0)), "{what}: {pixels} pixels");
        }
    }
}
