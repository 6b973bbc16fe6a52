//! Tests of the stage on analytic scenes.

use super::batch::hiddenness;
use super::test_support::*;
use super::*;
use crate::geometry::GBuffer;
use crate::math::Pose;
use crate::math::sh::unoccluded_transfer;
use crate::scene::analytic::{AnalyticScene, Shape};
use glam::Vec3;

/// f32 recursion of the harmonics against f64: values up to 1 after the cosine's factors.
const ROUNDING: f32 = 2e-6;

/// Largest difference to the unoccluded transfer over all grid points with a surface.
fn occlusion_anywhere(map: &TransferMap, main: &GBuffer) -> f32 {
    let mut worst = 0.0f32;
    for j in 0..map.grid.height {
        for i in 0..map.grid.width {
            let (x, y) = map.pixel(i, j, main.size());
            let expected = match main.depth_m[(x, y)] > 0.0 {
                true => unoccluded_transfer(main.normals.at(x, y), map.bands),
                false => [0.0; 36],
            };
            for (a, b) in map.at(i, j).iter().zip(expected) {
                worst = if (a - b).abs() <= worst { worst } else { (a - b).abs() };
            }
        }
    }
    worst
}

#[test]
fn k_is_monotone_and_bounded() {
    for chi in [1e-3, 0.05, 0.2, 0.95] {
        let mut last = 0.0;
        for k in -2000..=1000 {
            let h = hiddenness(k as f32 / 1000.0, chi);
            assert!((0.0..=1.0).contains(&h) && h >= last);
            last = h;
        }
        // a tenth of chi in f32: 1 - chi rounds to 6e-8, over chi = 1e-3
        assert!((last - 1.0).abs() < 1e-4 && hiddenness(1.0 - 1.001 * chi, chi) == 0.0);
        assert!((hiddenness(1.0 - 0.5 * chi, chi) - 0.5).abs() < 1e-4);
        assert_eq!(hiddenness(f32::NAN, chi), 0.0);
    }
}

#[test]
fn convex_surfaces_alone_are_unoccluded() {
    let ball = Shape::Sphere { centre: Vec3::new(0.0, 0.1, 0.3), radius: 0.3 };
    let cube = Shape::Box { min: Vec3::splat(-0.2), max: Vec3::new(0.3, 0.1, 0.4) };
    for shape in [FLOOR, ball, cube] {
        let scene = AnalyticScene::new([shape]);
        let main = scene.render(&camera(160, 120));
        let auxiliary: Vec<_> = auxiliary_views(64).iter().map(|view| scene.render(view)).collect();
        for chi in [ChiReading::Text, ChiReading::Neighbour, ChiReading::Printed] {
            for bands in 1..=6 {
                let params = TransferParams { bands, chi, ..TransferParams::default() };
                let worst = occlusion_anywhere(&transferred(&params, &main, &[]), &main);
                assert!(worst < ROUNDING, "{shape:?} {chi:?} {bands}: {worst}");
            }
            // What a side view with pixels of 4 cm knows of a ball's rim is coarse: measured 0.4 %.
            let params = TransferParams { chi, ..TransferParams::default() };
            let map = transferred(&params, &main, &auxiliary);
            let shades: Vec<f32> =
                map.coefficients.chunks(16).map(furnace).filter(|&s| s > 0.0).collect();
            let mean = shades.iter().sum::<f32>() / shades.len() as f32;
            assert!(mean > 0.99, "{shape:?} {chi:?}: {mean}");
        }
    }
}

#[test]
fn a_flat_floor_never_hides_itself() {
    // 4 m away at 3 to 6 degrees, where a pixel covers 0.1 m of depth; depth in steps of 0.2 mm.
    let scene = AnalyticScene::new([FLOOR]);
    let side = scene.render(&orthographic(
        64,
        6.0,
        look_at(Vec3::new(-2.0, 4.0, 0.4), Vec3::new(0.0, 4.0, 0.0)),
    ));
    for height_m in [0.2, 0.3, 0.5] {
        let eye = Vec3::new(0.0, 0.0, height_m);
        let view = perspective(320, 240, look_at(eye, Vec3::new(0.0, 4.0, 0.0)));
        let mut main = scene.render(&view);
        for depth in main.depth_m.as_mut_slice() {
            *depth = if *depth < 8.0 { (*depth * 5000.0).round() / 5000.0 } else { 0.0 };
        }
        assert!(main.depth_m.as_slice().iter().any(|&d| d > 4.0));
        let params = TransferParams { chi: ChiReading::Printed, ..TransferParams::default() };
        let map = transferred(&params, &main, std::slice::from_ref(&side));
        let worst = occlusion_anywhere(&map, &main);
        assert!(worst < ROUNDING, "camera {height_m} m above the floor: {worst}");
    }
}

#[test]
fn shading_in_a_white_furnace_stays_between_0_and_1() {
    let scene = AnalyticScene::corner();
    let main = scene.render(&camera(160, 120));
    let auxiliary: Vec<_> = auxiliary_views(64).iter().map(|view| scene.render(view)).collect();
    for directions in [4, 32, 1024] {
        for chi in [ChiReading::Text, ChiReading::Printed] {
            let params = TransferParams { directions, chi, samples: 4, ..Default::default() };
            let params = TransferParams { subsampling: 3, ..params };
            let map = transferred(&params, &main, &auxiliary);
            let (mut low, mut high) = (f32::INFINITY, 0.0f32);
            for c in map.coefficients.chunks(16).filter(|c| c[0] != 0.0) {
                low = low.min(furnace(c));
                high = high.max(furnace(c));
            }
            assert!(low >= -ROUNDING && high <= 1.0 + ROUNDING, "{low} {high}");
            assert!(low < 0.9 && high > 0.999, "the corner must hide something: {low} {high}");
        }
    }
}

#[test]
fn geometry_that_only_a_side_view_sees_hides_light() {
    // A box behind the camera, and the floor before it.
    let floor = AnalyticScene::new([FLOOR]);
    let mut with_box = floor.clone();
    with_box
        .shapes
        .push(Shape::Box { min: Vec3::new(-0.5, -0.6, 0.0), max: Vec3::new(0.5, -0.2, 0.7) });
    let view = perspective(64, 48, look_at(Vec3::new(0.0, 0.0, 0.5), Vec3::new(0.0, 0.25, 0.0)));
    let main = with_box.render(&view);
    assert_eq!(main.depth_m, floor.render(&view).depth_m, "the camera must not see the box");
    let front = orthographic(128, 2.0, look_at(Vec3::new(0.0, 2.0, 0.6), Vec3::new(0.0, 0.0, 0.3)));
    let params = TransferParams::default();
    assert!(occlusion_anywhere(&transferred(&params, &main, &[]), &main) < ROUNDING);
    let side = [with_box.render(&front)];
    let map = transferred(&params, &main, &side);
    let shade: f64 = map.coefficients.chunks(16).map(|c| f64::from(furnace(c))).sum();
    let mean = shade / map.grid.pixels() as f64;
    assert!((0.6..0.97).contains(&mean), "{mean}");
    // Light from behind (y < 0) is what is missing: coefficient 1 is 0 on an open floor.
    let y: f64 = map.coefficients.chunks(16).map(|c| f64::from(c[1])).sum();
    assert!(y / map.grid.pixels() as f64 > 0.01, "{y}");
}

#[test]
fn a_mirrored_scene_has_mirrored_transfer() {
    let post = |x: f32| {
        let (a, b) = (x - 0.1, x + 0.1);
        let corners = (Vec3::new(a, -0.1, 0.0), Vec3::new(b, 0.1, 0.6));
        AnalyticScene::new([FLOOR, Shape::Box { min: corners.0, max: corners.1 }])
    };
    let view = perspective(128, 96, look_at(Vec3::new(0.0, -1.5, 1.0), Vec3::ZERO));
    let params = TransferParams { directions: 256, samples: 4, ..TransferParams::default() };
    let a = transferred(&params, &post(0.3).render(&view), &[]);
    let b = transferred(&params, &post(-0.3).render(&view), &[]);
    // Y is odd in x for these indices of the first 16.
    let odd = |k: usize| [3, 4, 7, 10, 13, 15].contains(&k);
    // The principal point lies between two pixels, so pixel u mirrors to 127 - u. Jitter and
    // directions are not mirrored: compare means over 8 x 8 blocks.
    let (mut error, mut norm) = (0.0f64, 0.0f64);
    for block in 0..16 * 12 {
        for k in 0..16 {
            let (mut p, mut q) = (0.0f64, 0.0f64);
            for (i, j) in (0..64).map(|c| (block % 16 * 8 + c % 8, block / 16 * 8 + c / 8)) {
                p += f64::from(a.at(i, j)[k]);
                q += f64::from(b.at(127 - i, j)[k]) * if odd(k) { -1.0 } else { 1.0 };
            }
            error += (p - q).powi(2);
            norm += p.powi(2);
        }
    }
    let relative = (error / norm).sqrt();
    // measured 0.8 %, of an occlusion that makes up some 10 %
    assert!(relative < 0.02, "{relative}");
}

#[test]
fn nothing_in_view_gives_nothing() {
    let scene = AnalyticScene::corner();
    let view = camera(67, 43);
    let away = perspective(64, 48, look_at(Vec3::new(50.0, 0.0, 1.0), Vec3::new(60.0, 0.0, 1.0)));
    let main = scene.render(&view);
    let alone = transferred(&TransferParams::default(), &main, &[]);
    // Auxiliary views that see nothing, or are elsewhere, change nothing.
    let blank = GBuffer::empty(orthographic(32, 2.0, Pose::identity()));
    let none = GBuffer::empty(orthographic(0, 2.0, Pose::identity()));
    let elsewhere = scene.render(&away);
    assert_eq!(alone, transferred(&TransferParams::default(), &main, &[blank, none, elsewhere]));
    let empty = transferred(&TransferParams::default(), &GBuffer::empty(view), &[main]);
    assert!(empty.coefficients.iter().all(|&c| c == 0.0));
    let mut no_pixels = TransferMap::default();
    let nothing = GBuffer::empty(perspective(0, 0, Pose::identity()));
    stage(&TransferParams::default()).transfer(&nothing, &[], &mut no_pixels);
    assert_eq!(no_pixels.coefficients.len(), 0);
}

#[test]
fn broken_pixels_stay_their_own_problem() {
    let scene = AnalyticScene::corner();
    let mut main = scene.render(&camera(67, 43));
    let bad = [f32::NAN, f32::INFINITY, -1.0, f32::MIN_POSITIVE, 1e30, f32::NEG_INFINITY];
    for k in 0..600 {
        let (x, y) = (k * 7 % 67, k * 13 % 43);
        match k % 3 {
            0 => main.depth_m[(x, y)] = bad[k % 6],
            1 => main.normals.x[(x, y)] = bad[k % 6],
            _ => main.normals.set(x, y, Vec3::ZERO),
        }
    }
    let auxiliary = [main.clone()];
    let map = transferred(&TransferParams::default(), &main, &auxiliary);
    assert!(map.coefficients.iter().all(|c| c.is_finite()));
    assert!(
        map.coefficients.chunks(16).all(|c| (-ROUNDING..=1.0 + ROUNDING).contains(&furnace(c)))
    );
}

#[test]
fn every_grid_and_size_matches_the_full_one() {
    let scene = AnalyticScene::corner();
    let main = scene.render(&camera(67, 43));
    let auxiliary: Vec<_> = auxiliary_views(64).iter().map(|view| scene.render(view)).collect();
    let params = |subsampling, bands, directions| {
        // A tile of one pixel, so that the samples do not depend on the grid.
        let params = TransferParams { subsampling, bands, directions, ..Default::default() };
        TransferParams { jitter_tile: 1, ..params }
    };
    for directions in [4, 33, 1024] {
        let full = transferred(&params(1, 6, directions), &main, &auxiliary);
        for (step, bands) in [(1, 4), (2, 1), (4, 2), (8, 3), (5, 5), (64, 6)] {
            let map = transferred(&params(step, bands, directions), &main, &auxiliary);
            assert_eq!(map.grid, Size::new(67usize.div_ceil(step), 43usize.div_ceil(step)));
            for (i, j) in (0..map.grid.pixels()).map(|k| (k % map.grid.width, k / map.grid.width)) {
                let (x, y) = map.pixel(i, j, main.size());
                assert_eq!(map.at(i, j), &full.at(x, y)[..bands * bands], "step {step} {i} {j}");
            }
        }
    }
    let one = scene.render(&camera(1, 1));
    assert_eq!(transferred(&TransferParams::default(), &one, &[]).coefficients.len(), 16);
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let scene = AnalyticScene::corner();
    let main = scene.render(&camera(67, 43));
    let auxiliary: Vec<_> = auxiliary_views(64).iter().map(|view| scene.render(view)).collect();
    let with_threads = |n| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        pool.install(|| transferred(&TransferParams::default(), &main, &auxiliary))
    };
    assert_eq!(with_threads(1), with_threads(3));
}

#[test]
fn parameters_out_of_range_are_named() {
    let error = |params: TransferParams| DirectionSet::new(&params).unwrap_err().to_string();
    let base = TransferParams::default();
    assert!(error(TransferParams { bands: 7, ..base.clone() }).contains("transfer.bands is 7"));
    assert!(error(TransferParams { directions: 3, ..base.clone() }).contains("4 to 1024"));
    assert!(error(TransferParams { radius_m: f32::NAN, ..base.clone() }).contains("radius_m"));
    assert!(error(TransferParams { subsampling: 0, ..base.clone() }).contains("subsampling"));
    assert!(error(TransferParams { samples: 0, ..base.clone() }).contains("samples"));
    assert!(error(TransferParams { bias_m: -1.0, ..base.clone() }).contains("bias_m"));
    assert!(error(TransferParams { jitter_tile: 0, ..base }).contains("jitter_tile"));
}
