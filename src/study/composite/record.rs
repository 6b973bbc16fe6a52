//! What a composite study leaves behind, `study.json`.

use crate::study::Machine;
use serde::{Deserialize, Serialize};

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
    /// Preset it starts from.
    pub preset: String,
    /// What this variant asks, in words ("chi as printed"); the preset's name where nothing is changed.
    pub variant: String,
    /// `field=value` on top of the preset.
    pub changes: Vec<String>,
    pub frames: Vec<CompositeFrame>,
    /// Median update.
    pub update_ms: f64,
}

/// Errors of one composed frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CompositeFrame {
    pub frame: usize,
    pub psnr_db: f64,
    pub ssim: f64,
    /// Mean FLIP (Andersson et al. 2020).
    pub flip: f64,
    /// Relative RMSE where the object changed the light on real surfaces: of the change.
    pub changed_rmse: f64,
    /// Relative RMSE on the object's own pixels.
    pub object_rmse: f64,
}
