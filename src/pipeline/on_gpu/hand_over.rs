//! What a pipeline takes along when it has to go on elsewhere.

use super::GpuPipeline;
use crate::capture::RawFrame;
use crate::fusion::TsdfVolume;
use crate::gpu::Gpu;
use crate::math::View;
use crate::pipeline::{Pipeline, PipelineError};
use crate::timing::StageTimes;
use std::sync::Arc;

impl GpuPipeline {
    pub(in crate::pipeline) fn device(&self) -> &Gpu {
        &self.gpu
    }

    /// A pipeline on the CPU that goes on from here with a new map: camera, objects and the light's
    /// memory are kept.
    pub fn to_cpu(&self) -> Result<Pipeline, PipelineError> {
        let settings = self.settings.clone();
        let mut pipeline = Pipeline::new(settings, self.camera, self.scene.clone())?;
        pipeline.origin = self.origin;
        pipeline.estimator = self.estimator.clone();
        pipeline.given_light = self.given_light.clone();
        pipeline.light = self.light.clone();
        pipeline.composed = self.composed.clone();
        if let Some(pose) = self.last_pose {
            pipeline.tracker.reset(pose);
        }
        Ok(pipeline)
    }

    /// As [`Self::to_cpu`], on another device.
    pub(in crate::pipeline) fn to_device(&self, gpu: Arc<Gpu>) -> Result<Self, PipelineError> {
        let settings = self.settings.clone();
        let mut pipeline = Self::new(gpu, settings, self.camera, self.scene.clone())?;
        pipeline.origin = self.origin;
        pipeline.estimator = self.estimator.clone();
        pipeline.given_light = self.given_light.clone();
        pipeline.light = self.light.clone();
        pipeline.composed = self.composed.clone();
        if let Some(pose) = self.last_pose {
            pipeline.tracker.reset(pose);
            pipeline.last_pose = Some(pose);
        }
        Ok(pipeline)
    }

    /// As [`Pipeline::see_again`](crate::pipeline::Pipeline::see_again).
    pub(in crate::pipeline) fn see_again(&mut self, frame: &RawFrame) -> Result<(), PipelineError> {
        let (estimator, light) = (self.estimator.clone(), self.light.clone());
        self.process(frame, StageTimes::default())?;
        (self.estimator, self.light) = (estimator, light);
        Ok(())
    }

    /// The map, and from where it was seen last; `None` where there is none, and an error where it is gone
    /// with its device.
    pub(in crate::pipeline) fn map_on_host(
        &self,
    ) -> Result<Option<(TsdfVolume, View)>, PipelineError> {
        let (Some(map), Some(pose)) = (&self.map, self.last_pose) else { return Ok(None) };
        let volume = map.volume.download(&self.gpu)?;
        Ok(Some((volume, View::perspective(self.camera, pose))))
    }
}
