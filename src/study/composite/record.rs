//! What a composite study leaves behind, `study.json`.

use crate::study::Machine;
use serde::{Deserialize, Deserializer, Serialize};

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CompositeStudy {
    pub machine: Machine,
    /// The command line that made it.
    pub command: String,
    pub runs: Vec<CompositeRun>,
}

/// One setting on one sequence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CompositeRun {
    pub sequence: String,
    /// Kind of virtual object: "diffuse", "coloured", "bright-dark", ...
    pub object: String,
    pub sensor_noise: bool,
    /// Folder of the sequence.
    #[serde(default)]
    pub folder: String,
    /// Preset it starts from.
    pub preset: String,
    /// What this variant asks, in words ("chi as printed"); the preset's name where nothing is changed.
    pub variant: String,
    /// Short name of the variant; "preset" where nothing is changed.
    #[serde(default)]
    pub key: String,
    /// `field=value` on top of the preset.
    pub changes: Vec<String>,
    pub frames: Vec<CompositeFrame>,
    /// Median update.
    pub update_ms: f64,
}

/// Errors of one composed frame. A value that is infinite (the PSNR of equal pictures) or not defined
/// (a change of light where nothing changed) is `null` in JSON, and NaN once read.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CompositeFrame {
    pub frame: usize,
    #[serde(deserialize_with = "null_is_nan")]
    pub psnr_db: f64,
    #[serde(deserialize_with = "null_is_nan")]
    pub ssim: f64,
    /// Mean FLIP (Andersson et al. 2020).
    #[serde(deserialize_with = "null_is_nan")]
    pub flip: f64,
    /// Relative RMSE where the object changed the light on real surfaces: of the change.
    #[serde(deserialize_with = "null_is_nan")]
    pub changed_rmse: f64,
    /// Relative RMSE on the object's own pixels.
    #[serde(deserialize_with = "null_is_nan")]
    pub object_rmse: f64,
    /// Light that the composed frame takes from real surfaces, relative to what the truth takes, where it
    /// takes some: 1 is a shadow of the right weight.
    #[serde(default = "nan", deserialize_with = "null_is_nan")]
    pub shadow_found: f64,
    /// Absolute change of light on real surfaces where the truth has none, relative to all the change
    /// that it has.
    #[serde(default = "nan", deserialize_with = "null_is_nan")]
    pub spill: f64,
    /// The `changed_rmse` that the truth's own noise would give a perfect frame.
    #[serde(default = "nan", deserialize_with = "null_is_nan")]
    pub noise_rmse: f64,
    /// Pixels of real surfaces where the light changed.
    #[serde(default)]
    pub changed_pixels: usize,
    /// Angle between the dominant directions of the light in use and the true one.
    #[serde(default = "nan", deserialize_with = "null_is_nan")]
    pub light_deg: f64,
    /// The mean albedo for which the estimated light is as strong as the true one.
    #[serde(default = "nan", deserialize_with = "null_is_nan")]
    pub implied_albedo: f64,
}

fn nan() -> f64 {
    f64::NAN
}

fn null_is_nan<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::NAN))
}
