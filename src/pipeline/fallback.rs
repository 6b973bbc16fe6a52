//! A run outlives its graphics device.

use super::{
    Backend, BackendRecord, Buffer, BufferValues, FrameOutcome, GpuPipeline, Pipeline,
    PipelineError,
};
use crate::capture::RawFrame;
use crate::config::Settings;
use crate::fusion::FusionError;
use crate::image::Image;
use crate::lighting::LightEstimate;
use crate::mesh::TriangleMesh;
use crate::timing::StageTimes;

/// On the GPU until the device is lost or its memory is used up; from that frame on, on the CPU. That starts
/// a new map at the last pose; camera, objects and the light's memory are kept.
pub enum WithFallback {
    Gpu(Box<GpuPipeline>),
    /// And what the GPU did before.
    Cpu(Box<Pipeline>, BackendRecord),
}

impl WithFallback {
    pub fn new(pipeline: GpuPipeline) -> Self {
        Self::Gpu(Box::new(pipeline))
    }

    fn running(&self) -> &dyn Backend {
        match self {
            Self::Gpu(pipeline) => &**pipeline,
            Self::Cpu(pipeline, _) => &**pipeline,
        }
    }

    fn running_mut(&mut self) -> &mut dyn Backend {
        match self {
            Self::Gpu(pipeline) => &mut **pipeline,
            Self::Cpu(pipeline, _) => &mut **pipeline,
        }
    }
}

impl PipelineError {
    /// Whether only the device keeps the pipeline from going on.
    fn is_the_devices(&self) -> bool {
        match self {
            Self::Gpu(error) | Self::Volume(FusionError::Gpu(error)) => error.is_lost(),
            Self::Volume(FusionError::Full { .. }) => true,
            _ => false,
        }
    }
}

impl Backend for WithFallback {
    fn process(&mut self, raw: RawFrame, times: StageTimes) -> Result<FrameOutcome, PipelineError> {
        let Self::Gpu(pipeline) = self else { return self.running_mut().process(raw, times) };
        match pipeline.process(&raw, times) {
            Err(error) if error.is_the_devices() => {
                log::warn!(
                    "frame {}: {error}; going on with the CPU backend, which starts a new map here",
                    raw.index
                );
                let (cpu, before) = (pipeline.to_cpu()?, pipeline.record());
                *self = Self::Cpu(Box::new(cpu), before);
                self.running_mut().process(raw, times)
            }
            other => other,
        }
    }

    fn reconfigure(&mut self, settings: Settings) -> Result<(), PipelineError> {
        self.running_mut().reconfigure(settings)
    }

    fn composed(&self) -> &Image<[u8; 3]> {
        self.running().composed()
    }

    fn settings(&self) -> &Settings {
        self.running().settings()
    }

    fn light(&self) -> Option<&LightEstimate> {
        self.running().light()
    }

    fn mesh(&self) -> Result<TriangleMesh, PipelineError> {
        self.running().mesh()
    }

    fn buffer(&self, which: Buffer) -> Result<Option<BufferValues>, PipelineError> {
        self.running().buffer(which)
    }

    fn record(&self) -> BackendRecord {
        match self {
            Self::Gpu(pipeline) => pipeline.record(),
            Self::Cpu(_, before) => {
                BackendRecord { name: format!("{}, then cpu", before.name), ..before.clone() }
            }
        }
    }

    fn on_host(&self) -> Option<&Pipeline> {
        self.running().on_host()
    }
}
