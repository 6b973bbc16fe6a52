//! Real recordings: skipped, visibly, where they are not there. The numbers were measured on the raw
//! files by an independent program: back-project, move by the recorded poses, compare depth.

use super::plausibility::residual;
use super::*;
use crate::test_data::real_data as data;

/// Median over frame pairs `gap` apart of the median reprojection error, millimetres.
fn reprojection_mm(sequence: &mut Sequence, gap: usize) -> f64 {
    let camera = sequence.camera();
    let mut found: Vec<f64> = (0..sequence.pairs() - gap)
        .step_by(9)
        .filter_map(|i| {
            let (a, b) = (sequence.frame(i).ok()?, sequence.frame(i + gap).ok()?);
            let b_from_a = b.world_from_camera?.inverse() * a.world_from_camera?;
            Some(1e3 * residual(&camera, &a.depth_m, &b.depth_m, &b_from_a, 1.0)?.median_m)
        })
        .collect();
    found.sort_by(f64::total_cmp);
    found[found.len() / 2]
}

/// Every 9th pair and every 16th pixel, so the median of medians is good to about 10 %.
fn about(found: f64, expected: f64) {
    assert!((found / expected - 1.0).abs() < 0.15, "{found:.2} mm, {expected} mm expected");
}

#[test]
fn kitchen_depth_agrees_with_its_poses_raw_and_registered() {
    let Some(folder) = data("7scenes_redkitchen") else { return };
    // As recorded: the depth camera alone, taken for the camera of the frames.
    let raw = tempfile::Builder::new().suffix(".toml").tempfile().unwrap();
    let mut depth_only = calibration::built_in(calibration::SEVEN_SCENES).unwrap();
    depth_only.color = depth_only.depth.unwrap();
    (depth_only.registered, depth_only.color_from_depth) = (true, None);
    depth_only.poses_of = calibration::PoseOwner::Color;
    std::fs::write(raw.path(), depth_only.to_toml().unwrap()).unwrap();
    let options = CaptureOptions { calibration: Some(raw.path().into()), ..Default::default() };
    let mut raw = open_sequence(&folder, &options).unwrap();
    about(reprojection_mm(&mut raw, 5), 5.2);
    about(reprojection_mm(&mut raw, 15), 8.1);

    // Registration moves the same surfaces into the colour camera: no worse.
    let mut registered = open_sequence(&folder, &CaptureOptions::default()).unwrap();
    let info = registered.info();
    assert_eq!((info.pairs, info.frames_with_pose, info.registered), (240, 240, false));
    about(reprojection_mm(&mut registered, 15), 8.1);
}

#[test]
fn freiburg_depth_agrees_with_motion_capture() {
    let Some(folder) = data("rgbd_dataset_freiburg1_rpy") else { return };
    let mut sequence = open_sequence(&folder, &CaptureOptions::default()).unwrap();
    let info = sequence.info();
    assert_eq!((info.pairs, info.frames_with_pose, info.undistorted), (80, 80, true));
    // 3.9, 6.9 and 14.5 mm were measured without undistortion; with it the fit must be better.
    for (gap, distorted) in [(1, 3.9), (5, 6.9), (10, 14.5)] {
        let found = reprojection_mm(&mut sequence, gap);
        assert!(found < 0.95 * distorted && found > 0.4 * distorted, "{gap}: {found}");
    }
}

#[test]
fn redwood_frames_agree_with_their_log() {
    let Some(folder) = data("open3d_rgbd") else { return };
    let mut sequence = open_sequence(&folder, &CaptureOptions::default()).unwrap();
    about(reprojection_mm(&mut sequence, 1), 5.1);
    about(reprojection_mm(&mut sequence, 4), 5.4);
}

#[test]
fn nothing_is_found_wrong_with_good_recordings() {
    for (name, depth_list) in [
        ("7scenes_redkitchen", None),
        ("rgbd_dataset_freiburg1_rpy", None),
        ("dynamic_hands_cup", None),
        ("open3d_rgbd", None),
        ("mitsuba-sample", None),
        ("mitsuba-sample", Some("depth_kinect.txt".to_owned())),
    ] {
        let Some(folder) = data(name) else { continue };
        let options = CaptureOptions { depth_list, ..Default::default() };
        let report = inspect(&folder, &options).unwrap();
        assert!(report.findings.is_empty() && report.skipped.is_empty(), "{report}");
        let wrong = if report.info.depth_factor == 5000.0 { 1000.0 } else { 5000.0 };
        let options = CaptureOptions { depth_factor: Some(wrong), ..options };
        let report = inspect(&folder, &options).unwrap();
        let right = if wrong == 1000.0 { "5000" } else { "1000" };
        let named = report.findings.iter().any(|f| f.contains(&format!("factor {right}")));
        assert!(named, "{report}");
    }
}

#[test]
fn published_calibrations_are_read() {
    let Some(folder) = data("kinect_v1_calibration") else { return };
    let read = Calibration::read(&folder.join("small_set.yml"), None).unwrap();
    let pose = read.color_from_depth.unwrap().pose().unwrap();
    assert_eq!((read.color.size().width, read.color.fy), (1280, 1053.029167));
    assert!((pose.translation.x + 0.023082).abs() < 1e-12);
    assert!((pose.rotation.to_rotation_matrix()[(2, 1)] - 0.013973).abs() < 1e-5);
}
