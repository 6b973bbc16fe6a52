//! Lenses and places of cameras, from ChArUco boards of which pictures show a part.

use super::boards::{Eye, drawn, poses, save};
use super::cameras::{
    SQUARE_M, calibrate, color_camera, color_from_infrared, infrared_camera, intrinsic_error,
    place_error,
};
use super::common::text;
use kinlight::calibrate::board::{Board, Markers};
use kinlight::calibrate::corners::{draw_charuco, find_board};
use kinlight::calibrate::intrinsics::{LensModel, find_camera};
use kinlight::calibrate::pictures::grey;
use kinlight::capture::Calibration;
use kinlight::capture::calibration::{CameraModel, Distortion};
use kinlight::image::Size;
use kinlight::math::Pose;
use nalgebra::{Translation3, UnitQuaternion, Vector3};

/// Markers are 3.5 mm from the edges: 6 pixels where the board is 0.3 m away, 4 where it is slanted.
fn board() -> Board {
    let markers = Some(Markers { side_m: 0.018, bits: 4, count: 50 });
    Board { columns: 9, rows: 6, square_m: SQUARE_M, markers }
}

/// Places of the printed side, whose y axis points up, and of which a part is outside the picture.
fn places(count: usize, seed: u32) -> Vec<Pose> {
    let middle = [5.0 * SQUARE_M, 3.5 * SQUARE_M];
    let turned = Pose::from_parts(
        Translation3::new(0.0, 2.0 * middle[1], 0.0),
        UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI),
    );
    poses(count, middle, 0.3, 0.5, 0.3, seed).iter().map(|pose| pose * turned).collect()
}

#[test]
fn a_colour_and_an_infrared_camera() {
    let folder = tempfile::tempdir().unwrap();
    let printed = draw_charuco(&board(), 48).unwrap();
    let pattern = drawn(&printed, (10, 7), SQUARE_M);
    let eyes = [Eye::new(color_camera()), Eye::new(infrared_camera())];
    for (i, pose) in places(14, 6).iter().enumerate() {
        let poses = [*pose, color_from_infrared().inverse() * pose];
        for (which, (eye, pose)) in ["c", "i"].iter().zip(eyes.iter().zip(poses)) {
            let seed = 2 * i as u32 + u32::from(*which == "i");
            let picture = eye.picture(&pose, &pattern, 2.0, seed);
            save(&picture, &folder.path().join(format!("{i}-{which}.png")));
        }
    }
    let out = folder.path().join("out/charuco.toml");
    let [color, infrared] = ["c", "i"].map(|which| folder.path().join(format!("*-{which}.png")));
    let pictures = ["--color", text(&color), "--infrared", text(&infrared)];
    let board = ["--board", "9x6", "--square", "25mm", "--markers", "18mm"];
    let result = calibrate(&out, &[&pictures[..], &board[..]].concat());
    let found = Calibration::read(&out, None).unwrap();
    let errors = [
        intrinsic_error(&found.color, &color_camera()),
        intrinsic_error(&found.depth.unwrap(), &infrared_camera()),
    ];
    let (shift_mm, turn) = place_error(&found, &color_from_infrared());
    println!(
        "ChArUco: intrinsics {:.3} % and {:.3} %, shift {shift_mm:.3} mm, turn {turn:.4} degrees, rms {} px",
        100.0 * errors[0],
        100.0 * errors[1],
        result["color"]["rms_px"]
    );
    assert!(errors.iter().all(|&e| e < 0.002), "{errors:?}");
    assert!(shift_mm < 1.0 && turn < 0.1, "{shift_mm} {turn}");
}

/// Noise of 2 codes leaves a corner within hundredths of a pixel and the focal length of 14 views within some
/// 0.03 % (`deviation_px`): 0.2 % leaves room for six of these, none for markers that pull at corners.
#[test]
fn several_lenses_and_noises() {
    let board = board();
    let printed = draw_charuco(&board, 48).unwrap();
    let pattern = drawn(&printed, (10, 7), SQUARE_M);
    let barrel = Distortion::Brown { k1: -0.25, k2: 0.09, p1: -5e-4, p2: 7e-4, k3: -0.02 };
    let lenses = [
        (color_camera(), LensModel::Brown),
        (
            CameraModel { fx: 420.0, fy: 421.0, distortion: barrel, ..color_camera() },
            LensModel::Brown,
        ),
        (CameraModel { distortion: Distortion::None, ..infrared_camera() }, LensModel::Ideal),
    ];
    let mut worst = 0f64;
    for (lens, (truth, model)) in lenses.into_iter().enumerate() {
        let eye = Eye::new(truth);
        for seed in [6, 7, 8] {
            let view = |(i, pose): (usize, &Pose)| {
                let picture = eye.picture(pose, &pattern, 2.0, 100 * seed + i as u32);
                find_board(&i.to_string(), &grey(&picture), &board).unwrap().ok()
            };
            let views: Vec<_> = places(14, seed).iter().enumerate().filter_map(view).collect();
            let size = Size::new(truth.width, truth.height);
            let found = find_camera(&board, &views, size, model).unwrap();
            let error = intrinsic_error(&found.camera, &truth);
            worst = worst.max(error);
            println!(
                "lens {lens} seed {seed}: {:.3} %, {} views, rms {:.3} px, +- {:.2?} px",
                100.0 * error,
                found.views.len(),
                found.rms_px,
                found.deviation_px
            );
        }
    }
    println!("ChArUco, worst of nine: {:.3} %", 100.0 * worst);
    assert!(worst < 0.002, "{worst}");
}
