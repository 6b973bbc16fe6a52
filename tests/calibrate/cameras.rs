//! Known cameras, and how far off what was measured of them is.

use crate::common::{kinlight_json, text};
use kinlight::calibrate::board::project;
use kinlight::capture::Calibration;
use kinlight::capture::calibration::{CameraModel, Distortion};
use kinlight::math::Pose;
use nalgebra::{Point3, Translation3, UnitQuaternion};
use serde_json::Value;
use std::path::Path;

pub const SQUARE_M: f64 = 0.025;
/// Of the inner corners of a 9x6 board.
pub const MIDDLE: [f64; 2] = [4.0 * SQUARE_M, 2.5 * SQUARE_M];

pub fn color_camera() -> CameraModel {
    let distortion = Distortion::Brown { k1: 0.08, k2: -0.15, p1: 1e-3, p2: -8e-4, k3: 0.02 };
    CameraModel { width: 640, height: 480, fx: 525.0, fy: 522.0, cx: 316.2, cy: 243.7, distortion }
}

pub fn infrared_camera() -> CameraModel {
    let distortion = Distortion::Brown { k1: -0.09, k2: 0.1, p1: 0.0, p2: 5e-4, k3: 0.0 };
    let (fx, fy, cx, cy) = (583.0, 585.0, 322.5, 238.1);
    CameraModel { fx, fy, cx, cy, distortion, ..color_camera() }
}

pub fn fish_eye() -> CameraModel {
    let distortion = Distortion::KannalaBrandt { k1: 0.03, k2: -0.012, k3: 4e-3, k4: -1e-3 };
    CameraModel { fx: 240.0, fy: 239.0, distortion, ..color_camera() }
}

pub fn color_from_infrared() -> Pose {
    let turn = UnitQuaternion::from_euler_angles(0.006, -0.011, 0.004);
    Pose::from_parts(Translation3::new(-0.0247, 0.0006, -0.0021), turn)
}

/// Largest relative error of the focal lengths.
pub fn focal_error(found: &CameraModel, truth: &CameraModel) -> f64 {
    (found.fx / truth.fx - 1.0).abs().max((found.fy / truth.fy - 1.0).abs())
}

/// Largest error of focal lengths and principal point as a share of the focal length.
pub fn intrinsic_error(found: &CameraModel, truth: &CameraModel) -> f64 {
    let x = (found.cx - truth.cx).abs() / truth.fx;
    let y = (found.cy - truth.cy).abs() / truth.fy;
    focal_error(found, truth).max(x).max(y)
}

/// Millimetres and degrees between where two cameras stand to each other, found and in truth.
pub fn place_error(found: &Calibration, truth: &Pose) -> (f64, f64) {
    let off = found.color_from_depth.unwrap().pose().unwrap().inverse() * truth;
    (1e3 * off.translation.vector.norm(), off.rotation.angle().to_degrees())
}

pub fn model(result: &Value, which: &str) -> CameraModel {
    let text = serde_json::to_string(&result["calibration"][which]).unwrap();
    serde_json::from_str(&text).unwrap()
}

/// Key and reason of each refused view.
pub fn refused(report: &Value) -> Vec<(String, String)> {
    let list = report["refused"].as_array().unwrap();
    let word = |v: &Value| v.as_str().unwrap().to_owned();
    list.iter().map(|r| (word(&r["view"]), word(&r["reason"]))).collect()
}

pub fn calibrate(out: &Path, args: &[&str]) -> Value {
    let common = ["calibrate", "camera", "--out", text(out)];
    kinlight_json(&[&common[..], args].concat())
}

/// Largest distance, in pixels, of where two cameras see the same points up to `reach` from the axis.
pub fn farthest_apart(a: &CameraModel, b: &CameraModel, reach: f64) -> f64 {
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
