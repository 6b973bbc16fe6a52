//! `trajectory.txt`: the camera's path in the TUM format.

use super::{LineWriter, OutputError};
use crate::math::Pose;
use std::path::Path;

/// Writes `timestamp tx ty tz qx qy qz qw` lines, camera to world, seconds and metres. A frame
/// without a trusted pose has no line.
#[derive(Debug)]
pub struct TrajectoryWriter {
    lines: LineWriter,
}

impl TrajectoryWriter {
    pub fn create(path: &Path) -> Result<Self, OutputError> {
        let mut lines = LineWriter::create(path)?;
        lines.push("# timestamp tx ty tz qx qy qz qw (camera to world, seconds, metres)")?;
        Ok(Self { lines })
    }

    pub fn push(&mut self, timestamp_s: f64, world_from_camera: &Pose) -> Result<(), OutputError> {
        let t = world_from_camera.translation.vector;
        let q = world_from_camera.rotation.coords;
        let q = if q.w < 0.0 { -q } else { q }; // the same rotation, told one way only
        if ![timestamp_s, t.x, t.y, t.z, q.x, q.y, q.z, q.w].iter().all(|v| v.is_finite()) {
            let problem = format!("the pose at {timestamp_s} s is not finite");
            return Err(OutputError::content(self.lines.path(), problem));
        }
        self.lines.push(&format!(
            "{timestamp_s:.6} {:.9} {:.9} {:.9} {:.9} {:.9} {:.9} {:.9}",
            t.x, t.y, t.z, q.x, q.y, q.z, q.w
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::trajectory::{Trajectory, read_tum};
    use crate::math::pose_from_xyzw;

    fn read(path: &Path) -> Trajectory {
        let mut warnings = Vec::new();
        let track = read_tum(path, &mut warnings).unwrap();
        assert!(warnings.is_empty(), "{warnings:?}");
        track
    }

    #[test]
    fn paths_come_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trajectory.txt");
        let mut writer = TrajectoryWriter::create(&path).unwrap();
        let poses = [
            pose_from_xyzw([1.25, -2.5, 0.001], [0.1, 0.2, 0.3, -0.9]).unwrap(),
            pose_from_xyzw([0.0, 12.0, -7.0], [0.0, 0.0, 1.0, 0.0]).unwrap(),
        ];
        for (i, pose) in poses.iter().enumerate() {
            writer.push(1_305_031_102.175_304 + i as f64, pose).unwrap();
            assert_eq!(read(&path).len(), i + 1, "readable after every line");
        }
        let track = read(&path);
        for (pose, time) in poses.iter().zip(["1305031102.175304", "1305031103.175304"]) {
            let back = track.at(time.parse().unwrap(), 0.0).expect("a pose at this very time");
            let apart = pose.inv_mul(&back);
            // half a unit of the last printed digit, of every number
            assert!(apart.translation.vector.norm() < 1e-9 && apart.rotation.angle() < 4e-9);
        }
        let line = std::fs::read_to_string(&path).unwrap().lines().nth(1).unwrap().to_owned();
        assert!(line.starts_with("1305031102.175304 1.250000000 -2.500000000 0.001000000 -0."));

        let broken = Pose::translation(f64::NAN, 0.0, 0.0);
        assert!(writer.push(0.0, &broken).unwrap_err().to_string().contains("not finite"));
        assert_eq!(read(&path).len(), 2);
    }
}
