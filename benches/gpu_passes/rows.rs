//! Passes put together into rows of the table.

use crate::run::Measured;
use kinlight::gpu::roofline::{StatedGpu, Work};
use kinlight::gpu::{Constant, PassRecord};
use kinlight::timing::Stage;
use std::time::Duration;

/// Passes of one name.
#[derive(Clone)]
pub struct Row {
    pub name: String,
    /// In the frame that was counted.
    pub calls: usize,
    /// Sum over the passes of each frame.
    pub times: Vec<Duration>,
    /// Of each pass of the frame that was counted.
    pub works: Vec<Work>,
}

impl Row {
    pub fn work(&self) -> Work {
        self.works.iter().copied().sum()
    }

    /// Passes run one after the other.
    pub fn floor(&self, gpu: &StatedGpu) -> Duration {
        self.works.iter().map(|work| gpu.floor(work)).sum()
    }
}

/// In the order in which they first run.
pub fn rows(measured: &Measured, kernels: bool) -> Vec<Row> {
    let mut rows: Vec<Row> = Vec::new();
    let mut row = |name: String, frames: usize| -> usize {
        rows.iter().position(|r| r.name == name).unwrap_or_else(|| {
            rows.push(Row {
                name,
                calls: 0,
                times: vec![Duration::ZERO; frames],
                works: Vec::new(),
            });
            rows.len() - 1
        })
    };
    let frames = measured.timed.len();
    let mut placed = Vec::new();
    for (frame, passes) in measured.timed.iter().enumerate() {
        placed
            .extend(named(passes, kernels).map(|(name, p)| (row(name, frames), frame, p.clone())));
    }
    let counted: Vec<_> =
        named(&measured.counted, kernels).map(|(name, p)| (row(name, frames), p.work)).collect();
    for (at, frame, pass) in placed {
        rows[at].times[frame] += pass.time.unwrap_or_default();
    }
    for (at, work) in counted {
        rows[at].calls += 1;
        rows[at].works.extend(work);
    }
    rows
}

fn named(passes: &[PassRecord], kernels: bool) -> impl Iterator<Item = (String, &PassRecord)> {
    passes.iter().map(move |pass| {
        let name = match (&pass.shader, kernels) {
            (Some(shader), true) => shader.file.to_owned(),
            _ => name(pass),
        };
        (name, pass)
    })
}

/// Workgroups of 8x8 pixels of the camera's view.
const MAIN_VIEW: [u32; 3] = [80, 60, 1];
/// Of the alignment: 512 pixels each.
const FINEST_LEVEL: [u32; 3] = [600, 1, 1];

fn name(pass: &PassRecord) -> String {
    let Some(shader) = &pass.shader else {
        return format!("{}: copies, clears, read-back", pass.stage.name());
    };
    let is = |name: &str| shader.constants.contains(&(name, Constant::Bool(true)));
    let name = match (shader.file, pass.stage) {
        ("input/depth" | "input/color", _) => "Input: depth and colour filters",
        ("tracking/bilateral", _) => "Tracking: bilateral filter",
        ("tracking/halve" | "tracking/normals", _) => "Tracking: pyramid, normals",
        ("tracking/sums", _) if pass.groups == FINEST_LEVEL => "Tracking: reduction, finest level",
        ("tracking/sums" | "tracking/totals", _) => "Tracking: other levels, totals",
        ("tracking/cells", _) => "Tracking: thumbnail",
        ("fusion/integrate", _) => "Integrate: distances",
        ("fusion/color", _) => "Integrate: colours",
        ("fusion/mark", _) => "Integrate: blocks marked along rays",
        ("fusion/tiles", _) => "Ray-cast: depth ranges of tiles",
        ("fusion/raycast", Stage::Reconstruct) => "Ray-cast: for tracking",
        ("fusion/raycast", _) if pass.groups == MAIN_VIEW => "Ray-cast: main view",
        ("fusion/raycast", _) => "Ray-cast: auxiliary views",
        ("fusion/survey" | "fusion/survey_x", _) => "Traced transfer: empty space",
        (file, _) if file.starts_with("fusion/") => "Integrate: blocks kept and released",
        ("dyn_geo/merge", _) => "DynGeo: D', merge",
        ("dyn_geo/median", _) if is("GUIDED") => "DynGeo: D'', guided median",
        ("dyn_geo/median", _) => "DynGeo: D''', median",
        ("dyn_geo/model_depth", _) => "DynGeo: the model's depth",
        ("dyn_geo/normals", _) => "DynGeo: normals",
        ("transfer/real", _) => "Transfer: real scene",
        ("transfer/merged", _) => "Transfer: with virtual, and bounce",
        (file, _) if file.starts_with("transfer/") => "Transfer: views prepared",
        ("transfer_traced/volume", _) => "Traced transfer: rays through the volume",
        ("transfer_traced/objects", _) => "Traced transfer: rays against objects",
        (file, _) if file.starts_with("transfer_traced/") => {
            "Traced transfer: plan, refine, project"
        }
        (file, _) if file.starts_with("light_samples/") => "Light samples",
        ("raster/draw", _) => "Rasterise: draw samples",
        ("raster/resolve", _) => "Rasterise: resolve",
        (file, _) if file.starts_with("exitant/") => "Exitant radiance",
        ("compositing/shade", _) => "Compositing: shading of the grid",
        ("compositing/smooth" | "compositing/sums" | "compositing/means", _) => {
            "Compositing: grid smoothed"
        }
        ("compositing/pixels" | "compositing/virtual_light", _) => "Compositing: pixels",
        (file, _) if file.starts_with("compositing/") => "Compositing: up-sampling",
        (file, _) => file,
    };
    name.to_owned()
}
