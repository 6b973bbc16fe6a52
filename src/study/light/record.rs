//! What a light study leaves behind, `study.json`.

use crate::study::Machine;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LightStudy {
    pub machine: Machine,
    /// The command line that made it.
    pub command: String,
    /// In order of growing richness.
    pub scenes: Vec<String>,
    /// Names of presets, and [`super::REFERENCE`] and [`super::REFERENCE_ALONE`] (light probes).
    pub methods: Vec<String>,
    pub frames_per_run: usize,
    /// Frames at the start of each run that are not counted.
    pub warm_up: usize,
    pub runs: Vec<LightRun>,
    /// Lamp switched.
    pub steps: Vec<StepResponse>,
    /// Nothing changes and the camera stands still.
    pub jitter: Vec<Jitter>,
}

/// One method on one sequence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LightRun {
    pub scene: String,
    /// Light on the half circle.
    pub light: usize,
    /// Whether depth came through the sensor model. Light probes need no depth: never for those.
    pub sensor_noise: bool,
    pub method: String,
    /// Unit vector towards the lamp, world axes.
    pub true_direction: [f64; 3],
    /// Frames after the warm-up that have a valid light.
    pub frames: Vec<LightFrame>,
    /// Frames after the warm-up that have none.
    pub invalid: usize,
    /// Medians over frames, by [`crate::timing::Stage::name`], and "Update"; empty for the reference method.
    pub stage_ms: BTreeMap<String, f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LightFrame {
    pub frame: usize,
    /// Estimated dominant direction; none where band 1 is zero.
    pub direction: Option<[f64; 3]>,
    /// To the true dominant direction.
    pub angle_deg: Option<f64>,
    /// Of the SH coefficients after the best common scale.
    pub relative_l2: f64,
}

/// The lamp changes at one frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepResponse {
    pub scene: String,
    pub method: String,
    pub sensor_noise: bool,
    /// The first frame with the new light.
    pub switch_frame: usize,
    /// Frames after the switch until the estimate stays within 10 % (relative L2 of the SH
    /// coefficients) of its final value, the mean of the last frames. None where it never does.
    pub settled_after: Option<usize>,
    pub trace: Vec<StepTrace>,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepTrace {
    pub frame: usize,
    /// Relative L2 distance of the coefficients to the final value.
    pub distance: f64,
    /// To the true direction at this frame.
    pub angle_deg: Option<f64>,
}

/// How an estimate moves while nothing does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Jitter {
    pub scene: String,
    pub method: String,
    pub sensor_noise: bool,
    pub frames: usize,
    /// Median and largest angle between the dominant directions of consecutive frames.
    pub median_deg: f64,
    pub max_deg: f64,
    /// Median relative L2 change of the coefficients from frame to frame.
    pub relative_l2: f64,
}
