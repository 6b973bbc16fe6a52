use super::*;
use crate::fusion::FusionError;
use crate::geometry::Origin;
use crate::image::Size;

fn finite(out: &GBuffer) {
    for y in 0..out.size().height {
        for x in 0..out.size().width {
            let (depth, normal) = (out.depth_m[(x, y)], out.normals.at(x, y));
            if out.origin[(x, y)] == Origin::None {
                assert_eq!((depth, normal), (0.0, Vec3::ZERO));
            } else {
                assert!(depth > 0.0 && depth.is_finite());
                assert!((normal.length() - 1.0).abs() < 1e-5, "{normal}");
            }
        }
    }
}

#[test]
fn every_allowed_resolution_works() {
    let scene = AnalyticScene::corner();
    let view = View::perspective(camera(160, 120), arc(1).next().unwrap());
    for resolution in [8, 64, 256, 512] {
        let mut volume = volume(resolution);
        integrate_arc(&mut volume, &scene, (160, 120), 2);
        let out = cast(&volume, &view);
        finite(&out);
        let seen = out.depth_m.as_slice().iter().filter(|&&d| d > 0.0).count();
        assert!(seen > 5_000, "{resolution}: {seen}"); // of 19200; voxels of 25 cm lose most
    }
}

#[test]
fn settings_that_cannot_work_are_refused_together() {
    let good = VolumeParams::default();
    let refused = |params: VolumeParams, words: &[&str]| match TsdfVolume::new(&params, Vec3::ZERO)
    {
        Err(FusionError::Params(text)) => {
            assert!(words.iter().all(|w| text.contains(w)), "{text}");
        }
        other => panic!("{other:?}"),
    };
    for resolution in [0, 7, 12, 520] {
        refused(VolumeParams { resolution, ..good.clone() }, &["resolution", "multiple of 8"]);
    }
    for side_m in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        refused(VolumeParams { side_m, ..good.clone() }, &["side_m"]);
    }
    // shorter than a voxel (7.8 mm), than its diagonal, longer than the cube, broken
    for truncation_m in [0.005, 0.01, 3.0, -0.1, f32::NAN] {
        refused(VolumeParams { truncation_m, ..good.clone() }, &["truncation_m", "diagonal"]);
    }
    let many = VolumeParams { max_weight: 0, resolution: 9, side_m: 0.0, ..good.clone() };
    refused(many, &["max_weight", "resolution", "side_m"]);
    assert!(TsdfVolume::new(&good, Vec3::NAN).is_err());
}

#[test]
fn the_shortest_truncation_leaves_no_holes() {
    let scene = AnalyticScene::corner();
    let params = VolumeParams { resolution: 128, truncation_m: 0.0271, ..VolumeParams::default() };
    let mut volume = TsdfVolume::new(&params, Vec3::new(0.0, 0.0, 0.4)).unwrap();
    integrate_arc(&mut volume, &scene, (640, 480), 4);
    let view = View::perspective(camera(160, 120), arc(1).next().unwrap());
    let out = cast(&volume, &view);
    finite(&out);
    let seen = out.depth_m.as_slice().iter().filter(|&&d| d > 0.0).count();
    assert!(seen > 15_000, "{seen}"); // of 19200, measured with four voxels: 19123
}

#[test]
fn the_camera_may_be_anywhere() {
    let scene = AnalyticScene::corner();
    let mut volume = volume(128);
    integrate_arc(&mut volume, &scene, (320, 240), 4);
    let target = Vec3::new(0.0, 0.2, 0.1);
    let eyes = [
        ("inside", Vec3::new(0.5, -0.5, 0.6)),
        ("outside", Vec3::new(3.0, -3.0, 2.5)),
        ("on the floor", Vec3::new(0.6, -0.3, 0.0)),
        ("under the floor", Vec3::new(0.6, -0.3, -0.5)),
        ("on the border", Vec3::new(1.0, -0.3, 0.4)),
    ];
    for (name, eye) in eyes {
        let pose = look_at(eye, target);
        let camera = View::perspective(camera(67, 43), pose);
        for view in [camera, orthographic(43, 2.0, pose)] {
            let out = cast(&volume, &view);
            finite(&out);
            let seen = out.depth_m.as_slice().iter().filter(|&&d| d > 0.0).count();
            println!("{name}: {seen}");
            if matches!(name, "inside" | "outside") {
                assert!(seen > 200, "{name}: {seen}");
            }
        }
        // and a frame may be taken from there
        volume.integrate(&render(&scene, &camera), &camera).unwrap();
    }
    let away =
        View::perspective(camera(67, 43), look_at(Vec3::new(3., 0., 0.), Vec3::new(9., 0., 0.)));
    assert!(cast(&volume, &away).depth_m.as_slice().iter().all(|&d| d == 0.0));
}

#[test]
fn odd_depth_is_survived() {
    let view = View::perspective(camera(67, 43), arc(1).next().unwrap());
    let size = view.size();
    for value in [0.0, -1.0, f32::NAN, f32::INFINITY, f32::MAX, 1e-30, 1.5] {
        let mut volume = volume(64);
        volume.integrate(&frame_of(Image::new(size, value)), &view).unwrap();
        finite(&cast(&volume, &view));
        if value != 1.5 && value != 1e-30 {
            assert!(volume.is_empty(), "{value}");
            assert!(volume.mesh().triangles.is_empty());
        }
    }
    for (width, height) in [(1, 1), (0, 0), (1, 9), (9, 1)] {
        let view = View::perspective(camera(width, height), arc(1).next().unwrap());
        let mut volume = volume(64);
        volume.integrate(&frame_of(Image::new(view.size(), 1.5)), &view).unwrap();
        finite(&cast(&volume, &view));
    }
}

#[test]
fn frames_that_do_not_fit_are_refused() {
    let mut volume = volume(64);
    let view = View::perspective(camera(67, 43), arc(1).next().unwrap());
    let wrong = frame_of(Image::new(Size::new(43, 67), 1.0));
    assert!(matches!(volume.integrate(&wrong, &view), Err(FusionError::Size { .. })));
    let mut broken = view;
    broken.world_from_view.translation.vector.x = f64::NAN;
    let frame = frame_of(Image::new(view.size(), 1.0));
    assert!(matches!(volume.integrate(&frame, &broken), Err(FusionError::Pose { .. })));
    assert_eq!(volume.revision(), 0);
}

#[test]
fn depth_is_not_mixed_over_edges() {
    // The left half at 1 m, the right at 1.5 m: nothing may be built between.
    let view = View::perspective(
        camera(64, 48),
        look_at(Vec3::new(0., -1.0, 0.4), Vec3::new(0., 0., 0.4)),
    );
    let mut depth = Image::new(view.size(), 1.0);
    for y in 0..48 {
        depth.row_mut(y)[32..].fill(1.5);
    }
    let mut volume = volume(256);
    volume.integrate(&frame_of(depth), &view).unwrap();
    let out = cast(&volume, &view);
    for &d in out.depth_m.as_slice() {
        let near = [0.0, 1.0, 1.5].iter().any(|v| (d - v).abs() < 1e-3);
        assert!(near, "{d}");
    }
}

#[test]
fn memory_follows_the_surface() {
    let scene = AnalyticScene::corner();
    let mut volume = volume(256);
    integrate_arc(&mut volume, &scene, (640, 480), 6);
    // measured 15 MB; dense it would be 128 MB with colour
    assert!(volume.memory_bytes() < 30_000_000, "{}", volume.memory_bytes());
    let held = volume.memory_bytes();
    let revision = volume.revision();
    volume.reset();
    assert!(volume.is_empty() && volume.revision() > revision && volume.memory_bytes() <= held);
    let view = View::perspective(camera(67, 43), arc(1).next().unwrap());
    assert!(cast(&volume, &view).depth_m.as_slice().iter().all(|&d| d == 0.0));
}
