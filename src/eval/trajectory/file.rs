//! Camera paths in the TUM text format.

use super::TimedPose;
use crate::eval::EvalError;
use crate::math::pose_from_xyzw;
use std::path::Path;

/// Reads `timestamp tx ty tz qx qy qz qw` lines (camera to world, metres, seconds); `#` starts a
/// comment. The first line that is none of these is an error.
pub fn read_tum(path: &Path) -> Result<Vec<TimedPose>, EvalError> {
    let name = path.display().to_string();
    let text = std::fs::read_to_string(path)
        .map_err(|source| EvalError::Io { path: name.clone(), source })?;
    let mut poses = Vec::new();
    for (i, line) in text.lines().enumerate() {
        let line = line.split('#').next().unwrap_or_default().trim();
        if line.is_empty() {
            continue;
        }
        let pose = parse(line).ok_or_else(|| EvalError::Line {
            path: name.clone(),
            line: i + 1,
            problem: format!("not a pose (timestamp tx ty tz qx qy qz qw): {line:?}"),
        })?;
        poses.push(pose);
    }
    Ok(poses)
}

fn parse(line: &str) -> Option<TimedPose> {
    let numbers: Result<Vec<f64>, _> = line.split_whitespace().map(str::parse).collect();
    let &[timestamp_s, tx, ty, tz, qx, qy, qz, qw] = numbers.ok()?.as_slice() else { return None };
    let world_from_camera = pose_from_xyzw([tx, ty, tz], [qx, qy, qz, qw])?;
    timestamp_s.is_finite().then_some(TimedPose { timestamp_s, world_from_camera })
}
