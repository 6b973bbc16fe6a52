//! From the device back to the host, when the device can do no more.

use super::GpuPipeline;
use crate::pipeline::{Pipeline, PipelineError};

impl GpuPipeline {
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
}
