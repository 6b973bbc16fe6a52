//! What a sweep leaves behind, `study.json`.

use crate::study::Machine;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tradeoff {
    pub machine: Machine,
    /// The command line that made it.
    pub command: String,
    pub sequences: Vec<String>,
    /// Frames at the start of each run that were not counted.
    #[serde(default)]
    pub warm_up: usize,
    pub points: Vec<TradePoint>,
}

/// One setting, measured over all sequences.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TradePoint {
    /// For people: "step 4, 32 directions".
    pub name: String,
    pub preset: String,
    /// `field=value` on top of the preset.
    pub changes: Vec<String>,
    /// Medians over frames, mean over sequences: by [`crate::timing::Stage::name`], and "Update".
    pub stage_ms: BTreeMap<String, f64>,
    pub update_ms: f64,
    /// Median angle to the true dominant direction; none without truth.
    pub light_angle_deg: Option<f64>,
    pub light_relative_l2: Option<f64>,
    /// Relative L2 of the transfer against traced transfer.
    pub transfer_error: Option<f64>,
    /// Relative RMSE of the composed change of light (see [`crate::study::composite::CompositeFrame`]).
    pub composite_error: Option<f64>,
    pub volume_mib: f64,
    /// Nothing measured is as good in time and error and better in one; by the error of
    /// [`ErrorKind`](super::ErrorKind) that the front was marked for.
    pub on_front: bool,
}
