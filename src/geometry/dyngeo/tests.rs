mod oracle;

use super::*;
use crate::geometry::Origin;
use crate::image::Size;
use crate::math::random::Rng;
use crate::math::{Pinhole, Pose, View, pose_from_xyzw};
use crate::scene::analytic::{AnalyticScene, Shape};
use glam::Vec3;
use oracle::Oracle;
use std::cmp::Ordering;

const SIZES: [Size; 5] =
    [Size::new(67, 43), Size::new(1, 1), Size::new(3, 1), Size::new(1, 40), Size::new(640, 480)];

fn camera(size: Size, world_from_view: Pose) -> View {
    let f = size.width as f32 * 0.82;
    let (cx, cy) = (0.5 * (size.width as f32 - 1.0), 0.5 * (size.height as f32 - 1.0));
    let pinhole = Pinhole { width: size.width, height: size.height, fx: f, fy: f, cx, cy };
    View::perspective(pinhole, world_from_view)
}

fn frame(depth_m: Image<f32>, intensity: Image<f32>) -> RgbdFrame {
    RgbdFrame { depth_m, intensity, ..RgbdFrame::default() }
}

fn uniform(size: Size, value: f32) -> Image<f32> {
    Image::new(size, value)
}

fn model_of_depth(depth_m: Image<f32>) -> GBuffer {
    let mut model = GBuffer::empty(camera(depth_m.size(), Pose::identity()));
    model.depth_m = depth_m;
    model
}

/// Random smooth-ish frame and model with holes. Depths are multiples of 2^-8 m and intensities of
/// 2^-2 steps, so that every difference is exact in f32 and in f64 alike.
fn random_case(size: Size, seed: u32) -> (RgbdFrame, GBuffer) {
    let mut rng = Rng::new(&[seed, size.width as u32]);
    let mut sensor = uniform(size, 0.0);
    let mut model = uniform(size, 0.0);
    let mut intensity = uniform(size, 0.0);
    for y in 0..size.height {
        for x in 0..size.width {
            let step = if (x / 9 + y / 7) % 2 == 0 { 256.0 } else { 300.0 };
            let base = step + (rng.uniform() * 24.0).floor();
            let other = base + ((rng.uniform() - 0.5) * 40.0).floor();
            intensity[(x, y)] = (rng.uniform() * 80.0).floor() / 4.0;
            if rng.uniform() < 0.6 {
                sensor[(x, y)] = base / 256.0;
            }
            if rng.uniform() < 0.7 {
                model[(x, y)] = other / 256.0;
            }
        }
    }
    (frame(sensor, intensity), model_of_depth(model))
}

fn run(params: &DynGeoParams, frame: &RgbdFrame, model: &GBuffer) -> (DynGeo, GBuffer) {
    let mut dyngeo = DynGeo::new(params);
    let mut out = GBuffer::empty(model.view);
    out.depth_m.fill(f32::NAN); // poison
    out.origin.fill(Origin::Virtual);
    dyngeo.run(frame, model, &mut out);
    (dyngeo, out)
}

fn merge_only() -> DynGeoParams {
    DynGeoParams { smooth: false, denoise: false, ..DynGeoParams::default() }
}

#[test]
fn every_pass_equals_sorting_on_random_input_with_holes() {
    let other = DynGeoParams {
        merge_window: 11,
        smooth_window: 5,
        denoise_window: 4,
        taps: 4,
        intensity_threshold: 3.0,
        depth_threshold_m: 0.0625, // a multiple of 2^-8: differences of exactly lambda_D occur
        ..DynGeoParams::default()
    };
    for params in [DynGeoParams::default(), other] {
        for (seed, size) in SIZES.into_iter().enumerate() {
            let (frame, model) = random_case(size, seed as u32);
            let oracle = Oracle { frame: &frame, model: &model.depth_m, params: &params };
            let [merged, smoothed, denoised] = oracle.passes();
            let (dyngeo, out) = run(&params, &frame, &model);
            assert!(dyngeo.merged() == Some(&merged), "D' at {size}");
            assert!(dyngeo.smoothed() == Some(&smoothed), "D'' at {size}");
            assert!(out.depth_m == denoised, "D''' at {size}");
        }
    }
}

/// One pixel of interest in the middle of 41x41; the frame's surroundings are given.
fn merged_centre(sensor: f32, model: f32, around_sensor: f32, around_model: f32) -> f32 {
    let size = Size::new(41, 41);
    let (mut c, mut v) = (uniform(size, around_sensor), uniform(size, around_model));
    c[(20, 20)] = sensor;
    v[(20, 20)] = model;
    let (_, out) = run(&merge_only(), &frame(c, uniform(size, 90.0)), &model_of_depth(v));
    out.depth_m[(20, 20)]
}

#[test]
fn cases_of_equation_3() {
    // both there: far apart takes the sensor, close takes the model
    assert_eq!(merged_centre(1.0, 1.2, 2.0, 2.0), 1.0);
    assert_eq!(merged_centre(1.0, 1.03, 2.0, 2.0), 1.03);
    // sensor missing: model where at least half of the support agrees with it, else the median
    assert_eq!(merged_centre(0.0, 1.5, 2.0, 2.04), 1.5);
    assert_eq!(merged_centre(0.0, 1.5, 2.0, 2.2), 2.0);
    // the cases that the equation leaves out
    assert_eq!(merged_centre(1.0, 0.0, 2.0, 2.0), 1.0);
    assert_eq!(merged_centre(0.0, 0.0, 2.0, 2.0), 2.0);
    assert_eq!(merged_centre(0.0, 1.5, 0.0, 2.0), 1.5);
    assert_eq!(merged_centre(0.0, 0.0, 0.0, 2.0), 0.0);
}

#[test]
fn exactly_lambda_d_is_close_and_exactly_half_is_a_majority() {
    let size = Size::new(41, 41);
    let params = DynGeoParams { depth_threshold_m: 0.0625, ..merge_only() };
    let sensor = uniform(size, 1.0);
    let (_, out) = run(
        &params,
        &frame(sensor.clone(), uniform(size, 90.0)),
        &model_of_depth(uniform(size, 1.0625)),
    );
    assert!(out.depth_m.as_slice().iter().all(|&d| d == 1.0625));

    // Columns left of the pixel agree, columns right of it do not, its own has no sensor depth:
    // 10 of 20 taps agree. One agreeing tap less tips the balance.
    let (mut c, mut v) = (sensor, uniform(size, 1.0));
    for y in 0..41 {
        c[(20, y)] = 0.0;
        for x in 21..41 {
            c[(x, y)] = 1.5;
        }
    }
    v[(20, 20)] = 3.0;
    let intensity = uniform(size, 90.0);
    let (_, out) = run(&params, &frame(c.clone(), intensity.clone()), &model_of_depth(v.clone()));
    assert_eq!(out.depth_m[(20, 20)], 3.0);
    v[(10, 10)] = 0.0;
    let (_, out) = run(&params, &frame(c, intensity), &model_of_depth(v));
    assert_eq!(out.depth_m[(20, 20)], 1.0, "lower median of ten 1.0 and ten 1.5");
}

#[test]
fn holes_are_filled_from_pixels_of_similar_intensity_only() {
    let size = Size::new(41, 41);
    let mut c = uniform(size, 1.0);
    let mut intensity = uniform(size, 50.0);
    for y in 0..41 {
        for x in 20..41 {
            c[(x, y)] = 2.0;
            intensity[(x, y)] = 57.0; // a step of exactly lambda_I does not count (Eq. 1)
        }
    }
    c[(19, 20)] = 0.0;
    c[(20, 20)] = 0.0;
    let (_, out) = run(&merge_only(), &frame(c, intensity), &model_of_depth(uniform(size, 0.0)));
    assert_eq!(out.depth_m[(19, 20)], 1.0);
    assert_eq!(out.depth_m[(20, 20)], 2.0);
}

/// A wall 1.5 m away, with or without a ball ("hand") 0.8 m away in front of it.
fn hand_scene(hand: bool) -> AnalyticScene {
    let mut shapes = vec![Shape::Plane { normal: -Vec3::Z, offset: -1.5 }];
    if hand {
        shapes.push(Shape::Sphere { centre: Vec3::new(0.05, 0.0, 0.9), radius: 0.12 });
    }
    AnalyticScene::new(shapes)
}

fn picture_of(scene: &GBuffer, hand: f32, wall: f32) -> RgbdFrame {
    let size = scene.size();
    let intensity = Oracle::image(size, |p| if scene.depth_m[p] < 1.2 { hand } else { wall });
    frame(scene.depth_m.clone(), intensity)
}

fn pixels_off_by_more_than(tolerance: f32, out: &GBuffer, truth: &GBuffer) -> usize {
    let pairs = out.depth_m.as_slice().iter().zip(truth.depth_m.as_slice());
    pairs.filter(|(a, b)| (*a - *b).abs().partial_cmp(&tolerance) != Some(Ordering::Less)).count()
}

#[test]
fn a_hand_appears_and_disappears_within_one_frame() {
    let view = camera(Size::new(320, 240), Pose::identity());
    let (with, without) = (hand_scene(true).render(&view), hand_scene(false).render(&view));
    let hand = with.depth_m.as_slice().iter().filter(|&&d| d < 1.2).count();
    assert!(hand > 3000, "the hand is in view: {hand} pixels");

    let (_, out) = run(&DynGeoParams::default(), &picture_of(&with, 180.0, 90.0), &without);
    let from_sensor = out.origin.as_slice().iter().zip(with.depth_m.as_slice());
    let wrong =
        from_sensor.filter(|&(&origin, &d)| (origin == Origin::Sensor) != (d < 1.2)).count();
    // The unguided 3x3 median shaves off single pixels where the silhouette turns a corner.
    assert!(wrong < hand / 200, "{wrong} of {hand} pixels of the wrong origin");
    // Medians slide depth along the ball's steep rim: its last 4 pixels (the reach of D'') span
    // sqrt(2 * 0.12 m * 4 * 3.4 mm) = 57 mm.
    let far_off = pixels_off_by_more_than(0.06, &out, &with);
    assert!(far_off <= wrong, "{far_off} pixels at the wrong depth");

    let (_, out) = run(&DynGeoParams::default(), &picture_of(&without, 180.0, 90.0), &with);
    assert_eq!(pixels_off_by_more_than(1e-6, &out, &without), 0, "of the removed hand");
}

#[test]
fn depth_edges_move_to_the_intensity_edges() {
    let size = Size::new(64, 48);
    // the depth edge lies 2 pixels, half the reach of D'', right of the intensity edge
    let depth = Oracle::image(size, |(x, _)| if x < 34 { 1.0 } else { 1.6 });
    let intensity = Oracle::image(size, |(x, _)| if x < 32 { 40.0 } else { 120.0 });
    let expected = Oracle::image(size, |(x, _)| if x < 32 { 1.0 } else { 1.6 });
    let frame = frame(depth, intensity);
    let (_, out) = run(&DynGeoParams::default(), &frame, &model_of_depth(uniform(size, 0.0)));
    assert!(out.depth_m == expected, "{:?}", &out.depth_m.row(24)[28..38]);
}

#[test]
fn constants_stay_and_nothing_comes_of_nothing() {
    for size in SIZES {
        let intensity = uniform(size, 128.0);
        let wall = frame(uniform(size, 1.25), intensity.clone());
        let (_, out) = run(&DynGeoParams::default(), &wall, &model_of_depth(uniform(size, 0.0)));
        assert!(out.depth_m == uniform(size, 1.25));
        assert!(out.origin.as_slice().iter().all(|&o| o == Origin::Sensor));

        let none = frame(uniform(size, 0.0), intensity);
        let (_, out) = run(&DynGeoParams::default(), &none, &model_of_depth(uniform(size, 0.0)));
        assert!(out.depth_m == uniform(size, 0.0));
        assert!(out.origin.as_slice().iter().all(|&o| o == Origin::None));
        assert!(out.normals == crate::image::NormalImage::new(size));
    }
}

#[test]
fn switched_off_passes_leave_depth_alone() {
    let (frame, model) = random_case(Size::new(67, 43), 5);
    let off = DynGeoParams { merge: false, ..merge_only() };
    let (dyngeo, out) = run(&off, &frame, &model);
    assert!(out.depth_m == model.depth_m);
    assert!(dyngeo.merged().is_none() && dyngeo.smoothed().is_none());
}

#[test]
fn broken_input_gives_no_broken_output() {
    let size = Size::new(67, 43);
    let (mut frame, mut model) = random_case(size, 9);
    let broken = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, f32::MAX, 1e-40];
    let mut rng = Rng::new(&[11]);
    for image in [&mut frame.depth_m, &mut frame.intensity, &mut model.depth_m] {
        for value in image.as_mut_slice() {
            if rng.uniform() < 0.3 {
                *value = broken[rng.next_u32() as usize % broken.len()];
            }
        }
    }
    for merge in [true, false] {
        let (_, out) = run(&DynGeoParams { merge, ..DynGeoParams::default() }, &frame, &model);
        for y in 0..size.height {
            for x in 0..size.width {
                let (depth, normal) = (out.depth_m[(x, y)], out.normals.at(x, y));
                assert!(depth.is_finite() && depth >= 0.0);
                let length = normal.length();
                assert!(length == 0.0 || (length - 1.0).abs() < 1e-5, "{normal}");
                assert_eq!(depth == 0.0, out.origin[(x, y)] == Origin::None);
            }
        }
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads_or_on_frames_before() {
    let (first, first_model) = random_case(Size::new(640, 480), 1);
    let (second, second_model) = random_case(Size::new(67, 43), 2);
    let (_, expected) = run(&DynGeoParams::default(), &second, &second_model);
    for threads in [1, 2, 5] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut out = GBuffer::empty(first_model.view);
        let mut dyngeo = DynGeo::new(&DynGeoParams::default());
        pool.install(|| dyngeo.run(&first, &first_model, &mut out));
        pool.install(|| dyngeo.run(&second, &second_model, &mut out));
        assert!(out.depth_m == expected.depth_m);
        assert!(out.normals == expected.normals);
        assert!(out.origin == expected.origin);
    }
}

#[test]
fn normals_of_depth_match_the_true_surfaces() {
    let pose = pose_from_xyzw([0.9, 0.7, 0.9], [0.35, 0.85, -0.35, -0.15]).unwrap();
    let view = camera(Size::new(320, 240), pose);
    let truth = AnalyticScene::corner().render(&view);
    let seen = truth.depth_m.as_slice().iter().filter(|&&d| d > 0.0).count();
    assert!(seen > 320 * 240 / 2, "the camera looks at the scene, {seen} pixels");
    let mut out = GBuffer::empty(view);
    out.depth_m = truth.depth_m.clone();
    normals::assign(&mut out, &GBuffer::empty(view), 0.05);

    let mut angles = Vec::new();
    for y in 0..240 {
        for x in 0..320 {
            if truth.depth_m[(x, y)] > 0.0 {
                assert_eq!(out.origin[(x, y)], Origin::Sensor);
                let cosine = out.normals.at(x, y).dot(truth.normals.at(x, y));
                angles.push(cosine.clamp(-1.0, 1.0).acos().to_degrees());
            }
        }
    }
    angles.sort_by(f32::total_cmp);
    let share = |p: f64| angles[(p * (angles.len() - 1) as f64) as usize];
    // Planes are exact up to rounding (f32 depth near 1 m over a step of 6 pixels: 1e-7 / 2e-2
    // rad); the ball bends by less than a degree over 3 pixels; creases between faces are the rest.
    assert!(share(0.5) < 0.05 && share(0.9) < 1.0, "{} {}", share(0.5), share(0.9));
}

#[test]
fn model_normals_are_kept_where_the_model_is_what_is_seen() {
    let view = camera(Size::new(67, 43), Pose::identity());
    let mut model = hand_scene(false).render(&view);
    let marked = Vec3::new(0.6, 0.0, -0.8); // no normal of the depth map
    for y in 0..43 {
        for x in 0..67 {
            model.normals.set(x, y, if x < 30 { marked } else { Vec3::ZERO });
        }
    }
    let (_, out) = run(&DynGeoParams::default(), &picture_of(&model, 0.0, 90.0), &model);
    assert_eq!(out.normals.at(10, 20), marked);
    assert_eq!(out.origin[(10, 20)], Origin::Model);
    // the model has no normal here: the depth map's own
    assert!((out.normals.at(50, 20) + Vec3::Z).length() < 1e-4);
    assert_eq!(out.origin[(50, 20)], Origin::Sensor);
}

#[test]
#[ignore = "timing; run with --release --ignored --nocapture on an idle machine"]
fn time_dyngeo_640x480() {
    let view = camera(Size::new(640, 480), Pose::identity());
    let (with, model) = (hand_scene(true).render(&view), hand_scene(false).render(&view));
    let mut frame = picture_of(&with, 180.0, 90.0);
    let mut rng = Rng::new(&[4]);
    for depth in frame.depth_m.as_mut_slice() {
        // a fifth of the pixels missing, everywhere: no chunk of D' can be skipped
        *depth = if rng.uniform() < 0.2 { 0.0 } else { *depth + 0.003 * rng.normal() };
    }
    let nothing = GBuffer::empty(view);
    let mut out = GBuffer::empty(view);
    for (what, model, params) in [
        ("D' alone", &model, merge_only()),
        ("all passes", &model, DynGeoParams::default()),
        ("all passes, no model", &nothing, DynGeoParams::default()),
        ("without D'''", &model, DynGeoParams { denoise: false, ..DynGeoParams::default() }),
    ] {
        let mut dyngeo = DynGeo::new(&params);
        let mut times: Vec<f64> = (0..60)
            .map(|_| {
                let start = std::time::Instant::now();
                dyngeo.run(&frame, model, &mut out);
                start.elapsed().as_secs_f64() * 1e3
            })
            .collect();
        times.sort_by(f64::total_cmp);
        let threads = rayon::current_num_threads();
        println!("{what}: min {:.2} median {:.2} ms, {threads} threads", times[0], times[30]);
    }
}
