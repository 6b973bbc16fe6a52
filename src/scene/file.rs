//! The scene file: which models stand where.

use super::SceneError;
use super::anchor::SurfaceAnchor;
use super::error::read_limited;
use super::objects::{Placement, Similarity};
use glam::{DVec2, DVec3, Vec3};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

const MAX_FILE_BYTES: u64 = 1 << 24;

/// TOML with one `[[object]]` table an instance.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    #[serde(default)]
    pub object: Vec<ObjectSpec>,
}

/// One object as it is written; exactly one of `at` and `on` is given.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectSpec {
    /// glTF or GLB, relative to the scene file.
    pub file: PathBuf,
    /// World position of the object's origin, metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at: Option<[f64; 3]>,
    /// `[u, v, frame]`: stand on the surface that is seen at this pixel of this frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub on: Option<[f64; 3]>,
    /// About the up direction, counter-clockwise seen from above.
    #[serde(default)]
    pub yaw_deg: f64,
    #[serde(default = "one")]
    pub scale: f64,
    /// World direction of the model's +y. Default: the surface normal with `on`, +z with `at`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub up: Option<[f64; 3]>,
}

fn one() -> f64 {
    1.0
}

/// A checked [`ObjectSpec`].
pub(super) enum Stand {
    At(Similarity),
    On(SurfaceAnchor),
}

impl Stand {
    pub fn placement(self) -> Placement {
        match self {
            Self::At(similarity) => Placement::Placed(similarity),
            Self::On(anchor) => Placement::Pending(anchor),
        }
    }
}

impl SceneFile {
    pub fn load(path: &Path) -> Result<Self, SceneError> {
        let problem = |what: String| SceneError::SceneFile { path: path.to_owned(), what };
        let text = String::from_utf8(read_limited(path, MAX_FILE_BYTES)?)
            .map_err(|_| problem("it is not UTF-8 text".to_owned()))?;
        toml::from_str(&text).map_err(|e| problem(e.to_string()))
    }
}

impl ObjectSpec {
    /// The key that is wrong, and why.
    pub(super) fn stand(&self) -> Result<Stand, (&'static str, String)> {
        let finite = |key, values: &[f64]| match values.iter().find(|v| !(**v as f32).is_finite()) {
            Some(v) => Err((key, format!("has a value that is not finite, or too large ({v})"))),
            None => Ok(()),
        };
        finite("yaw_deg", &[self.yaw_deg])?;
        let yaw_rad = self.yaw_deg.to_radians() as f32;
        let scale = self.scale as f32;
        if !(scale.is_finite() && scale > 0.0) {
            return Err(("scale", format!("must be positive and finite, not {}", self.scale)));
        }
        let up = self.up.map(|up| unit("up", up)).transpose()?;
        match (self.at, self.on) {
            (Some(at), None) => {
                finite("at", &at)?;
                let position = DVec3::from(at).as_vec3();
                let up = up.unwrap_or(Vec3::Z);
                Ok(Stand::At(Similarity::standing(position, up, yaw_rad, scale)))
            }
            (None, Some([u, v, frame])) => {
                finite("on", &[u, v, frame])?;
                if frame < 0.0 || frame.fract() != 0.0 {
                    return Err((
                        "on",
                        format!("has frame {frame}; frames are whole numbers from 0"),
                    ));
                }
                if u < 0.0 || v < 0.0 {
                    return Err(("on", format!("has pixel {u}, {v}; pixels count from 0, 0")));
                }
                let pixel = DVec2::new(u, v).as_vec2();
                Ok(Stand::On(SurfaceAnchor::new(pixel, frame as usize, yaw_rad, scale, up)))
            }
            (Some(_), Some(_)) => Err(("at", "and `on` are both given: leave one out".to_owned())),
            (None, None) => Err(("at", "or `on` is needed to say where it stands".to_owned())),
        }
    }
}

fn unit(key: &'static str, vector: [f64; 3]) -> Result<Vec3, (&'static str, String)> {
    DVec3::from(vector)
        .try_normalize()
        .map(|v| v.as_vec3())
        .ok_or_else(|| (key, format!("must be a direction, not {vector:?}")))
}
