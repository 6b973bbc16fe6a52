//! `light.jsonl`: the light of every frame.

use super::{LineWriter, OutputError};
use std::path::Path;

/// One line of the log. JSON has no infinity or NaN: such numbers become `null`.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct LightRecord {
    pub frame: usize,
    /// Seconds.
    pub timestamp: f64,
    pub bands: usize,
    /// Incident radiance times the scene's mean albedo; one list of `bands^2` coefficients for white
    /// light, or three for red, green and blue. World axes; order and signs as in
    /// [`crate::math::sh`].
    pub sh: Vec<Vec<f32>>,
    /// Unit, world axes, towards the light.
    pub dominant_direction: Option<[f32; 3]>,
    /// Condition number of the normal equations.
    pub condition: f64,
    /// RMS of intensity that the light leaves unexplained.
    pub residual: f64,
    /// Standard deviation of each coefficient.
    pub std: Vec<f64>,
    /// Pixels that the estimate rests on.
    pub pixels: usize,
}

/// A file with one [`LightRecord`] a line, valid after each.
#[derive(Debug)]
pub struct LightLog {
    lines: LineWriter,
}

impl LightLog {
    pub fn create(path: &Path) -> Result<Self, OutputError> {
        Ok(Self { lines: LineWriter::create(path)? })
    }

    pub fn push(&mut self, record: &LightRecord) -> Result<(), OutputError> {
        let line = serde_json::to_string(record)
            .map_err(|error| OutputError::content(self.lines.path(), error.to_string()))?;
        self.lines.push(&line)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    #[test]
    fn every_line_is_json_of_the_agreed_shape() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("light.jsonl");
        let mut log = LightLog::create(&path).unwrap();
        let record = LightRecord {
            frame: 3,
            timestamp: 0.125,
            bands: 1,
            sh: vec![vec![0.5], vec![0.25], vec![-1.0]],
            dominant_direction: Some([0.0, 0.0, 1.0]),
            condition: f64::INFINITY,
            residual: 0.01,
            std: vec![0.5],
            pixels: 1000,
        };
        log.push(&record).unwrap();
        log.push(&LightRecord { dominant_direction: None, ..record }).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let lines: Vec<Value> =
            text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        assert_eq!(lines.len(), 2);
        assert_eq!(
            lines[0],
            json!({"frame": 3, "timestamp": 0.125, "bands": 1, "sh": [[0.5], [0.25], [-1.0]],
                   "dominant_direction": [0.0, 0.0, 1.0], "condition": null, "residual": 0.01,
                   "std": [0.5], "pixels": 1000})
        );
        assert_eq!(lines[1]["dominant_direction"], Value::Null);
    }
}
