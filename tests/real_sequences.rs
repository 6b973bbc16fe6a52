//! The first frames of real recordings, and of the demo as a Kinect would see it: how much of them is
//! tracked, and how far from the recorded path.

mod common;

use common::recording::demo_folder;
use common::{kinlight_json, real_sequence, text};
use serde_json::Value;
use std::path::Path;

/// Replays the first dozen frames with `ours-fast`; none may be skipped or badly tracked.
fn replay(sequence: &Path, extra: &[&str]) -> Value {
    let out = tempfile::tempdir().unwrap();
    let args = ["replay", text(sequence), "--preset", "ours-fast", "--frames", "0..12"];
    let args = [&args[..], &["--out", text(out.path())], extra].concat();
    let result = kinlight_json(&args);
    assert_eq!(result["skipped"], serde_json::json!([]), "{sequence:?}");
    assert_eq!(result["tracked_share"], 1.0, "{sequence:?}: {}", result["states"]);
    let light = std::fs::read_to_string(out.path().join("light.jsonl")).unwrap();
    let lights: Vec<Value> = light.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    assert_eq!(result["frames"], lights.len());
    let estimated = lights.iter().filter(|l| l["pixels"].as_u64().unwrap() > 1000).count();
    assert_eq!(estimated, lights.len(), "{sequence:?}: every frame tells of its light");
    result
}

/// RMS distance of the recorded and the estimated path after rigid alignment, millimetres.
fn error_mm(result: &Value) -> f64 {
    let error = &result["absolute_error"];
    assert_eq!(error["matched"], result["frames"], "every frame has a recorded pose");
    let rmse = 1e3 * error["translation_m"]["rmse"].as_f64().unwrap();
    eprintln!("ATE {rmse:.2} mm");
    rmse
}

#[test]
fn red_kitchen() {
    let Some(folder) = real_sequence("7scenes_redkitchen") else { return };
    let result = replay(&folder, &[]);
    assert_eq!(result["frames"], 12);
    // Measured 1.1 mm.
    assert!(error_mm(&result) < 2.0);
}

#[test]
fn freiburg1_rpy() {
    let Some(folder) = real_sequence("rgbd_dataset_freiburg1_rpy") else { return };
    let result = replay(&folder, &[]);
    assert_eq!(result["frames"], 12);
    // Measured 0.9 mm.
    assert!(error_mm(&result) < 2.0);
}

#[test]
fn hands_and_cup_under_a_standing_camera() {
    let Some(folder) = real_sequence("dynamic_hands_cup") else { return };
    let result = replay(&folder, &[]);
    assert_eq!(result["frames"], 12);
    assert_eq!(result["absolute_error"], Value::Null, "nobody recorded poses");
}

#[test]
fn five_frames_of_open3d() {
    let Some(folder) = real_sequence("open3d_rgbd") else { return };
    let result = replay(&folder, &[]);
    assert_eq!(result["frames"], 5);
    // Measured 0.4 mm.
    assert!(error_mm(&result) < 1.0);
}

#[test]
fn the_demo_as_a_kinect_sees_it() {
    let result = replay(&demo_folder(), &["--depth-list", "depth_kinect.txt"]);
    assert_eq!(result["frames"], 12);
    // Measured 0.05 mm, and 0.02 mm with exact depth.
    assert!(error_mm(&result) < 0.5);
}
