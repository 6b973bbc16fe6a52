//! Lenses and places of cameras, from chessboards.

use super::boards::{Eye, chessboard, poses, save};
use super::cameras::{
    MIDDLE, SQUARE_M, calibrate, color_camera, color_from_infrared, farthest_apart, fish_eye,
    infrared_camera, intrinsic_error, model, place_error, refused,
};
use super::common::text;
use kinlight::capture::Calibration;
use kinlight::capture::calibration::{CameraModel, Distortion};
use kinlight::image::{Image, Size};
use nalgebra::Translation3;

#[test]
fn a_colour_and_an_infrared_camera_and_what_does_not_fit() {
    let folder = tempfile::tempdir().unwrap();
    let (color, infrared) = (Eye::new(color_camera()), Eye::new(infrared_camera()));
    let board = chessboard(9, 6, SQUARE_M);
    let infrared_from_color = color_from_infrared().inverse();
    let at = |name: String| folder.path().join(name);
    for (i, pose) in poses(16, MIDDLE, 0.42, 0.6, 0.2, 9).iter().enumerate() {
        // Of one pair, the board was moved between the pictures.
        let moved =
            if i == 5 { Translation3::new(0.012, 0.0, 0.0) } else { Translation3::identity() };
        let seed = i as u32;
        save(&color.picture(pose, &board, 2.0, seed), &at(format!("{i:02}-c.png")));
        let pose = infrared_from_color * moved * pose;
        save(&infrared.picture(&pose, &board, 2.0, 100 + seed), &at(format!("{i:02}-i.png")));
    }
    // A board that was printed stretched, and an empty view.
    let stretched = |x: f64, y: f64| board(x / 1.06, y);
    let pose = &poses(1, MIDDLE, 0.42, 0.3, 0.0, 1)[0];
    save(&color.picture(pose, &stretched, 2.0, 77), &at("bad-c.png".into()));
    save(&Image::new(Size::new(640, 480), [90; 3]), &at("empty-c.png".into()));

    let out = folder.path().join("made.toml");
    let pattern = |which: &str| folder.path().join(format!("*-{which}.png"));
    let result = calibrate(
        &out,
        &[
            "--color",
            text(&pattern("c")),
            "--infrared",
            text(&pattern("i")),
            "--board",
            "9x6",
            "--square",
            "25mm",
        ],
    );
    let found = Calibration::read(&out, None).unwrap();
    assert!(!found.registered);
    assert_eq!(found.color, model(&result, "color"));
    let focal = intrinsic_error(&found.color, &color_camera());
    let focal_infrared = intrinsic_error(&found.depth.unwrap(), &infrared_camera());
    let (shift_mm, turn) = place_error(&found, &color_from_infrared());
    println!(
        "chessboard: intrinsics {:.3} % and {:.3} %, shift {shift_mm:.3} mm, turn {turn:.4} degrees, rms {} px",
        100.0 * focal,
        100.0 * focal_infrared,
        result["color"]["rms_px"]
    );
    assert!(focal < 0.002 && focal_infrared < 0.002);
    assert!(shift_mm < 1.0 && turn < 0.1);
    assert!(result["color"]["coverage"].as_f64().unwrap() > 0.5);
    let out_of_color = refused(&result["color"]);
    let reason = |key: &str| &out_of_color.iter().find(|r| r.0 == key).expect("refused").1;
    assert!(reason("empty").contains("no board") && reason("bad").contains("error"));
    assert_eq!(out_of_color.len(), 2, "{out_of_color:?}");
    let pairs = refused(&result["depth"]);
    assert_eq!(pairs.iter().map(|p| p.0.as_str()).collect::<Vec<_>>(), ["05"], "{pairs:?}");
    for which in ["color", "infrared"] {
        let picture = folder.path().join(format!("made-{which}.png"));
        let (w, h) = image::image_dimensions(picture).unwrap();
        assert_eq!((w, h), (640, 480));
    }
}

#[test]
fn two_fish_eyes() {
    let folder = tempfile::tempdir().unwrap();
    let truth = fish_eye();
    let other = CameraModel {
        fx: 255.0,
        fy: 256.0,
        cx: 323.0,
        cy: 236.5,
        distortion: Distortion::KannalaBrandt { k1: -0.02, k2: 0.008, k3: -2e-3, k4: 0.0 },
        ..truth
    };
    let eyes = [Eye::new(truth), Eye::new(other)];
    let board = chessboard(9, 6, SQUARE_M);
    for (i, pose) in poses(14, MIDDLE, 0.2, 0.5, 0.5, 4).iter().enumerate() {
        let poses = [*pose, color_from_infrared().inverse() * pose];
        for (which, (eye, pose)) in ["c", "i"].iter().zip(eyes.iter().zip(poses)) {
            let seed = 2 * i as u32 + u32::from(*which == "i");
            let picture = eye.picture(&pose, &board, 2.0, seed);
            save(&picture, &folder.path().join(format!("{i}-{which}.png")));
        }
    }
    let out = folder.path().join("out/fish.toml");
    let [color, infrared] = ["c", "i"].map(|which| folder.path().join(format!("*-{which}.png")));
    let pictures = ["--color", text(&color), "--infrared", text(&infrared)];
    let board = ["--board", "9x6", "--square", "25mm", "--model", "fisheye"];
    let result = calibrate(&out, &[&pictures[..], &board[..]].concat());
    let found = Calibration::read(&out, None).unwrap();
    let depth = found.depth.unwrap();
    // 55 degrees from the axis
    let apart = farthest_apart(&found.color, &truth, 1.4).max(farthest_apart(&depth, &other, 1.4));
    let errors = [intrinsic_error(&found.color, &truth), intrinsic_error(&depth, &other)];
    let (shift_mm, turn) = place_error(&found, &color_from_infrared());
    println!(
        "fish-eyes: intrinsics {:.3} % and {:.3} %, at most {apart:.3} px apart, shift {shift_mm:.3} mm, \
         turn {turn:.4} degrees, rms {} px over {} views, +- {}",
        100.0 * errors[0],
        100.0 * errors[1],
        result["color"]["rms_px"],
        result["color"]["views"].as_array().unwrap().len(),
        result["color"]["deviation_px"],
    );
    assert!(errors.iter().all(|&e| e < 0.002) && apart < 0.5, "{errors:?} {apart}");
    assert!(shift_mm < 1.0 && turn < 0.1, "{shift_mm} {turn}");
}
