//! Lenses and places of cameras.

use super::boards::{Eye, chessboard, drawn, poses, save};
use super::common::{kinlight_json, real_sequence, text};
use kinlight::calibrate::board::{Board, Markers, project};
use kinlight::calibrate::corners::draw_charuco;
use kinlight::capture::Calibration;
use kinlight::capture::calibration::{CameraModel, Distortion};
use kinlight::image::{Image, Size};
use kinlight::math::Pose;
use nalgebra::{Point3, Translation3, UnitQuaternion};
use serde_json::Value;
use std::path::Path;

const SQUARE_M: f64 = 0.025;
const MIDDLE: [f64; 2] = [4.0 * SQUARE_M, 2.5 * SQUARE_M];

fn color_camera() -> CameraModel {
    let distortion = Distortion::Brown { k1: 0.08, k2: -0.15, p1: 1e-3, p2: -8e-4, k3: 0.02 };
    CameraModel { width: 640, height: 480, fx: 525.0, fy: 522.0, cx: 316.2, cy: 243.7, distortion }
}

fn infrared_camera() -> CameraModel {
    let distortion = Distortion::Brown { k1: -0.09, k2: 0.1, p1: 0.0, p2: 5e-4, k3: 0.0 };
    let (fx, fy, cx, cy) = (583.0, 585.0, 322.5, 238.1);
    CameraModel { fx, fy, cx, cy, distortion, ..color_camera() }
}

fn color_from_infrared() -> Pose {
    let turn = UnitQuaternion::from_euler_angles(0.006, -0.011, 0.004);
    Pose::from_parts(Translation3::new(-0.0247, 0.0006, -0.0021), turn)
}

/// Largest relative error of the focal lengths.
fn focal_error(found: &CameraModel, truth: &CameraModel) -> f64 {
    (found.fx / truth.fx - 1.0).abs().max((found.fy / truth.fy - 1.0).abs())
}

fn model(result: &Value, which: &str) -> CameraModel {
    let text = serde_json::to_string(&result["calibration"][which]).unwrap();
    serde_json::from_str(&text).unwrap()
}

fn refused(report: &Value) -> Vec<(String, String)> {
    let list = report["refused"].as_array().unwrap();
    let word = |v: &Value| v.as_str().unwrap().to_owned();
    list.iter().map(|r| (word(&r["view"]), word(&r["reason"]))).collect()
}

fn calibrate(out: &Path, args: &[&str]) -> Value {
    let common = ["calibrate", "camera", "--out", text(out)];
    kinlight_json(&[&common[..], args].concat())
}

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
    let focal = focal_error(&found.color, &color_camera());
    let focal_infrared = focal_error(&found.depth.unwrap(), &infrared_camera());
    let off = found.color_from_depth.unwrap().pose().unwrap().inverse() * color_from_infrared();
    let (shift_mm, turn) = (1e3 * off.translation.vector.norm(), off.rotation.angle().to_degrees());
    println!(
        "focal {:.3} % and {:.3} %, shift {shift_mm:.3} mm, turn {turn:.4} degrees, rms {} px",
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

/// Largest distance, in pixels, of where two cameras see the same points up to `reach` from the axis.
fn farthest_apart(a: &CameraModel, b: &CameraModel, reach: f64) -> f64 {
    let points = (0..40).flat_map(|i| (0..40).map(move |j| (i, j)));
    points
        .map(|(i, j)| (reach * (f64::from(i) / 19.5 - 1.0), reach * (f64::from(j) / 19.5 - 1.0)))
        .filter(|(x, y)| x.hypot(*y) < reach)
        .map(|(x, y)| {
            let [p, q] = [a, b].map(|c| project(c, &Point3::new(x, y, 1.0)).unwrap());
            (p[0] - q[0]).hypot(p[1] - q[1])
        })
        .fold(0.0, f64::max)
}

#[test]
fn a_fish_eye() {
    let folder = tempfile::tempdir().unwrap();
    let truth = CameraModel {
        fx: 240.0,
        fy: 239.0,
        distortion: Distortion::KannalaBrandt { k1: 0.03, k2: -0.012, k3: 4e-3, k4: -1e-3 },
        ..color_camera()
    };
    let eye = Eye::new(truth);
    let board = chessboard(9, 6, SQUARE_M);
    for (i, pose) in poses(14, MIDDLE, 0.2, 0.5, 0.5, 4).iter().enumerate() {
        let picture = eye.picture(pose, &board, 2.0, i as u32);
        save(&picture, &folder.path().join(format!("{i}.png")));
    }
    let out = folder.path().join("out/fish.toml");
    let result = calibrate(
        &out,
        &[
            "--color",
            text(folder.path()),
            "--board",
            "9x6",
            "--square",
            "25mm",
            "--model",
            "fisheye",
        ],
    );
    let found = Calibration::read(&out, None).unwrap().color;
    // 55 degrees
    let apart = farthest_apart(&found, &truth, 1.4);
    println!(
        "fish-eye: focal {:.3} %, at most {apart:.3} px apart, rms {} px over {} views",
        100.0 * focal_error(&found, &truth),
        result["color"]["rms_px"],
        result["color"]["views"].as_array().unwrap().len()
    );
    assert!(focal_error(&found, &truth) < 0.002 && apart < 0.5);
}

#[test]
fn a_charuco_board_that_is_seen_in_part() {
    let folder = tempfile::tempdir().unwrap();
    let markers = Some(Markers { side_m: 0.018, bits: 4, count: 50 });
    let board = Board { columns: 9, rows: 6, square_m: SQUARE_M, markers };
    let printed = draw_charuco(&board, 48).unwrap();
    let pattern = drawn(&printed, (10, 7), SQUARE_M);
    let eye = Eye::new(color_camera());
    let middle = [5.0 * SQUARE_M, 3.5 * SQUARE_M];
    for (i, pose) in poses(14, middle, 0.3, 0.5, 0.3, 6).iter().enumerate() {
        // Seen from its printed side: its y axis points up.
        let turned = Pose::from_parts(
            Translation3::new(0.0, 2.0 * middle[1], 0.0),
            UnitQuaternion::from_axis_angle(&nalgebra::Vector3::x_axis(), std::f64::consts::PI),
        );
        let picture = eye.picture(&(pose * turned), &pattern, 2.0, i as u32);
        save(&picture, &folder.path().join(format!("{i}.png")));
    }
    let out = folder.path().join("out/charuco.toml");
    let board = ["--board", "9x6", "--square", "25mm", "--markers", "18mm"];
    let args = [&["--color", text(folder.path())], &board[..]].concat();
    let result = calibrate(&out, &args);
    let found = Calibration::read(&out, None).unwrap().color;
    let focal = focal_error(&found, &color_camera());
    println!("ChArUco: focal {:.3} %, rms {} px", 100.0 * focal, result["color"]["rms_px"]);
    // Measured 0.22 %: the windows that find corners must not reach the markers, 6 pixels away.
    assert!(focal < 0.004);
}

#[test]
fn kinect_v1_boards_and_disparities_against_the_published_calibration() {
    let Some(folder) = real_sequence("kinect_v1_calibration") else { return };
    let out = tempfile::tempdir().unwrap();
    let toml = out.path().join("kinect.toml");
    let (color, disparity) = (folder.join("*-c1.jpg"), folder.join("*-d.pgm"));
    let pictures = ["--color", text(&color), "--disparity", text(&disparity)];
    let result =
        calibrate(&toml, &[&pictures[..], &["--board", "8x6", "--square", "40mm"]].concat());
    let found = Calibration::read(&toml, None).unwrap();
    let published = Calibration::read(&folder.join("small_set.yml"), None).unwrap();
    let percent = |a: &CameraModel, b: &CameraModel| 100.0 * focal_error(a, b);
    let (depth, true_depth) = (found.depth.unwrap(), published.depth.unwrap());
    let models = [&found, &published].map(|c| c.disparity.unwrap());
    // Over the boards' disparities.
    let of_depth = (500..950)
        .map(|d| models.map(|m| m.depth_m(f64::from(d))))
        .map(|[a, b]| (a / b - 1.0).abs())
        .fold(0.0, f64::max);
    let poses = [&found, &published].map(|c| c.color_from_depth.unwrap().pose().unwrap());
    let off = poses[0].inverse() * poses[1];
    println!(
        "Kinect: colour focal {:.2} %, depth focal {:.2} %, depth of a disparity {:.2} %, place {:.1} mm {:.2} degrees; \
         {} px, {} units",
        percent(&found.color, &published.color),
        percent(&depth, &true_depth),
        100.0 * of_depth,
        1e3 * off.translation.vector.norm(),
        off.rotation.angle().to_degrees(),
        result["color"]["rms_px"],
        result["depth"]["rms"],
    );
    assert!(percent(&found.color, &published.color) < 1.0);
    assert!(of_depth < 0.01);
    // Ten planes hold the depth camera's lens loosely: it must say how loosely.
    let deviation: [f64; 4] =
        serde_json::from_value(result["depth"]["deviation_px"].clone()).unwrap();
    println!("depth camera {depth:?} +- {deviation:?}");
    let off = [
        depth.fx - true_depth.fx,
        depth.fy - true_depth.fy,
        depth.cx - true_depth.cx,
        depth.cy - true_depth.cy,
    ];
    for (off, deviation) in off.iter().zip(deviation) {
        assert!(off.abs() < 3.0 * deviation && deviation < 20.0, "{off} {deviation}");
    }
}

#[test]
fn fish_eye_boards() {
    let Some(folder) = real_sequence("fisheye_calibration") else { return };
    let out = tempfile::tempdir().unwrap();
    let toml = out.path().join("fish.toml");
    let result = calibrate(
        &toml,
        &["--color", text(&folder), "--board", "6x8", "--square", "32.5mm", "--model", "fisheye"],
    );
    let rms = result["color"]["rms_px"].as_f64().unwrap();
    let views = result["color"]["views"].as_array().unwrap().len();
    println!(
        "fish-eye boards: {rms:.3} px over {views} views, refused {:?}",
        refused(&result["color"])
    );
    assert!(rms < 1.0 && views >= 12);
}
