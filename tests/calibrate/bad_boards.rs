//! Pictures that cannot be calibrated from, and what users are told of them.

use super::boards::{Eye, chessboard, poses, save};
use super::cameras::{MIDDLE, SQUARE_M, calibrate, color_camera, refused};
use super::common::{kinlight, text};
use kinlight::capture::calibration::CameraModel;
use kinlight::math::Pose;
use nalgebra::{Translation3, UnitQuaternion};
use std::path::Path;

fn small_eye() -> Eye {
    let truth = color_camera();
    let half = |v: f64| 0.5 * (v + 0.5) - 0.5;
    Eye::new(CameraModel {
        width: 320,
        height: 240,
        fx: 0.5 * truth.fx,
        fy: 0.5 * truth.fy,
        cx: half(truth.cx),
        cy: half(truth.cy),
        ..truth
    })
}

/// Pictures of a board of so many inner corners, called 0, 1, ...
fn pictures(folder: &Path, (columns, rows): (usize, usize), places: &[Pose]) {
    let (eye, board) = (small_eye(), chessboard(columns, rows, SQUARE_M));
    for (i, pose) in places.iter().enumerate() {
        save(&eye.picture(pose, &board, 0.5, i as u32), &folder.join(format!("{i}.png")));
    }
}

const BOARD: [&str; 4] = ["--board", "9x6", "--square", "25mm"];

/// What the program says as it refuses.
fn refusal(folder: &Path) -> String {
    let out = folder.join("out.toml");
    let args = ["calibrate", "camera", "--out", text(&out), "--color", text(folder)];
    let run = kinlight(&[&args[..], &BOARD[..]].concat());
    let said = String::from_utf8_lossy(&run.stderr).into_owned();
    assert_eq!(run.status.code(), Some(3), "{said}");
    assert!(!out.exists());
    said
}

#[test]
fn a_board_of_another_size_is_named() {
    let folder = tempfile::tempdir().unwrap();
    pictures(folder.path(), (8, 5), &poses(3, [3.5 * SQUARE_M, 2.0 * SQUARE_M], 0.3, 0.3, 0.0, 2));
    let said = refusal(folder.path());
    assert!(said.contains("0 usable views") && said.contains("1 (no board of 9x6"), "{said}");
    assert!(said.contains("0 shows a board of 8x5 inner corners: count"), "{said}");
}

#[test]
fn copies_of_a_picture_count_once() {
    let folder = tempfile::tempdir().unwrap();
    pictures(folder.path(), (9, 6), &poses(1, MIDDLE, 0.42, 0.3, 0.0, 2));
    for copy in 1..6 {
        let name = |i: u32| folder.path().join(format!("{i}.png"));
        std::fs::copy(name(0), name(copy)).unwrap();
    }
    let said = refusal(folder.path());
    assert!(
        said.contains("1 usable views") && said.contains("3 (the same picture as 0)"),
        "{said}"
    );
}

#[test]
fn boards_that_stand_parallel_do_not_give_the_focal_length() {
    let folder = tempfile::tempdir().unwrap();
    pictures(folder.path(), (9, 6), &poses(6, MIDDLE, 0.42, 0.0, 0.1, 2));
    let said = refusal(folder.path());
    assert!(said.contains("do not determine the focal length"), "{said}");
    assert!(said.contains("degrees of parallel") && said.contains("Tilt"), "{said}");
}

#[test]
fn boards_in_one_corner_and_a_picture_of_another_size() {
    let folder = tempfile::tempdir().unwrap();
    let places: Vec<Pose> = poses(9, MIDDLE, 0.0, 0.7, 0.0, 5)
        .iter()
        .map(|pose| {
            let turn = pose.rotation;
            let middle = turn * nalgebra::Vector3::new(MIDDLE[0], MIDDLE[1], 0.0);
            let to = nalgebra::Vector3::new(-0.2, -0.14, 0.6);
            Pose::from_parts(Translation3::from(to - middle), turn)
        })
        .collect();
    pictures(folder.path(), (9, 6), &places);
    // The odd one comes first by its name.
    let large = Eye::new(color_camera());
    let facing = Pose::from_parts(Translation3::new(-0.1, -0.06, 0.4), UnitQuaternion::identity());
    let board = chessboard(9, 6, SQUARE_M);
    save(&large.picture(&facing, &board, 0.5, 9), &folder.path().join("-.png"));
    let out = folder.path().join("made/out.toml");
    let result = calibrate(&out, &[&["--color", text(folder.path())], &BOARD[..]].concat());
    let all = refused(&result["color"]);
    let odd = all.iter().find(|r| r.0 == "-").expect("refused");
    assert!(odd.1.contains("640x480 pixels, most have 320x240"), "{all:?}");
    let warning = result["color"]["coverage_warning"].as_str().expect("a warning");
    assert!(warning.contains("quarters upper right, lower left, lower right"), "{warning}");
}
