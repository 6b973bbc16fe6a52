//! Pictures of real boards.

use super::cameras::{calibrate, focal_error, refused};
use super::common::{real_sequence, text};
use kinlight::capture::Calibration;
use kinlight::capture::calibration::CameraModel;

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
