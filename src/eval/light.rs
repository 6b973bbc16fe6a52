//! Light error, and the true light of a made sequence.

use super::EvalError;
use crate::lighting::{LightEstimate, ShLight};
use crate::math::sh;
use glam::Vec3;
use std::path::Path;

/// Angle between two directions of any length, in degrees; `None` where one is zero or not
/// finite.
pub fn angle_deg(a: Vec3, b: Vec3) -> Option<f64> {
    let (a, b) = (a.as_dvec3().try_normalize()?, b.as_dvec3().try_normalize()?);
    // exact for tiny angles too, where the arc cosine has lost its digits
    Some(a.cross(b).length().atan2(a.dot(b)).to_degrees())
}

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct LightError {
    /// Between the dominant directions; none where one of them is undefined.
    pub angle_deg: Option<f64>,
    /// Of the SH coefficients, after the best common scale.
    pub relative_l2: f64,
    /// That scale: light and albedo cannot be told apart from a picture.
    pub scale: f64,
}

/// The scale s >= 0 that minimises |s estimate - truth|, and that minimum relative to |truth|.
///
/// Coefficients that one of the two lacks are zero. An estimate that points away from the truth gets
/// s = 0 and so an error of 1. `None` where the truth is zero or a value is not finite.
pub fn scaled_relative_l2(estimate: &[f64], truth: &[f64]) -> Option<(f64, f64)> {
    let norm2 = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>();
    let (estimate2, truth2) = (norm2(estimate), norm2(truth));
    if !(truth2 > 0.0 && truth2.is_finite() && estimate2.is_finite()) {
        return None;
    }
    let dot: f64 = estimate.iter().zip(truth).map(|(e, t)| e * t).sum();
    let scale = if estimate2 > 0.0 { (dot / estimate2).max(0.0) } else { 0.0 };
    let longest = estimate.len().max(truth.len());
    let at = |v: &[f64], i: usize| v.get(i).copied().unwrap_or(0.0);
    let error2: f64 = (0..longest).map(|i| (scale * at(estimate, i) - at(truth, i)).powi(2)).sum();
    Some((scale, (error2 / truth2).sqrt()))
}

/// The true light of a sequence, as stored in its `light.json`.
#[derive(Clone, Debug, serde::Deserialize)]
pub struct LightTruth {
    #[serde(default)]
    pub sequence: String,
    /// World point that the light is given for; none where it is far enough to be the same everywhere.
    pub center: Option<[f64; 3]>,
    pub segments: Vec<LightSegment>,
}

/// The light of the frames `first_frame..=last_frame`. Directions are in world axes, towards the light.
#[derive(Clone, Debug, serde::Deserialize)]
pub struct LightSegment {
    pub first_frame: usize,
    pub last_frame: usize,
    pub dominant_direction: [f64; 3],
    /// White light from the emitters alone; order and signs as in [`crate::math::sh`].
    pub sh: Vec<f64>,
    /// What arrives in the middle of the scene, light that the scene scatters included.
    pub sh_probe: Option<Vec<f64>>,
    pub dominant_direction_probe: Option<[f64; 3]>,
}

impl LightTruth {
    pub fn read(path: &Path) -> Result<Self, EvalError> {
        let name = path.display().to_string();
        let text = crate::files::read_text(path)
            .map_err(|source| EvalError::Io { path: name.clone(), source })?;
        let truth: Self = serde_json::from_str(&text)
            .map_err(|e| EvalError::File { path: name.clone(), problem: e.to_string() })?;
        truth.check().map_err(|problem| EvalError::File { path: name, problem })?;
        Ok(truth)
    }

    /// The light of a frame; `None` where the file says nothing about it.
    pub fn at_frame(&self, frame: usize) -> Option<&LightSegment> {
        self.segments.iter().find(|s| (s.first_frame..=s.last_frame).contains(&frame))
    }

    /// Error of the light of a frame, at the point that the truth is given for; `None` where the file says
    /// nothing about the frame. The estimate must be in the sequence's world.
    pub fn error_of(&self, frame: usize, estimate: &LightEstimate) -> Option<LightError> {
        let light = match self.center {
            Some(center) => estimate.field.at(Some(glam::DVec3::from(center).as_vec3())),
            None => estimate.light.clone(),
        };
        self.at_frame(frame)?.error_of(&light)
    }

    fn check(&self) -> Result<(), String> {
        if self.segments.is_empty() {
            return Err("no segments".into());
        }
        for (i, segment) in self.segments.iter().enumerate() {
            segment.check().map_err(|problem| format!("segment {i}: {problem}"))?;
        }
        let mut order: Vec<usize> = (0..self.segments.len()).collect();
        order.sort_by_key(|&i| self.segments[i].first_frame);
        let overlap = |pair: &&[usize]| {
            self.segments[pair[0]].last_frame >= self.segments[pair[1]].first_frame
        };
        match order.windows(2).find(overlap) {
            Some(pair) => Err(format!(
                "segments {} and {} overlap",
                pair[0].min(pair[1]),
                pair[0].max(pair[1])
            )),
            None => Ok(()),
        }
    }
}

impl LightSegment {
    /// Error of an estimate against the light of the emitters.
    pub fn error_of(&self, light: &ShLight) -> Option<LightError> {
        let estimate: Vec<f64> = light.luminance().into_iter().map(f64::from).collect();
        let (scale, relative_l2) = scaled_relative_l2(&estimate, &self.sh)?;
        let [x, y, z] = self.dominant_direction.map(|v| v as f32);
        let angle_deg =
            light.dominant_direction().and_then(|found| angle_deg(found, Vec3::new(x, y, z)));
        Some(LightError { angle_deg, relative_l2, scale })
    }

    fn check(&self) -> Result<(), String> {
        if self.first_frame > self.last_frame {
            return Err(format!("frames {} to {}", self.first_frame, self.last_frame));
        }
        for sh in [Some(&self.sh), self.sh_probe.as_ref()].into_iter().flatten() {
            if !(1..=sh::MAX_BANDS).any(|bands| sh::coefficients(bands) == sh.len()) {
                let n = sh.len();
                return Err(format!("{n} SH coefficients are no whole number of bands, 1 to 6"));
            }
            if sh.iter().any(|c| !c.is_finite()) {
                return Err("a coefficient is not finite".into());
            }
        }
        let directions = [Some(self.dominant_direction), self.dominant_direction_probe];
        for [x, y, z] in directions.into_iter().flatten() {
            let length = (x * x + y * y + z * z).sqrt();
            if !(length - 1.0).abs().is_finite() || (length - 1.0).abs() > 1e-3 {
                return Err(format!("a direction has length {length}, not 1"));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_of_known_directions() {
        assert_eq!(angle_deg(Vec3::X, Vec3::X), Some(0.0));
        assert_eq!(angle_deg(Vec3::X, -2.0 * Vec3::X), Some(180.0));
        assert!((angle_deg(Vec3::X, Vec3::new(0.0, 5.0, 0.0)).unwrap() - 90.0).abs() < 1e-12);
        // 1e-4 rad is far below what the arc cosine of an f32 dot product can show
        let tiny = angle_deg(Vec3::Z, Vec3::new(1e-4, 0.0, 1.0)).unwrap();
        assert!((tiny - 1e-4f64.atan().to_degrees()).abs() < 1e-9, "{tiny}");
        assert_eq!(angle_deg(Vec3::X, Vec3::ZERO), None);
        assert_eq!(angle_deg(Vec3::X, Vec3::splat(f32::NAN)), None);
    }

    #[test]
    fn scale_does_not_count_and_shape_does() {
        let truth = [2.0, 1.0, -1.0, 0.5];
        let (scale, error) = scaled_relative_l2(&truth.map(|v| 0.1 * v), &truth).unwrap();
        assert!((scale - 10.0).abs() < 1e-12 && error < 1e-14);
        // a part orthogonal to the truth of the same length: the best scale halves it
        let (scale, error) = scaled_relative_l2(&[1.0, 1.0], &[1.0, 0.0]).unwrap();
        assert!((scale - 0.5).abs() < 1e-15 && (error - 0.5f64.sqrt()).abs() < 1e-15);
        // opposite, zero, missing bands
        assert_eq!(scaled_relative_l2(&[-1.0], &[1.0]), Some((0.0, 1.0)));
        assert_eq!(scaled_relative_l2(&[0.0], &[1.0]), Some((0.0, 1.0)));
        let (_, error) = scaled_relative_l2(&[3.0], &[3.0, 0.0, 4.0, 0.0]).unwrap();
        assert!((error - 0.8).abs() < 1e-15);
        assert_eq!(scaled_relative_l2(&[1.0], &[0.0]), None);
        assert_eq!(scaled_relative_l2(&[f64::NAN], &[1.0]), None);
    }

    fn read(text: &str) -> Result<LightTruth, EvalError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("light.json");
        std::fs::write(&path, text).unwrap();
        LightTruth::read(&path)
    }

    fn segment(first: usize, last: usize, sh: &str, direction: &str) -> String {
        format!(
            r#"{{"first_frame":{first},"last_frame":{last},"lights":{{}},"sh":{sh},"dominant_direction":{direction}}}"#
        )
    }

    #[test]
    fn segments_hold_for_their_frames() {
        let a = segment(0, 9, "[1,0,0,1]", "[1,0,0]");
        let b = segment(10, 19, "[1,0,1,0]", "[0,0,1]");
        let truth = read(&format!(r#"{{"sequence":"s","segments":[{a},{b}]}}"#)).unwrap();
        assert_eq!(truth.at_frame(9).unwrap().dominant_direction, [1.0, 0.0, 0.0]);
        assert_eq!(truth.at_frame(10).unwrap().sh, [1.0, 0.0, 1.0, 0.0]);
        assert!(truth.at_frame(20).is_none());

        let light = ShLight { bands: 2, coefficients: [2.0, 0.0, 0.0, 2.0].map(|c| [c; 3]).into() };
        let error = truth.at_frame(0).unwrap().error_of(&light).unwrap();
        // the luminance weights add up to 1 within f32 rounding
        assert!(error.angle_deg.unwrap() < 1e-5 && error.relative_l2 < 1e-6, "{error:?}");
        assert!((error.scale - 0.5).abs() < 1e-6);
        let turned = truth.at_frame(15).unwrap().error_of(&light).unwrap();
        assert!((turned.angle_deg.unwrap() - 90.0).abs() < 1e-5, "{turned:?}");
    }

    #[test]
    fn broken_files_say_what_is_wrong() {
        let good = segment(0, 9, "[1]", "[1,0,0]");
        for (segments, expected) in [
            (String::new(), "no segments"),
            (segment(5, 4, "[1]", "[1,0,0]"), "segment 0: frames 5 to 4"),
            (segment(0, 4, "[1,2]", "[1,0,0]"), "2 SH coefficients"),
            (segment(0, 4, "[1]", "[1,1,0]"), "a direction has length 1.41"),
            (format!("{good},{good}"), "segments 0 and 1 overlap"),
            ("{}".into(), "missing field"),
        ] {
            let message = read(&format!(r#"{{"segments":[{segments}]}}"#)).unwrap_err().to_string();
            assert!(message.contains("light.json") && message.contains(expected), "{message}");
        }
        assert!(LightTruth::read(Path::new("/nowhere/light.json")).is_err());
    }

    #[test]
    fn truth_of_the_made_sequence_agrees_with_itself() {
        let Some(path) = crate::test_data::real_data("mitsuba-sample/light.json") else { return };
        let truth = LightTruth::read(&path).unwrap();
        let segment = truth.at_frame(29).unwrap();
        assert_eq!(segment.sh.len(), 16);
        assert!(truth.at_frame(30).is_none());
        // an area light and white ambient light: band 1 points at the light up to its extent
        let coefficients = segment.sh.iter().map(|&c| [c as f32; 3]).collect();
        let error = segment.error_of(&ShLight { bands: 4, coefficients }).unwrap();
        assert!(error.angle_deg.unwrap() < 1.0 && error.relative_l2 < 1e-6, "{error:?}");
    }
}
