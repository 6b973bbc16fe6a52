use super::super::board::BoardView;
use super::*;
use crate::math::random::Rng;

const SIZE: Size = Size::new(640, 480);

fn truth() -> DVector<f64> {
    let mut p = nominal(SIZE);
    for (k, v) in
        [582.0, 588.0, 322.0, 236.0, 0.004, -0.012, 0.002, -0.0235, 0.004, -0.002, 3.121, -0.00286]
            .into_iter()
            .enumerate()
    {
        p[k] = v;
    }
    p
}

/// Boards at several slants and distances, each on a larger plate.
fn planes(count: usize) -> Vec<PosedView> {
    let mut rng = Rng::new(&[5]);
    let mut within = |reach: f64| reach * (2.0 * f64::from(rng.uniform()) - 1.0);
    (0..count)
        .map(|i| {
            let turn = UnitQuaternion::from_euler_angles(within(0.7), within(0.7), within(0.3));
            let z = 0.7 + 0.12 * i as f64;
            let place = Translation3::new(within(0.25) - 0.14, within(0.2) - 0.1, z);
            PosedView {
                view: BoardView { key: i.to_string(), corners: vec![] },
                camera_from_board: Pose::from_parts(place, turn),
            }
        })
        .collect()
}

/// What the true depth camera delivers: the plate, and a wall behind it.
fn picture(view: &PosedView, seed: u32) -> Image<u16> {
    let mut rng = Rng::new(&[seed]);
    let state = State::new(&truth(), view);
    let mut grown = Vec::new();
    let board_from_depth = view.camera_from_board.inverse() * state.depth_from_color.inverse();
    let [fx, fy, cx, cy] = state.camera;
    for (x, y) in (0..SIZE.pixels()).map(|i| ((i % SIZE.width) as f64, (i / SIZE.width) as f64)) {
        let d = state.predicted(x, y);
        let z = 1.0 / (state.disparity.c0 + state.disparity.c1 * d);
        let on_board = board_from_depth * Point3::new(z * (x - cx) / fx, z * (y - cy) / fy, z);
        let on_plate =
            z > 0.0 && (-0.08..0.36).contains(&on_board.x) && (-0.08..0.28).contains(&on_board.y);
        let exact = if on_plate { d } else { state.disparity.of_depth(4.0) };
        let noisy = (exact + 0.5 * f64::from(rng.normal())).round();
        grown.push(if rng.uniform() < 0.05 {
            NO_DISPARITY
        } else {
            noisy.clamp(0.0, 2046.0) as u16
        });
    }
    Image::from_vec(SIZE, grown)
}

const BOARD: Board = Board { columns: 8, rows: 6, square_m: 0.04, markers: None };

#[test]
fn the_depth_camera_is_found_from_noisy_planes() {
    let views = planes(14);
    let pictures: Vec<_> = views.iter().zip(0..).map(|(v, i)| picture(v, i)).collect();
    let pairs: Vec<_> = views
        .iter()
        .zip(&pictures)
        .map(|(colored, disparity)| DisparityView { colored, disparity })
        .collect();
    let found = find_depth_camera(&BOARD, &pairs).unwrap();
    let true_pose = color_from_depth(&truth());
    let off = found.color_from_depth.inverse() * true_pose;
    let focal = (found.depth.fx / 582.0 - 1.0).abs().max((found.depth.fy / 588.0 - 1.0).abs());
    let depth = (found.disparity.depth_m(700.0) / (1.0 / (3.121 - 0.00286 * 700.0)) - 1.0).abs();
    println!(
        "focal {:.3} %, centre {:.2} {:.2} px, turn {:.4} deg, shift {:.3} mm, depth {:.4} %, rms {:.3}",
        100.0 * focal,
        found.depth.cx - 322.0,
        found.depth.cy - 236.0,
        off.rotation.angle().to_degrees(),
        1e3 * off.translation.vector.norm(),
        100.0 * depth,
        found.rms,
    );
    // Noise of half a unit and rounding: sqrt(0.25 + 1/12) = 0.58.
    assert!((0.5..0.66).contains(&found.rms), "{}", found.rms);
    assert!(focal < 5e-3 && depth < 1e-3);
    assert!(
        found.deviation_px.iter().all(|d| (1e-3..15.0).contains(d)),
        "{:?}",
        found.deviation_px
    );
    assert!(off.rotation.angle().to_degrees() < 0.1);
    assert!(off.translation.vector.norm() < 2e-3);
}

#[test]
fn planes_that_all_face_the_camera_are_refused() {
    let facing: Vec<_> = (0..4)
        .map(|i| PosedView {
            view: BoardView { key: i.to_string(), corners: vec![] },
            camera_from_board: Pose::translation(-0.14, -0.1, 0.8 + 0.2 * f64::from(i)),
        })
        .collect();
    // Exactly: the true camera looks straight as well, and nothing is noisy but the rounding.
    let empty = Image::new(SIZE, NO_DISPARITY);
    let pairs: Vec<_> =
        facing.iter().map(|colored| DisparityView { colored, disparity: &empty }).collect();
    let none = find_depth_camera(&BOARD, &pairs).unwrap_err().to_string();
    assert!(none.contains("too few disparities"), "{none}");
    assert!(find_depth_camera(&BOARD, &[]).is_err());
    let state = |p: &DVector<f64>, v: &PosedView| State::new(p, v);
    let flat: Vec<_> = facing
        .iter()
        .map(|v| {
            let s = state(&nominal(SIZE), v);
            let at = |i: usize| s.predicted((i % 640) as f64, (i / 640) as f64).round() as u16;
            Image::from_vec(SIZE, (0..SIZE.pixels()).map(at).collect())
        })
        .collect();
    let pairs: Vec<_> = facing
        .iter()
        .zip(&flat)
        .map(|(colored, disparity)| DisparityView { colored, disparity })
        .collect();
    let refused = find_depth_camera(&BOARD, &pairs).unwrap_err().to_string();
    assert!(refused.contains("slants"), "{refused}");
}
