//! What is known about the cameras of a recording.

use super::{CaptureError, calibration_files, text};
use crate::image::Size;
use crate::math::{Pinhole, Pose, pose_from_xyzw};
pub use disparity::Disparity;
pub use lens::Distortion;
pub use photometry::{Photometry, Response, Vignetting};
use serde::{Deserialize, Serialize};
use std::path::Path;

mod disparity;
mod lens;
mod photometry;

/// Colour camera, depth camera, and how the depth pictures are to be read. Stored as TOML.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    pub name: String,
    /// Where the numbers are from, and how far to trust them.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub notes: String,
    /// Depth pictures are taken, or were already warped, through the colour camera.
    pub registered: bool,
    /// Depth units per metre.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth_factor: Option<f64>,
    /// Stored depth values that mean "nothing measured".
    #[serde(default = "default_invalid_depth")]
    pub invalid_depth: Vec<u16>,
    /// The camera whose poses a recording with this calibration holds.
    #[serde(default)]
    pub poses_of: PoseOwner,
    pub color: CameraModel,
    /// Of an unregistered recording.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth: Option<CameraModel>,
    /// Of an unregistered recording: a point in depth camera axes moved into colour camera axes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub color_from_depth: Option<Rigid>,
    /// Where depth pictures hold disparities instead of distances.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub disparity: Option<Disparity>,
    /// How the colour camera turns light into codes; without it, codes are taken as sRGB.
    #[serde(default, skip_serializing_if = "Photometry::is_none")]
    pub photometry: Photometry,
}

/// Every stored value over it must be a finite number of metres.
pub(super) fn usable_depth_factor(factor: f64) -> bool {
    factor > 0.0 && (factor as f32).is_finite() && (f32::from(u16::MAX) / factor as f32).is_finite()
}

fn default_invalid_depth() -> Vec<u16> {
    vec![0, u16::MAX]
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PoseOwner {
    #[default]
    Color,
    Depth,
}

/// One camera as built: focal lengths and principal point in pixels, lens distortion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraModel {
    pub width: usize,
    pub height: usize,
    pub fx: f64,
    pub fy: f64,
    pub cx: f64,
    pub cy: f64,
    #[serde(default, skip_serializing_if = "Distortion::is_none")]
    pub distortion: Distortion,
}

/// A rigid transform as files hold it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rigid {
    pub translation_m: [f64; 3],
    pub rotation_xyzw: [f64; 4],
}

impl Rigid {
    pub fn from_pose(pose: &Pose) -> Self {
        let (t, q) = (pose.translation.vector, pose.rotation.coords);
        Self { translation_m: [t.x, t.y, t.z], rotation_xyzw: [q.x, q.y, q.z, q.w] }
    }

    /// `None` where a number is not finite or the quaternion has no length.
    pub fn pose(&self) -> Option<Pose> {
        pose_from_xyzw(self.translation_m, self.rotation_xyzw)
    }
}

impl CameraModel {
    pub fn size(&self) -> Size {
        Size::new(self.width, self.height)
    }

    /// The camera of the rectified picture: same size, same focal lengths and principal point.
    pub fn pinhole(&self) -> Pinhole {
        Pinhole {
            width: self.width,
            height: self.height,
            fx: self.fx as f32,
            fy: self.fy as f32,
            cx: self.cx as f32,
            cy: self.cy as f32,
        }
    }

    /// The same camera delivering pictures of another size; `None` where the aspect differs, because
    /// then the picture was cropped in a way that no one can guess.
    pub fn scaled_to(&self, size: Size) -> Option<Self> {
        let s = size.width as f64 / self.width as f64;
        // One pixel of rounding in the smaller picture.
        if (self.height as f64 * s - size.height as f64).abs() > 1.0 {
            return None;
        }
        Some(Self {
            width: size.width,
            height: size.height,
            fx: self.fx * s,
            fy: self.fy * s,
            cx: (self.cx + 0.5) * s - 0.5,
            cy: (self.cy + 0.5) * s - 0.5,
            distortion: self.distortion,
        })
    }

    fn problems(&self, which: &str, found: &mut Vec<String>) {
        if self.width == 0
            || self.height == 0
            || self.width.saturating_mul(self.height) > super::MAX_PIXELS
        {
            found.push(format!("{which} size {}x{}", self.width, self.height));
        }
        // As the pipeline will have them.
        let usable = |f: f64| f > 0.0 && (f as f32).is_normal();
        if !(usable(self.fx) && usable(self.fy)) {
            found.push(format!("{which} focal lengths {} {} are not positive", self.fx, self.fy));
        }
        if !((self.cx as f32).is_finite() && (self.cy as f32).is_finite()) {
            found.push(format!("{which} principal point {} {}", self.cx, self.cy));
        }
        if self.distortion.coefficients().iter().any(|c| !c.is_finite()) {
            found.push(format!("{which} distortion is not finite"));
        }
    }
}

impl Calibration {
    /// A camera whose depth is registered, without anything else known.
    pub fn registered(name: impl Into<String>, color: CameraModel) -> Self {
        Self {
            name: name.into(),
            notes: String::new(),
            registered: true,
            depth_factor: None,
            invalid_depth: default_invalid_depth(),
            poses_of: PoseOwner::Color,
            color,
            depth: None,
            color_from_depth: None,
            disparity: None,
            photometry: Photometry::default(),
        }
    }

    pub fn from_toml(content: &str) -> Result<Self, String> {
        let calibration: Self = toml::from_str(content).map_err(|e| e.to_string())?;
        calibration.check()?;
        Ok(calibration)
    }

    pub fn to_toml(&self) -> Result<String, CaptureError> {
        toml::to_string(self).map_err(|e| CaptureError::Sequence(format!("calibration: {e}")))
    }

    /// Reads own TOML, OpenCV and ROS YAML, ORB-SLAM settings, or Open3D JSON, by what the file is.
    /// `pictures` is the size to assume where the file gives none.
    pub fn read(path: &Path, pictures: Option<Size>) -> Result<Self, CaptureError> {
        let content = text::read(path)?;
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_lowercase();
        let name = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
        let read = match extension.as_str() {
            "toml" => Self::from_toml(&content),
            "yaml" | "yml" => calibration_files::from_yaml(&name, &content, pictures),
            "json" => calibration_files::from_open3d_json(&name, &content),
            "txt" => calibration_files::from_text(&name, &content, pictures),
            _ => Err("not a calibration file: .toml, .yaml, .yml, .json and .txt are read".into()),
        };
        let checked = read.and_then(|c| c.check().map(|()| c));
        checked.map_err(|problem| CaptureError::file(path, problem))
    }

    /// All that is wrong, at once.
    pub fn check(&self) -> Result<(), String> {
        let mut found = Vec::new();
        self.color.problems("color", &mut found);
        if let Some(depth) = &self.depth {
            depth.problems("depth", &mut found);
        }
        if self.depth_factor.is_some_and(|f| !usable_depth_factor(f)) {
            found.push(format!(
                "depth_factor {:?} is not positive, or too small",
                self.depth_factor
            ));
        }
        if self.color_from_depth.is_some_and(|r| r.pose().is_none()) {
            found.push("color_from_depth is no rigid transform".into());
        }
        if let Some(disparity) = &self.disparity {
            disparity.problems(&mut found);
            if self.depth_factor.is_some() {
                found.push("depth_factor and [disparity] exclude each other".into());
            }
        }
        self.photometry.problems(&mut found);
        if !self.registered && (self.depth.is_none() || self.color_from_depth.is_none()) {
            found.push("unregistered, so [depth] and [color_from_depth] are needed".into());
        }
        if found.is_empty() { Ok(()) } else { Err(found.join("; ")) }
    }
}

/// Calibrations that come with the program: name, what to look for in a folder's name, content.
const BUILT_IN: [(&str, &[&str], &str); 6] = [
    ("tum_freiburg1", &["freiburg1", "fr1"], include_str!("../../calib/tum_freiburg1.toml")),
    ("tum_freiburg2", &["freiburg2", "fr2"], include_str!("../../calib/tum_freiburg2.toml")),
    ("tum_freiburg3", &["freiburg3", "fr3"], include_str!("../../calib/tum_freiburg3.toml")),
    (
        "dynamic_hands_cup",
        &["dynamic_hands_cup"],
        include_str!("../../calib/dynamic_hands_cup.toml"),
    ),
    (SEVEN_SCENES, &[], include_str!("../../calib/7scenes_redkitchen.toml")),
    (KINECT_V1, &[], include_str!("../../calib/kinect_v1.toml")),
];

pub(super) const SEVEN_SCENES: &str = "7scenes_redkitchen";
pub(super) const KINECT_V1: &str = "kinect_v1";

pub fn built_in_names() -> impl Iterator<Item = &'static str> {
    BUILT_IN.iter().map(|(name, ..)| *name)
}

/// A calibration that comes with the program; `None` where there is none of that name.
pub fn built_in(name: &str) -> Option<Calibration> {
    let (.., content) = BUILT_IN.iter().find(|(n, ..)| *n == name)?;
    Some(Calibration::from_toml(content).expect("built-in calibrations are tested"))
}

/// The built-in calibration of a well-known recording, by the name of its folder.
pub(super) fn built_in_for_folder(folder: &Path) -> Option<Calibration> {
    let name = folder.file_name()?.to_string_lossy().to_lowercase();
    let words: Vec<_> = name.split(|c: char| !c.is_ascii_alphanumeric()).collect();
    let known = |key: &&str| name == *key || words.contains(key);
    let (found, ..) = BUILT_IN.iter().find(|(_, keys, _)| keys.iter().any(known))?;
    built_in(found)
}

#[cfg(test)]
mod tests;
