//! A run outlives its graphics device.

#[cfg(test)]
mod tests;

use super::{
    Backend, BackendRecord, Buffer, BufferValues, FrameOutcome, GpuPipeline, Handover, Map,
};
use super::{MergedSides, Pipeline, PipelineError};
use crate::capture::RawFrame;
use crate::config::Settings;
use crate::fusion::{FusionError, SurfaceStage};
use crate::gpu::{Gpu, GpuError};
use crate::image::Image;
use crate::lighting::LightEstimate;
use crate::mesh::TriangleMesh;
use crate::timing::StageTimes;
use std::collections::VecDeque;
use std::sync::Arc;

/// Opens a device.
pub type OpenDevice = Box<dyn FnOnce() -> Result<Gpu, GpuError>>;

/// On the GPU until the device is lost or its memory is used up; from that frame on, on the same device,
/// opened anew, or on the CPU. Camera, objects and the light's memory are kept.
///
/// The map of a lost device cannot be read any more: a new one begins with the frame before, at the pose that
/// this had, so that the frame that was cut short is tracked as all others are. The map of a device that is
/// only too small goes on to the CPU.
pub struct WithFallback {
    running: Running,
    reopen: Option<OpenDevice>,
    insists: bool,
    /// Frames before which the device is destroyed.
    losses: VecDeque<usize>,
    /// The newest that was processed and fused.
    newest: Option<RawFrame>,
    /// Frames processed.
    frames: usize,
    handovers: Vec<Handover>,
}

enum Running {
    Gpu(Box<GpuPipeline>),
    /// And what the GPU did before.
    Cpu(Box<Pipeline>, BackendRecord),
}

impl Running {
    fn backend(&self) -> &dyn Backend {
        match self {
            Self::Gpu(pipeline) => &**pipeline,
            Self::Cpu(pipeline, _) => &**pipeline,
        }
    }

    fn backend_mut(&mut self) -> &mut dyn Backend {
        match self {
            Self::Gpu(pipeline) => &mut **pipeline,
            Self::Cpu(pipeline, _) => &mut **pipeline,
        }
    }
}

impl WithFallback {
    pub fn new(pipeline: GpuPipeline) -> Self {
        Self {
            running: Running::Gpu(Box::new(pipeline)),
            reopen: None,
            insists: false,
            losses: VecDeque::new(),
            newest: None,
            frames: 0,
            handovers: Vec::new(),
        }
    }

    /// Tries this when the device is lost for the first time: after the reset of a driver, there is one again.
    pub fn reopening(mut self, open: OpenDevice) -> Self {
        self.reopen = Some(open);
        self
    }

    /// What keeps the device from its first frame is an error.
    pub fn insisting(mut self, insists: bool) -> Self {
        self.insists = insists;
        self
    }

    /// Destroys the device before each of these frames, which are in order: for trying what follows.
    pub fn losing_device_before(mut self, frames: &[usize]) -> Self {
        self.losses = frames.iter().copied().collect();
        self
    }

    fn lose_device_where_wanted(&mut self, frame: usize) {
        if let Running::Gpu(pipeline) = &self.running
            && self.losses.pop_front_if(|&mut at| at <= frame).is_some()
        {
            pipeline.device().destroy();
        }
    }

    /// Goes on elsewhere from the end of the frame before.
    fn hand_over(&mut self, frame: usize, error: PipelineError) -> Result<(), PipelineError> {
        let Running::Gpu(pipeline) = &self.running else { return Err(error) };
        let mut because = error.to_string();
        if pipeline.device().check().is_err_and(|e| e.is_lost())
            && let Some(open) = self.reopen.take()
        {
            match reopened(pipeline, open, self.newest.as_ref()) {
                Ok(anew) => {
                    log::warn!("frame {frame}: {because}; opened anew, with a new map");
                    self.running = Running::Gpu(anew.into());
                    self.handovers.push(Handover { frame, to: "gpu".into(), because });
                    return Ok(());
                }
                Err(error) => because += &format!(", and opening it anew failed: {error}"),
            }
        }
        let (cpu, keeps_map) = on_cpu(pipeline, self.newest.as_ref())?;
        let map = if keeps_map { "the same map" } else { "a new map" };
        log::warn!("frame {frame}: {because}; going on with the CPU backend, with {map}");
        self.running = Running::Cpu(Box::new(cpu), pipeline.record());
        self.handovers.push(Handover { frame, to: "cpu".into(), because });
        Ok(())
    }

    fn may_hand_over(&self, error: &PipelineError) -> bool {
        error.is_the_devices() && (self.frames > 0 || !self.insists)
    }
}

fn reopened(
    before: &GpuPipeline,
    open: OpenDevice,
    newest: Option<&RawFrame>,
) -> Result<GpuPipeline, PipelineError> {
    let mut pipeline = before.to_device(Arc::new(open()?))?;
    if let Some(frame) = newest {
        pipeline.see_again(frame)?;
    }
    Ok(pipeline)
}

/// And whether it has the map.
fn on_cpu(
    before: &GpuPipeline,
    newest: Option<&RawFrame>,
) -> Result<(Pipeline, bool), PipelineError> {
    let mut pipeline = before.to_cpu()?;
    if let Ok(Some((volume, view))) = before.map_on_host() {
        let mut surface = SurfaceStage::new(&volume, view, &pipeline.settings.surface);
        surface.update(&volume, view, None);
        pipeline.map = Some(Map { volume, surface, sides: MergedSides::default() });
        return Ok((pipeline, true));
    }
    if let Some(frame) = newest {
        pipeline.see_again(frame)?;
    }
    Ok((pipeline, false))
}

impl Pipeline {
    /// Begins a map with the newest frame that was processed elsewhere, at the pose that it had there. The
    /// light has seen it already.
    pub(super) fn see_again(&mut self, frame: &RawFrame) -> Result<(), PipelineError> {
        let (estimator, light) = (self.estimator.clone(), self.light.clone());
        self.process(frame.clone(), StageTimes::default())?;
        (self.estimator, self.light) = (estimator, light);
        Ok(())
    }
}

impl PipelineError {
    /// Whether only the device keeps the pipeline from going on: it is lost or too small.
    pub fn is_the_devices(&self) -> bool {
        match self {
            Self::Gpu(error) | Self::Volume(FusionError::Gpu(error)) => {
                error.is_lost() || error.is_out_of_memory()
            }
            Self::Volume(FusionError::Full { .. }) => true,
            _ => false,
        }
    }
}

impl Backend for WithFallback {
    fn process(&mut self, raw: RawFrame, times: StageTimes) -> Result<FrameOutcome, PipelineError> {
        loop {
            self.lose_device_where_wanted(raw.index);
            let Running::Gpu(pipeline) = &mut self.running else {
                return self.running.backend_mut().process(raw, times);
            };
            match pipeline.process(&raw, times) {
                Ok(outcome) => {
                    self.frames += 1;
                    self.newest = outcome.tracking.may_fuse().then_some(raw);
                    return Ok(outcome);
                }
                Err(error) if self.may_hand_over(&error) => self.hand_over(raw.index, error)?,
                Err(error) => return Err(error),
            }
        }
    }

    fn reconfigure(&mut self, settings: Settings) -> Result<(), PipelineError> {
        loop {
            match self.running.backend_mut().reconfigure(settings.clone()) {
                Err(error) if self.may_hand_over(&error) => {
                    let next = self.newest.as_ref().map_or(0, |frame| frame.index + 1);
                    self.hand_over(next, error)?;
                }
                done => return done,
            }
        }
    }

    fn composed(&self) -> &Image<[u8; 3]> {
        self.running.backend().composed()
    }

    fn settings(&self) -> &Settings {
        self.running.backend().settings()
    }

    fn light(&self) -> Option<&LightEstimate> {
        self.running.backend().light()
    }

    fn mesh(&self) -> Result<TriangleMesh, PipelineError> {
        self.running.backend().mesh()
    }

    fn buffer(&self, which: Buffer) -> Result<Option<BufferValues>, PipelineError> {
        self.running.backend().buffer(which)
    }

    fn record(&self) -> BackendRecord {
        let handovers = self.handovers.clone();
        match &self.running {
            Running::Gpu(pipeline) => BackendRecord { handovers, ..pipeline.record() },
            Running::Cpu(_, before) => {
                let name = format!("{}, then cpu", before.name);
                BackendRecord { name, handovers, ..before.clone() }
            }
        }
    }

    fn check(&self) -> Result<(), PipelineError> {
        match &self.running {
            Running::Gpu(pipeline) => Ok(pipeline.device().check()?),
            Running::Cpu(..) => Ok(()),
        }
    }

    fn on_host(&self) -> Option<&Pipeline> {
        self.running.backend().on_host()
    }
}
