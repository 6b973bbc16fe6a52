//! On made input, of which every output is known.

use super::grid::{Lamp, ShadingGrid, VirtualShading};
use super::smooth::{Likeness, smooth};
use super::test_support::*;
use super::upsample::{between, upsample};
use super::*;
use crate::geometry::Origin;
use crate::lighting::ShLight;
use crate::math::color::{LINEAR_FROM_SRGB8, linear_from_srgb, srgb8_from_linear};
use crate::math::random::Rng;
use crate::math::sh;

fn edge_aware() -> [CompositingParams; 2] {
    [Compositor::Ratio, Compositor::Difference]
        .map(|compositor| CompositingParams { compositor, ..CompositingParams::default() })
}

#[test]
fn without_objects_the_picture_is_the_cameras_bit_for_bit() {
    let mut rng = Rng::new(&[5]);
    for step in [1, 2, 4, 8] {
        let mut case = bare(SIZE, step);
        for pixel in case.frame.color_srgb.as_mut_slice() {
            *pixel = std::array::from_fn(|_| rng.next_u32() as u8);
        }
        // Noisy transfer, the same in both passes; holes in the depth.
        for t in &mut case.real_transfer.coefficients {
            *t += 0.2 * rng.normal();
        }
        case.merged_transfer = case.real_transfer.clone();
        for k in 0..300 {
            let (x, y) = ((k * 7) % SIZE.width, (k * 13) % SIZE.height);
            case.merged.depth_m[(x, y)] = 0.0;
            case.merged.origin[(x, y)] = Origin::None;
        }
        for bounce in [false, true] {
            if bounce {
                case.set_bounce([0.0; 3]);
            }
            for params in all_params() {
                let out = case.compose(&params);
                assert!(out == case.frame.color_srgb, "step {step} {params:?}");
            }
        }
    }
}

#[test]
fn a_virtual_copy_of_the_floor_is_not_seen() {
    for step in [1, 4] {
        let mut case = bare(SIZE, step);
        // The codes of the camera image are rounded: take the albedo that they stand for.
        let shading = shade(&case.light, &case.real_transfer.coefficients[..16]);
        let seen = LINEAR_FROM_SRGB8[usize::from(case.frame.color_srgb[(0, 0)][0])];
        for y in 10..30 {
            for x in 20..50 {
                case.merged.origin[(x, y)] = Origin::Virtual;
                case.layer.coverage[(x, y)] = if x == 20 || x == 49 { 0.4 } else { 1.0 };
                case.layer.albedo[(x, y)] = [seen * MEAN_ALBEDO / shading; 3];
            }
        }
        for params in all_params() {
            let out = case.compose(&params);
            for (a, b) in out.as_slice().iter().zip(case.frame.color_srgb.as_slice()) {
                // f32 rounding may cross the boundary of a code
                assert!(a[0].abs_diff(b[0]) <= 1, "step {step} {params:?}: {a:?} {b:?}");
            }
        }
    }
}

#[test]
fn ratio_and_difference_have_their_values() {
    // All of the floor loses half of its light, far from any object.
    let mut case = bare(SIZE, 4);
    case.merged_transfer = transfer(&case.merged, 4, |_| 0.5);
    let camera = LINEAR_FROM_SRGB8[usize::from(case.frame.color_srgb[(0, 0)][0])];
    let [ratio, difference] = edge_aware().map(|params| case.compose(&params));
    assert!(ratio.as_slice().iter().all(|p| *p == [srgb8_from_linear(0.5 * camera); 3]));
    // R is uniform, so its mean becomes the key: T(R) = .18 / 1.18, T(R') = .09 / 1.09
    let gain = 1.0 + 0.09 / 1.09 - 0.18 / 1.18;
    let expected = srgb8_from_linear(gain * camera);
    assert!(difference.as_slice().iter().all(|p| p[0].abs_diff(expected) <= 1));
}

#[test]
fn shadows_only_darken_and_keep_the_bounce() {
    for step in [1, 4] {
        let mut case = ball(SIZE, step, shadow);
        for params in edge_aware() {
            let out = case.compose(&params);
            let mut darker = 0;
            for (x, y) in case.pixels().filter(|&(x, y)| !case.is_virtual(x, y)) {
                let (new, old) = (out[(x, y)], case.frame.color_srgb[(x, y)]);
                assert!(new[0] <= old[0], "step {step} ({x}, {y}): {new:?} {old:?}");
                darker += usize::from(new[0] < old[0]);
            }
            assert!(darker > 100, "step {step}: {darker} pixels in shadow");
        }
        // All light taken away: the bounce remains, times the floor's albedo of 0.4.
        case.merged_transfer = transfer(&case.merged, step, |_| 0.0);
        case.set_bounce([0.2, 0.1, 0.0]);
        let out = case.compose(&CompositingParams::default());
        for (x, y) in case.pixels().filter(|&(x, y)| !case.is_virtual(x, y)) {
            for (c, least) in [0.08, 0.04, 0.0].into_iter().enumerate() {
                // the camera's code is rounded, so the albedo is known to about half a percent
                let least = srgb8_from_linear(least * 0.99);
                assert!(out[(x, y)][c] >= least, "({x}, {y}) {c}: {:?}", out[(x, y)]);
            }
        }
    }
}

#[test]
fn a_bounce_adds_albedo_times_light() {
    let mut case = bare(SIZE, 4);
    case.set_bounce([0.1, 0.0, 0.0]);
    let out = case.compose(&CompositingParams::default());
    let camera = LINEAR_FROM_SRGB8[usize::from(case.frame.color_srgb[(0, 0)][0])];
    let expected = srgb8_from_linear(camera + 0.4 * 0.1);
    for pixel in out.as_slice() {
        assert!(pixel[0].abs_diff(expected) <= 1, "{pixel:?}, expected {expected}");
        assert_eq!(pixel[1..], case.frame.color_srgb[(0, 0)][1..]);
    }
}

#[test]
fn nothing_bleeds_across_the_edge_of_an_object() {
    for step in [1, 2, 4, 8] {
        let case = ball(SIZE, step, |p| if p.z > 1e-3 { 0.05 } else { 1.0 });
        for params in edge_aware() {
            let out = case.compose(&params);
            for (x, y) in case.pixels().filter(|&(x, y)| !case.is_virtual(x, y)) {
                assert_eq!(out[(x, y)], case.frame.color_srgb[(x, y)], "step {step} ({x}, {y})");
            }
        }
        // and no light of the floor on the dark ball: 5 % of at most 0.35
        let buffers =
            CompositingStage::new(&CompositingParams::default()).shading_buffers(&case.input());
        for (x, y) in case.pixels().filter(|&(x, y)| case.is_virtual(x, y)) {
            assert!(buffers.merged[(x, y)][0] < 0.03, "{:?}", buffers.merged[(x, y)]);
        }
    }
}

#[test]
fn unoccluded_objects_have_their_analytic_shading_at_every_step() {
    for step in [1, 4, 8] {
        let case = ball(SIZE, step, |_| 1.0);
        let buffers =
            CompositingStage::new(&CompositingParams::default()).shading_buffers(&case.input());
        let floor = Lamp::new(&case.light).floor;
        for (x, y) in case.pixels().filter(|&(x, y)| case.is_virtual(x, y)) {
            let row = sh::unoccluded_transfer(case.merged.normals.at(x, y), 4);
            let exact = shade(&case.light, &row[..16]).max(floor);
            let found = buffers.merged[(x, y)][0];
            // f32 rounding of values below 1 through a quotient and its inverse
            assert!((found - exact).abs() < 1e-5, "step {step} ({x}, {y}): {found} {exact}");
        }
    }
}

#[test]
fn visibility_upsamples_better_than_shading() {
    let size = Size::new(160, 120);
    let case = ball(size, 4, shadow);
    let exact = transfer(&case.merged, 1, shadow);
    let error = |mode: VirtualShading| {
        let lamp = Lamp::new(&case.light);
        let mut grid = ShadingGrid::default();
        grid.evaluate(&case.input(), &lamp, mode);
        let likeness = Likeness { plane_tolerance: 0.02, normal_exponent: 8.0 };
        let (mut smoothed, mut full) = Default::default();
        smooth(&grid, &case.merged, likeness, &mut smoothed);
        let (mut columns, mut rows) = (Vec::new(), Vec::new());
        between(&grid.u, size.width, &mut columns);
        between(&grid.v, size.height, &mut rows);
        upsample(&grid, &smoothed, &case.merged, likeness, (&columns, &rows), &mut full);
        let mut squares = 0.0;
        for (x, y) in case.pixels().filter(|&(x, y)| case.is_virtual(x, y)) {
            let value = full.at(grid.layout.merged(0), x, y);
            let found = match mode {
                VirtualShading::Plain => value,
                VirtualShading::Visibility => {
                    lamp.shading(value, lamp.unoccluded(case.merged.normals.at(x, y))[0])
                }
            };
            squares += (found - shade(&case.light, exact.at(x, y))).powi(2);
        }
        squares.sqrt()
    };
    let (plain, visibility) = (error(VirtualShading::Plain), error(VirtualShading::Visibility));
    println!("error of R' on the ball: shading {plain}, visibility {visibility}");
    // measured: 0.53 times; what is left is the shadow, which the grid is too coarse for
    assert!(visibility < 0.6 * plain, "{visibility} against {plain}");
}

#[test]
fn upsampling_reproduces_constants_and_ramps() {
    for (step, upsampling) in [
        (1, Upsampling::JointBilateral),
        (4, Upsampling::JointBilateral),
        (8, Upsampling::JointBilateral),
        (4, Upsampling::BicubicGauss),
    ] {
        let params = CompositingParams { upsampling, ..CompositingParams::default() };
        let mut case = bare(SIZE, step);
        let base = shade(&case.light, &case.real_transfer.coefficients[..16]);
        let constant = CompositingStage::new(&params).shading_buffers(&case.input());
        for value in constant.real.as_slice().iter().chain(constant.merged.as_slice()) {
            // rounding of weighted means
            assert!((value[0] - base).abs() < 1e-6, "step {step}: {value:?}");
        }
        let map = &mut case.merged_transfer;
        for k in 0..map.grid.pixels() {
            let (i, j) = (k % map.grid.width, k / map.grid.width);
            let (x, y) = map.pixel(i, j, SIZE);
            let factor = 0.5 + 0.004 * x as f32 + 0.003 * y as f32;
            map.coefficients[k * 16..][..16].iter_mut().for_each(|t| *t *= factor);
        }
        let ramp = CompositingStage::new(&params).shading_buffers(&case.input());
        // Outside of the outermost points and their filters values are held, not extrapolated.
        let margin = if upsampling == Upsampling::BicubicGauss { 14 } else { 2 * step };
        for y in margin..SIZE.height - margin {
            for x in margin..SIZE.width - margin {
                let exact = base * (0.5 + 0.004 * x as f32 + 0.003 * y as f32);
                let found = ramp.merged[(x, y)][0];
                assert!((found - exact).abs() < 2e-6, "step {step} ({x}, {y}): {found} {exact}");
            }
        }
    }
}

#[test]
fn jitter_over_tiles_of_two_averages_out() {
    for step in [1, 4] {
        let mut case = bare(SIZE, step);
        let base = shade(&case.light, &case.real_transfer.coefficients[..16]);
        let map = &mut case.merged_transfer;
        for k in 0..map.grid.pixels() {
            let tile = (k % map.grid.width % 2) + 2 * (k / map.grid.width % 2);
            let factor = [0.7, 0.95, 0.85, 0.9][tile];
            map.coefficients[k * 16..][..16].iter_mut().for_each(|t| *t *= factor);
        }
        let buffers =
            CompositingStage::new(&CompositingParams::default()).shading_buffers(&case.input());
        for y in 2 * step..SIZE.height - 2 * step {
            for x in 2 * step..SIZE.width - 2 * step {
                assert!((buffers.merged[(x, y)][0] / base - 0.85).abs() < 1e-5);
            }
        }
    }
}

#[test]
fn coverage_blends_in_linear_light() {
    let mut case = ball(SIZE, 1, |_| 1.0);
    let full = case.compose(&CompositingParams::default());
    let (x, y) = (33, 21);
    assert!(case.is_virtual(x, y));
    case.layer.coverage[(x, y)] = 0.25;
    // and a floor pixel at the ball's edge
    let edge = (0..SIZE.width).find(|&x| case.is_virtual(x, y)).unwrap() - 1;
    case.layer.coverage[(edge, y)] = 0.5;
    let out = case.compose(&CompositingParams::default());
    let blend = |x: usize, over: [u8; 3], share: f32| {
        let camera = case.frame.color_srgb[(x, y)];
        std::array::from_fn::<u8, 3, _>(|c| {
            let (a, b) = (f32::from(over[c]) / 255.0, f32::from(camera[c]) / 255.0);
            let (a, b) = (linear_from_srgb(a), linear_from_srgb(b));
            srgb8_from_linear(b + share * (a - b))
        })
    };
    let near = |a: [u8; 3], b: [u8; 3]| (0..3).all(|c| a[c].abs_diff(b[c]) <= 1);
    let expected = blend(x, full[(x, y)], 0.25);
    assert!(near(out[(x, y)], expected), "{:?} {expected:?}", out[(x, y)]);
    // three virtual neighbours at most, of nearly one colour
    let expected = blend(edge, full[(edge + 1, y)], 0.5);
    let found = out[(edge, y)];
    assert!((0..3).all(|c| found[c].abs_diff(expected[c]) <= 4), "{found:?} {expected:?}");
    // hard edges on request
    let hard = CompositingParams { antialias: false, ..CompositingParams::default() };
    assert_eq!(case.compose(&hard), full);
}

#[test]
fn broken_light_and_pictures_stay_in_bounds() {
    let scaled = |factor: f32| {
        let coefficients = light().coefficients.iter().map(|c| c.map(|v| v * factor)).collect();
        ShLight { bands: 4, coefficients }
    };
    let lights = [
        ShLight { bands: 4, coefficients: vec![[0.0; 3]; 16] },
        scaled(-1.0),
        scaled(f32::NAN),
        scaled(f32::INFINITY),
        scaled(1e30),
        scaled(1e-30),
        ShLight { bands: 2, coefficients: vec![[0.3, 0.2, -0.9]; 4] },
        ShLight::default(),
    ];
    for step in [1, 4] {
        for bounce in [[0.0; 3], [f32::NAN, f32::INFINITY, -1.0]] {
            let mut case = ball(SIZE, step, shadow);
            case.set_bounce(bounce);
            for light in &lights {
                case.light = light.clone();
                for code in [0, 255] {
                    case.frame.color_srgb.fill([code; 3]);
                    for params in all_params() {
                        let mut stage = CompositingStage::new(&params);
                        let buffers = stage.shading_buffers(&case.input());
                        let all = buffers.real.as_slice().iter().chain(buffers.merged.as_slice());
                        assert!(all.flatten().all(|v| v.is_finite()), "{light:?} {params:?}");
                        let out = case.compose(&params);
                        // A black real pixel stays black: there is no albedo to light.
                        let real = case.pixels().filter(|&(x, y)| !case.is_virtual(x, y));
                        for (x, y) in real.filter(|_| code == 0) {
                            assert_eq!(out[(x, y)], [0; 3]);
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn virtual_pixels_never_show_the_camera() {
    let mut case = ball(SIZE, 1, shadow);
    let params = CompositingParams::default();
    let before = case.compose(&params);
    case.frame.color_srgb.fill([255, 0, 128]);
    let after = case.compose(&params);
    for (x, y) in case.pixels().filter(|&(x, y)| case.is_virtual(x, y)) {
        assert_eq!(before[(x, y)], after[(x, y)]);
    }
}

#[test]
fn coloured_light_keeps_its_channels_apart() {
    let mut case = ball(SIZE, 4, shadow);
    let tints = [1.0, 0.5, 0.25];
    let white = case.compose(&CompositingParams::default());
    for c in &mut case.light.coefficients {
        *c = std::array::from_fn(|k| c[k] * tints[k]);
    }
    let tinted = case.compose(&CompositingParams::default());
    for (x, y) in case.pixels() {
        for c in 0..3 {
            let expected = if case.is_virtual(x, y) {
                let linear = LINEAR_FROM_SRGB8[usize::from(white[(x, y)][c])];
                srgb8_from_linear(tints[c] * linear)
            } else {
                white[(x, y)][c] // ratios do not know the scale of the light
            };
            // The floor of R is that of the brightest channel; codes are rounded twice.
            assert!(tinted[(x, y)][c].abs_diff(expected) <= 2, "({x}, {y}) {c}");
        }
    }
}

#[test]
fn degenerate_sizes() {
    for size in [Size::new(0, 0), Size::new(1, 1), Size::new(1, 9), Size::new(5, 3)] {
        for step in [1, 4, 8] {
            let case = ball(size, step, shadow);
            for params in all_params() {
                assert_eq!(case.compose(&params).size(), size);
            }
        }
    }
}

#[test]
fn a_used_stage_gives_what_a_new_one_gives() {
    let cases = [ball(SIZE, 4, shadow), bare(SIZE, 4), ball(Size::new(40, 50), 1, shadow)];
    for params in all_params() {
        let mut stage = CompositingStage::new(&params);
        for case in cases.iter().chain(&cases[..2]) {
            let mut out = Image::default();
            stage.compose(&case.input(), &mut out);
            assert!(out == case.compose(&params));
        }
    }
}

#[test]
fn threads_do_not_change_a_bit() {
    let mut case = ball(Size::new(131, 97), 4, shadow);
    case.set_bounce([0.01, 0.02, 0.03]);
    for params in all_params() {
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| case.compose(&params))
        };
        assert!(run(1) == run(3));
    }
}

/// `cargo test --release --lib -- --ignored time_composition --nocapture`
#[test]
#[ignore = "a measurement"]
fn time_composition() {
    for step in [1, 4] {
        for bounce in [false, true] {
            let mut case = ball(Size::new(640, 480), step, shadow);
            if bounce {
                case.set_bounce([0.01; 3]);
            }
            let changed = case.compose(&CompositingParams::default());
            let same = changed.as_slice().iter().zip(case.frame.color_srgb.as_slice());
            let share = same.filter(|(a, b)| a != b).count() as f64 / 307_200.0;
            for params in all_params() {
                let mut stage = CompositingStage::new(&params);
                let mut out = Image::default();
                let mut times: Vec<_> = (0..30)
                    .map(|_| {
                        let start = std::time::Instant::now();
                        stage.compose(&case.input(), &mut out);
                        start.elapsed().as_secs_f64() * 1e3
                    })
                    .collect();
                times.sort_by(f64::total_cmp);
                println!(
                    "step {step}, {:?}, {:?}, {:.0} % of pixels change: median {:.2} ms, best {:.2} ms",
                    params.compositor,
                    params.upsampling,
                    100.0 * share,
                    times[15],
                    times[0]
                );
            }
        }
    }
}
