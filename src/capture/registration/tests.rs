use super::*;
use crate::capture::calibration::Distortion;
use crate::math::View;
use crate::scene::analytic::{AnalyticScene, Shape};
use glam::Vec3;
use nalgebra::Vector3;

fn depth_camera() -> CameraModel {
    CameraModel {
        width: 320,
        height: 240,
        fx: 292.0,
        fy: 293.0,
        cx: 160.0,
        cy: 119.0,
        distortion: Distortion::None,
    }
}

fn color_camera() -> Pinhole {
    Pinhole { width: 300, height: 250, fx: 264.0, fy: 262.0, cx: 151.0, cy: 124.0 }
}

/// Depth as both cameras see a scene, and the depth camera's picture registered.
fn both(scene: &AnalyticScene, color_from_depth: Pose, out: Pinhole) -> (Image<f32>, Image<f32>) {
    let seen = |camera, pose| scene.render(&View::perspective(camera, pose)).depth_m;
    let truth = seen(out, color_from_depth.inverse());
    let depth = seen(depth_camera().pinhole(), Pose::identity());
    let mut registered = Image::default();
    let mut stage = Registration::new(&depth_camera(), out, &color_from_depth);
    stage.register(&depth, &mut registered);
    (truth, registered)
}

fn rig() -> Pose {
    Pose::new(Vector3::new(-0.03, 0.004, 0.002), Vector3::new(0.01, -0.008, 0.02))
}

#[test]
fn slanted_planes_have_no_holes_and_exact_depth() {
    let plane = Vec3::new(0.5, -0.3, -0.8).normalize();
    let scene = AnalyticScene::new([Shape::Plane { normal: plane, offset: -1.2 }]);
    for out in [
        color_camera(),
        Pinhole { width: 900, height: 750, fx: 792.0, fy: 786.0, cx: 450.0, cy: 372.0 },
    ] {
        let (truth, found) = both(&scene, rig(), out);
        let s = out.width / 300;
        let mut worst = 0.0f32;
        for y in 20 * s..215 * s {
            for x in 20 * s..270 * s {
                let (t, f) = (truth[(x, y)], found[(x, y)]);
                assert!(f > 0.0, "hole at {x} {y}");
                worst = worst.max((f - t).abs() / t);
            }
        }
        // 1/z is linear on a plane, so only f32 is left: coordinates of 300..900 to 6e-5 px,
        // times a slope of 0.5 % a pixel (0.2 % in the large picture)
        assert!(worst < 2e-6, "{worst}");
    }
}

#[test]
fn foreground_wins_and_its_shadow_stays_missing() {
    // A board 0.6 m before a wall at 1.6 m, baseline 3 cm.
    let scene = AnalyticScene::new([
        Shape::Plane { normal: -Vec3::Z, offset: -1.6 },
        Shape::Box { min: Vec3::new(-0.1, -0.1, 0.6), max: Vec3::new(0.1, 0.1, 0.61) },
    ]);
    let shift = Pose::translation(-0.03, 0.0, 0.0);
    let (truth, found) = both(&scene, shift, color_camera());
    let mut missing_wall = 0;
    for y in 90..150 {
        for x in 20..250 {
            let (t, f) = (truth[(x, y)], found[(x, y)]);
            // Each edge of the board may be off by the pixel that straddles it.
            let near_edge = (1..=2).any(|k| truth[(x - k, y)] != t || truth[(x + k, y)] != t);
            if near_edge {
                assert!(f == 0.0 || (f - 0.6).abs() < 1e-4 || (f - 1.6).abs() < 1e-4, "{f}");
            } else if f == 0.0 {
                assert!(t > 1.0, "board has a hole at {x} {y}");
                missing_wall += 1;
            } else {
                assert!((f - t).abs() < 1e-4, "{x} {y}: {f} {t}");
            }
        }
    }
    // Shadow width: fx b (1/0.6 - 1/1.6) = 264 * 0.03 * 1.04 = 8.3 px in 60 rows, less the 4 px at its
    // ends that were not looked at
    assert!((200..=360).contains(&missing_wall), "{missing_wall}");
}

#[test]
fn the_identity_changes_nothing() {
    let camera = depth_camera();
    let mut depth = Image::new(camera.size(), 0.0f32);
    let mut rng = crate::math::random::Rng::new(&[5]);
    for (i, d) in depth.as_mut_slice().iter_mut().enumerate() {
        let step = if i % 320 < 160 { 0.8 } else { 2.0 };
        *d = if rng.uniform() < 0.1 { 0.0 } else { step + 0.001 * rng.uniform() };
    }
    let mut out = Image::default();
    let mut stage = Registration::new(&camera, camera.pinhole(), &Pose::identity());
    stage.register(&depth, &mut out);
    for (a, b) in depth.as_slice().iter().zip(out.as_slice()) {
        // places are exact to about 3e-5 px; neighbours differ by 1 mm at most within a patch
        assert!((a - b).abs() < 1e-6 * (1.0 + a), "{a} {b}");
    }
}

#[test]
fn nonsense_depth_is_missing_and_takes_no_time() {
    let mut stage = Registration::new(&depth_camera(), color_camera(), &rig());
    let mut out = Image::new(color_camera().size(), 7.0);
    for bad in [f32::NAN, f32::INFINITY, -1.0, 1e-30, 0.0] {
        stage.register(&Image::new(depth_camera().size(), bad), &mut out);
        assert!(out.as_slice().iter().all(|&d| d == 0.0), "{bad}");
    }
}

#[test]
fn threads_do_not_change_a_bit() {
    let (_, once) = both(&AnalyticScene::corner(), rig(), color_camera());
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let (_, alone) = pool.install(|| both(&AnalyticScene::corner(), rig(), color_camera()));
    assert_eq!(once, alone);
}

#[test]
fn a_distorted_depth_camera_sees_the_same_surface() {
    let mut camera = depth_camera();
    camera.distortion = Distortion::Brown { k1: -0.12, k2: 0.05, p1: 1e-3, p2: -5e-4, k3: 0.0 };
    let plane = Shape::Plane { normal: -Vec3::Z, offset: -1.1 };
    // A wall facing the camera has constant z however the lens bends the picture.
    let depth = Image::new(camera.size(), 1.1);
    let mut out = Image::default();
    Registration::new(&camera, color_camera(), &rig()).register(&depth, &mut out);
    let scene = AnalyticScene::new([plane]);
    let truth = scene.render(&View::perspective(color_camera(), rig().inverse())).depth_m;
    for y in 30..220 {
        for x in 30..260 {
            assert!((out[(x, y)] - truth[(x, y)]).abs() < 1e-5, "{x} {y}");
        }
    }
}
