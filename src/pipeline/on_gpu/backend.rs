//! What a run asks of the pipeline.

use super::GpuPipeline;
use crate::capture::RawFrame;
use crate::config::Settings;
use crate::image::Image;
use crate::lighting::LightEstimate;
use crate::mesh::TriangleMesh;
use crate::pipeline::{
    Backend, BackendRecord, Buffer, BufferValues, FrameOutcome, Pipeline, PipelineError, shared,
};
use crate::timing::StageTimes;

impl Backend for GpuPipeline {
    fn process(&mut self, raw: RawFrame, times: StageTimes) -> Result<FrameOutcome, PipelineError> {
        self.process(&raw, times)
    }

    fn reconfigure(&mut self, settings: Settings) -> Result<(), PipelineError> {
        self.reconfigure(settings)
    }

    fn composed(&self) -> &Image<[u8; 3]> {
        &self.composed
    }

    fn settings(&self) -> &Settings {
        &self.settings
    }

    fn light(&self) -> Option<&LightEstimate> {
        self.light.as_ref()
    }

    /// The volume comes back for it.
    fn mesh(&self) -> Result<TriangleMesh, PipelineError> {
        let mesh = self.map.as_ref().map(|m| m.volume.mesh(&self.gpu)).transpose()?;
        Ok(shared::mesh_in_world(mesh.unwrap_or_default(), self.origin.as_ref()))
    }

    fn buffer(&self, which: Buffer) -> Result<Option<BufferValues>, PipelineError> {
        self.download(which)
    }

    fn record(&self) -> BackendRecord {
        BackendRecord {
            name: "gpu".to_owned(),
            adapter: Some(self.gpu.summary().to_string()),
            clock: self.clock.name().to_owned(),
            traffic: self.traffic.of_a_frame(),
            handovers: Vec::new(),
            volume_bytes: self.map.as_ref().map(|m| m.volume.memory_bytes() as u64),
        }
    }

    fn on_host(&self) -> Option<&Pipeline> {
        None
    }
}
