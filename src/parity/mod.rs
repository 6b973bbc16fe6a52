//! Whether the two backends agree: every stage alone on the CPU's input, and whole runs, each difference held
//! against a tolerance with its reason.

mod ledger;
mod report;
mod run;
pub mod stages;
#[cfg(test)]
mod tests;
pub mod tolerances;
pub mod upload;

pub use ledger::{Found, Ledger};
pub use report::{Report, Row, Verdict};
pub use run::{Summary, WholeRun, light_difference_deg, pose_difference};

use crate::capture::{CaptureError, FrameSource, RawFrame};
use crate::config::Settings;
use crate::geometry::GBuffer;
use crate::gpu::{Gpu, GpuError};
use crate::pipeline::{Backend, GpuPipeline, Pipeline, PipelineError, StageBuffers};
use crate::scene::VirtualScene;
use crate::timing::StageTimes;
use crate::tracking::PoseMode;
use stages::{Bench, Fused};
use std::sync::Arc;

#[derive(Debug, thiserror::Error)]
pub enum ParityError {
    #[error(transparent)]
    Capture(#[from] CaptureError),
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    #[error(transparent)]
    Gpu(#[from] GpuError),
    #[error(transparent)]
    Volume(#[from] crate::fusion::FusionError),
    #[error(transparent)]
    Transfer(#[from] crate::transfer::TransferError),
    #[error("there is no frame to compare")]
    NoFrames,
    #[error("the CPU backend composed none of the frames at which stages are compared: {frames:?}")]
    NotComposed { frames: Vec<usize> },
}

/// Runs both backends over all frames of `source` and compares the stages at `stage_frames` of them, the first
/// and the last among these. `on_frame` is called after each.
pub fn compare(
    gpu: &Arc<Gpu>,
    settings: &Settings,
    scene: &VirtualScene,
    source: &mut dyn FrameSource,
    stage_frames: usize,
    on_frame: &mut dyn FnMut(&RawFrame),
) -> Result<Report, ParityError> {
    let mut chosen = Chosen::new(source.len().unwrap_or(0), stage_frames);
    let mut comparison = Comparison::new(gpu, settings, scene, source)?;
    while let Some(raw) = source.next_frame()? {
        let with_stages = chosen.next(raw.index);
        comparison.frame(&raw, with_stages)?;
        on_frame(&raw);
    }
    comparison.report()
}

/// Frames at which stages are compared: evenly spread.
struct Chosen {
    frames: usize,
    count: usize,
    /// Index of the first frame.
    first: Option<usize>,
}

impl Chosen {
    fn new(frames: usize, count: usize) -> Self {
        Self { frames, count: count.min(frames), first: None }
    }

    fn next(&mut self, index: usize) -> bool {
        let position = index - *self.first.get_or_insert(index);
        match (self.frames, self.count) {
            (_, 0) => false,
            (_, 1) => position == 0,
            (frames, count) => (0..count).any(|k| k * (frames - 1) / (count - 1) == position),
        }
    }
}

struct Comparison {
    gpu: Arc<Gpu>,
    settings: Settings,
    cpu: Pipeline,
    on_gpu: GpuPipeline,
    fused: Fused,
    ledger: Ledger,
    run: WholeRun,
    frames: usize,
    /// Those at which stages were to be compared, and those at which they were.
    wanted: Vec<usize>,
    compared: Vec<usize>,
}

impl Comparison {
    fn new(
        gpu: &Arc<Gpu>,
        settings: &Settings,
        scene: &VirtualScene,
        source: &dyn FrameSource,
    ) -> Result<Self, ParityError> {
        let camera = source.camera();
        Ok(Self {
            gpu: gpu.clone(),
            cpu: Pipeline::new(settings.clone(), camera, scene.clone())?,
            on_gpu: GpuPipeline::new(gpu.clone(), settings.clone(), camera, scene.clone())?,
            settings: settings.clone(),
            fused: Fused::default(),
            ledger: Ledger::new(gpu.summary().is_software()),
            run: WholeRun::default(),
            frames: 0,
            wanted: Vec::new(),
            compared: Vec::new(),
        })
    }

    fn frame(&mut self, raw: &RawFrame, with_stages: bool) -> Result<(), ParityError> {
        let model = self.cpu.model().filter(|_| with_stages).cloned();
        let cpu = self.cpu.process(raw.clone(), StageTimes::default())?;
        let gpu = self.on_gpu.process(raw, StageTimes::default())?;
        self.run.add([&cpu, &gpu], [self.cpu.composed(), self.on_gpu.composed()]);
        self.frames += 1;
        let seen = self.cpu.stages();
        if let Some(seen) = seen.as_ref().filter(|_| cpu.tracking.may_fuse()) {
            self.fused.follow(&self.gpu, seen.volume, seen.frame, &seen.model.view)?;
        }
        if !with_stages {
            return Ok(());
        }
        self.wanted.push(raw.index);
        let Some(seen) = seen else { return Ok(()) };
        let bench = &mut Bench {
            gpu: &self.gpu,
            settings: &self.settings,
            ledger: &mut self.ledger,
            frame: raw.index,
        };
        compare_stages(bench, raw, model.as_ref(), &seen, &self.fused)?;
        self.compared.push(raw.index);
        Ok(())
    }

    fn report(self) -> Result<Report, ParityError> {
        if self.frames == 0 {
            return Err(ParityError::NoFrames);
        }
        if self.compared.is_empty() {
            return Err(ParityError::NotComposed { frames: self.wanted });
        }
        self.gpu.check()?;
        let run = self.run.summaries(self.gpu.summary().is_software());
        let frames = (self.frames, self.compared);
        Ok(Report::new(&self.gpu, &self.settings, frames, &self.ledger, run))
    }
}

/// All stages at one frame, in the order of the data flow. `model` is the map's picture of the frame before.
fn compare_stages(
    bench: &mut Bench,
    raw: &RawFrame,
    model: Option<&GBuffer>,
    seen: &StageBuffers,
    fused: &Fused,
) -> Result<(), ParityError> {
    stages::input(bench, raw, seen.frame)?;
    if let Some(model) = model.filter(|_| bench.settings.tracking.mode == PoseMode::Track) {
        stages::tracking(bench, seen.frame, model)?;
    }
    stages::dyn_geo(bench, seen)?;
    if let Some(volume) = fused.volume() {
        let voxels = volume.download(bench.gpu)?;
        stages::fusion(bench, seen.volume, &voxels);
        let views = std::iter::once(seen.model).chain(seen.auxiliary).map(|buffer| buffer.view);
        stages::raycast(bench, volume, &voxels, views)?;
        stages::transfer(bench, seen, volume, &voxels)?;
    }
    stages::light(bench, seen)?;
    if let Some(objects) = &seen.with_objects {
        stages::raster(bench, seen, objects)?;
        stages::exitant(bench, seen, objects)?;
        stages::compositing(bench, seen, objects)?;
    }
    Ok(())
}
