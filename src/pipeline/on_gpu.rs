//! [`Pipeline`](super::Pipeline) with its stages on the GPU: the same order, and the same state from frame
//! to frame.
//!
//! A frame is uploaded once. What comes back are the sums of the alignment, counters, samples for the light,
//! which is fitted on the host, and the composed picture.
//!
//! What differs: whether virtual objects change the picture is decided by where they may be seen and not by
//! counted pixels, which spares a wait; the picture is the same.

mod backend;
mod buffers;
mod clock;
mod download;
mod frame;
mod hand_over;
mod merged;
#[cfg(test)]
mod tests;
mod traffic;
mod transfer;

use super::{PipelineError, WorldOrigin, shared};
use crate::config::Settings;
use crate::gpu::stages::*;
use crate::gpu::{Gpu, GpuError};
use crate::image::{Image, Size};
use crate::lighting::{LightEstimate, LightEstimator, ShLight};
use crate::math::{Pinhole, Pose, View};
use crate::scene::VirtualScene;
use buffers::{FrameBuffers, Map, TransferMaps};
use clock::StageClock;
use std::sync::Arc;
use traffic::TrafficOfFrames;
use transfer::{GpuTransferStage, grid_step};

/// All stages, and the state carried between frames. What it shows of itself is in
/// [`Backend`](super::Backend).
pub struct GpuPipeline {
    gpu: Arc<Gpu>,
    settings: Settings,
    camera: Pinhole,
    origin: Option<WorldOrigin>,
    scene: VirtualScene,
    clock: StageClock,
    input: InputPass,
    tracker: GpuTracker,
    /// Draws the map where the tracker looks for the camera.
    caster: RayCaster,
    map: Option<Map>,
    dyn_geo: DynGeoPass,
    radiance_transfer: GpuTransferStage,
    samples: LightSamplesPass,
    estimator: LightEstimator,
    /// Stands in for the estimate where it is set.
    given_light: Option<ShLight>,
    /// Of the last frame.
    light: Option<LightEstimate>,
    last_pose: Option<Pose>,
    composed_last: bool,
    rasteriser: RasterPass,
    compositor: CompositingPass,
    last: FrameBuffers,
    composed: Image<[u8; 3]>,
    traffic: TrafficOfFrames,
}

fn samples_pass(gpu: &Gpu, settings: &Settings, size: Size) -> Result<LightSamplesPass, GpuError> {
    let (bands, step) = (settings.transfer.bands, grid_step(&settings.transfer));
    LightSamplesPass::new(gpu, &settings.light, size, bands, step)
}

impl GpuPipeline {
    /// As [`Pipeline::new`](super::Pipeline::new).
    pub fn new(
        gpu: Arc<Gpu>,
        settings: Settings,
        camera: Pinhole,
        scene: VirtualScene,
    ) -> Result<Self, PipelineError> {
        shared::check_camera(&camera)?;
        let size = camera.size();
        let view = View::perspective(camera, Pose::identity());
        let step = grid_step(&settings.transfer);
        Ok(Self {
            clock: StageClock::new(&gpu)?,
            input: InputPass::new(&gpu, &settings.input)?,
            tracker: GpuTracker::new(&gpu, &settings.tracking, camera)?,
            caster: RayCaster::new(&gpu, size)?,
            dyn_geo: DynGeoPass::new(&gpu, &settings.dyn_geo, size)?,
            radiance_transfer: GpuTransferStage::new(&gpu, &settings, size)?,
            samples: samples_pass(&gpu, &settings, size)?,
            estimator: LightEstimator::new(&settings.light),
            compositor: CompositingPass::new(&gpu, &settings.compositing, size, step)?,
            rasteriser: RasterPass::new(&gpu)?,
            last: FrameBuffers::new(&gpu, &settings, view)?,
            composed: Image::new(size, [0; 3]),
            map: None,
            origin: None,
            given_light: None,
            light: None,
            last_pose: None,
            composed_last: false,
            traffic: TrafficOfFrames::default(),
            scene,
            camera,
            settings,
            gpu,
        })
    }

    /// As [`Pipeline::reconfigure`](super::Pipeline::reconfigure).
    pub fn reconfigure(&mut self, settings: Settings) -> Result<(), PipelineError> {
        let (gpu, size, old) = (self.gpu.clone(), self.camera.size(), &self.settings);
        shared::may_change(old, &settings)?;
        let other_grid = (settings.transfer.bands, grid_step(&settings.transfer))
            != (old.transfer.bands, grid_step(&old.transfer));
        if (&settings.transfer, &settings.bounce) != (&old.transfer, &old.bounce) {
            self.radiance_transfer = GpuTransferStage::new(&gpu, &settings, size)?;
        }
        if settings.dyn_geo != old.dyn_geo {
            self.dyn_geo = DynGeoPass::new(&gpu, &settings.dyn_geo, size)?;
        }
        if other_grid || settings.compositing != old.compositing {
            let step = grid_step(&settings.transfer);
            self.compositor = CompositingPass::new(&gpu, &settings.compositing, size, step)?;
        }
        if other_grid {
            self.last.maps = TransferMaps::new(&gpu, &settings, size)?;
        }
        if other_grid || settings.light != old.light {
            let renewed = samples_pass(&gpu, &settings, size)?;
            self.samples.replace_by(renewed);
        }
        if let (Some(map), true) = (&mut self.map, settings.surface != old.surface) {
            map.surface.reconfigure(&gpu, &settings.surface)?;
        }
        self.estimator.reconfigure(&settings.light, settings.transfer.bands);
        self.composed_last = false;
        self.settings = settings;
        Ok(())
    }

    /// As [`Pipeline::set_light`](super::Pipeline::set_light).
    pub fn set_light(&mut self, light: Option<ShLight>) {
        let bands = self.settings.transfer.bands;
        self.given_light = light.map(|light| shared::with_bands(light, bands));
    }
}
