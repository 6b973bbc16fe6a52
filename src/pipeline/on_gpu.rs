//! [`Pipeline`] with its stages on the GPU: the same order, and the same state from frame to frame.
//!
//! A frame is uploaded once. What comes back are the sums of the alignment, counters, samples for the light,
//! which is fitted on the host, and the composed picture.
//!
//! What differs: whether virtual objects change the picture is decided by where they may be seen and not by
//! counted pixels, which spares a wait; the picture is the same.

mod clock;
mod hand_over;
mod merged;
#[cfg(test)]
mod tests;
mod transfer;

use super::{Backend, BackendRecord, FrameOutcome, FrameTraffic, Pipeline, PipelineError};
use super::{WorldOrigin, shared};
use crate::capture::{RawFrame, RgbdFrame};
use crate::config::Settings;
use crate::fusion::Lattice;
use crate::gpu::stages::*;
use crate::gpu::{Commands, Gpu, GpuError, GpuGBuffer, Traffic};
use crate::image::{Image, Size};
use crate::lighting::exitant::DominantLight;
use crate::lighting::{LightEstimate, LightEstimator, ShLight};
use crate::math::{Pinhole, Pose, View};
use crate::mesh::TriangleMesh;
use crate::scene::VirtualScene;
use crate::timing::{Stage, StageTimes};
use crate::tracking::{FrameTag, Tracking, TrackingState};
use crate::transfer::TransferMethod;
use clock::StageClock;
use merged::{MergedMain, MergedSides};
use std::sync::Arc;
use std::time::Instant;
use transfer::{GpuTransferStage, MergedScene, RealScene, grid_step};

/// The map of the room; it exists from the first fused frame on.
struct Map {
    volume: GpuVolume,
    surface: SurfacePass,
    /// The auxiliary buffers of `surface` with virtual objects.
    sides: MergedSides,
}

/// All stages, and the state carried between frames.
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
    rasteriser: RasterPass,
    compositor: CompositingPass,
    last: FrameBuffers,
    composed: Image<[u8; 3]>,
    traffic: TrafficOfFrames,
}

/// Everything that is known about the newest frame.
struct FrameBuffers {
    frame: FramePictures,
    /// G_r, the filtered geometry buffer.
    real: GpuGBuffer,
    merged: MergedMain,
    maps: TransferMaps,
    picture: GpuPicture,
    read_back: PictureReadBack,
}

/// Counted from the second frame on: the first brings tables, models, and the place of the volume.
#[derive(Default)]
struct TrafficOfFrames {
    after_first: Option<Traffic>,
    newest: Traffic,
    frames: u64,
    pictures: u64,
}

impl TrafficOfFrames {
    fn end_frame(&mut self, gpu: &Gpu) {
        self.newest = gpu.traffic();
        if self.after_first.is_some() {
            self.frames += 1;
        } else {
            self.after_first = Some(self.newest);
            self.pictures = 0;
        }
    }

    fn of_a_frame(&self, picture: Size) -> Option<FrameTraffic> {
        let moved = self.newest.since(self.after_first?);
        let mean = |bytes: u64| bytes.checked_div(self.frames);
        Some(FrameTraffic {
            uploaded: mean(moved.uploaded)?,
            read_back: mean(moved.read_back)?,
            picture: mean(self.pictures * 3 * picture.pixels() as u64)?,
        })
    }
}

/// On one grid.
struct TransferMaps {
    real: GpuTransferMap,
    merged: GpuTransferMap,
    indirect: GpuIndirectMap,
}

impl TransferMaps {
    fn new(gpu: &Gpu, settings: &Settings, image: Size) -> Result<Self, GpuError> {
        let (bands, step) = (settings.transfer.bands, grid_step(&settings.transfer));
        Ok(Self {
            real: GpuTransferMap::new(gpu, bands, step, image)?,
            merged: GpuTransferMap::new(gpu, bands, step, image)?,
            indirect: GpuIndirectMap::new(gpu, step, image)?,
        })
    }
}

fn samples_pass(gpu: &Gpu, settings: &Settings, size: Size) -> Result<LightSamplesPass, GpuError> {
    let (bands, step) = (settings.transfer.bands, grid_step(&settings.transfer));
    LightSamplesPass::new(gpu, &settings.light, size, bands, step)
}

impl GpuPipeline {
    /// As [`Pipeline::new`].
    pub fn new(
        gpu: Arc<Gpu>,
        settings: Settings,
        camera: Pinhole,
        scene: VirtualScene,
    ) -> Result<Self, PipelineError> {
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
            last: FrameBuffers {
                frame: FramePictures::new(&gpu, size)?,
                real: GpuGBuffer::empty(&gpu, view)?,
                merged: MergedMain::new(&gpu, view)?,
                maps: TransferMaps::new(&gpu, &settings, size)?,
                picture: GpuPicture::new(&gpu, size)?,
                read_back: PictureReadBack::new(&gpu, size)?,
            },
            composed: Image::new(size, [0; 3]),
            map: None,
            origin: None,
            given_light: None,
            light: None,
            last_pose: None,
            traffic: TrafficOfFrames::default(),
            scene,
            camera,
            settings,
            gpu,
        })
    }

    /// As [`Pipeline::reconfigure`].
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
        self.settings = settings;
        Ok(())
    }

    /// Runs one frame through all stages. `times` already holds what reading the frame took.
    pub fn process(
        &mut self,
        raw: &RawFrame,
        mut times: StageTimes,
    ) -> Result<FrameOutcome, PipelineError> {
        let (start, before) = (Instant::now(), times.update());
        let origin = shared::local_world(&mut self.origin, &mut self.scene, raw.world_from_camera);
        let recorded_pose = raw.world_from_camera.map(|pose| origin.local_from_world(&pose));
        let tag = FrameTag { index: raw.index, recorded_pose };

        self.clock.start();
        self.take_in(raw, &mut times)?;
        let tracking = self.track(tag, &mut times)?;
        let view = View::perspective(self.camera, tracking.world_from_camera);

        let gpu = self.gpu.clone();
        let mut commands = self.clock.begin(&gpu);
        self.fuse(&mut commands, raw.index, &tracking, &view)?;
        self.clock.end_stage(&mut commands, Stage::Reconstruct, &mut times)?;
        let light = match (&self.map, tracking.state) {
            (Some(_), TrackingState::Init | TrackingState::Tracking | TrackingState::Degraded) => {
                Some(self.light_the_scene(commands, raw, view, &mut times)?)
            }
            _ => {
                self.clock.finish(commands, Stage::Reconstruct, &mut times)?;
                self.show_camera(raw);
                None
            }
        };
        let composed = light.is_some();
        let bands = self.settings.transfer.bands;
        let light = light.unwrap_or_else(|| self.estimator.without_surface(&view, bands));
        self.light = Some(light.clone());
        self.last_pose = Some(tracking.world_from_camera);
        self.traffic.end_frame(&self.gpu);
        let outcome = FrameOutcome {
            index: raw.index,
            timestamp_s: raw.timestamp_s,
            tracking,
            recorded_pose: raw.world_from_camera,
            light,
            composed,
            times,
            duration: before + start.elapsed(),
            volume_bytes: self.map.as_ref().map_or(0, |m| m.volume.memory_bytes()),
        };
        Ok(outcome.in_recordings_world(&origin))
    }

    /// Uploads and filters the frame.
    fn take_in(&mut self, raw: &RawFrame, times: &mut StageTimes) -> Result<(), PipelineError> {
        let gpu = self.gpu.clone();
        if raw.color.size() != self.last.frame.size {
            self.last.frame = FramePictures::new(&gpu, raw.color.size())?;
        }
        let mut commands = self.clock.begin(&gpu);
        let (input, frame) = (&self.input, &self.last.frame);
        self.clock.on_host(Stage::Input, times, || input.run(&mut commands, raw, frame))?;
        Ok(self.clock.finish(commands, Stage::Input, times)?)
    }

    /// Camera pose.
    fn track(&mut self, tag: FrameTag, times: &mut StageTimes) -> Result<Tracking, PipelineError> {
        let (tracker, frame, caster) = (&mut self.tracker, &self.last.frame, &mut self.caster);
        let (gpu, map) = (&*self.gpu, self.map.as_ref());
        let model = map.map(|m| &m.surface.main);
        let tracking = self.clock.on_host(Stage::Reconstruct, times, || {
            tracker.track(gpu, tag, frame, model, &mut |commands, view, out| match map {
                Some(map) => caster.cast(commands, &map.volume, view, out),
                None => {
                    out.view = *view;
                    commands.clear(out.surface.buffer());
                    commands.clear(out.origin.buffer());
                    Ok(())
                }
            })
        })?;
        if shared::begins_anew(&self.settings.tracking, &tracking, tag.index)? {
            self.map = None;
            self.tracker.reset(tracking.world_from_camera);
        }
        Ok(tracking)
    }

    /// Integrates a well tracked frame into V.
    fn fuse(
        &mut self,
        commands: &mut Commands<'_>,
        index: usize,
        tracking: &Tracking,
        view: &View,
    ) -> Result<(), PipelineError> {
        if !tracking.may_fuse() {
            return Ok(());
        }
        if self.map.is_none() {
            self.map = self.start_map(view)?;
        }
        if let Some(map) = &mut self.map {
            map.volume.integrate(commands, &self.last.frame, index, view)?;
        }
        Ok(())
    }

    /// Places V by the settings or from what this frame sees; none where it sees nothing.
    fn start_map(&self, view: &View) -> Result<Option<Map>, PipelineError> {
        let (gpu, pictures) = (&self.gpu, &self.last.frame);
        let depth_m = pictures.depth_m.buffer().download(gpu)?;
        let depth_m = Image::from_vec(pictures.size, depth_m);
        let frame = RgbdFrame { depth_m, ..RgbdFrame::default() };
        let centre = shared::map_centre(&self.settings, self.origin.as_ref(), &frame, view);
        let Some(centre) = centre else { return Ok(None) };
        let Settings { volume: params, surface, .. } = &self.settings;
        let volume = GpuVolume::new(gpu, params, Lattice::new(params, centre)?)?;
        let surface = SurfacePass::new(gpu, &volume, *view, surface)?;
        Ok(Some(Map { volume, surface, sides: MergedSides::default() }))
    }

    /// From the model seen in this frame's view to the composed picture.
    fn light_the_scene(
        &mut self,
        mut commands: Commands<'_>,
        raw: &RawFrame,
        view: View,
        times: &mut StageTimes,
    ) -> Result<LightEstimate, PipelineError> {
        self.transfer_light(&mut commands, view, times)?;
        self.clock.finish(commands, Stage::LightEst, times)?;
        let at = shared::light_point(&self.settings, self.origin.as_ref(), &self.scene);
        let light = self.estimate(at, &view, times)?;

        let gpu = self.gpu.clone();
        let mut commands = self.clock.begin(&gpu);
        let changed = self.draw_objects(&mut commands, raw.index)?;
        self.clock.end_stage(&mut commands, Stage::Rendering, times)?;
        if changed {
            self.light_objects(&mut commands, &light.light)?;
            self.clock.end_stage(&mut commands, Stage::RadTransfer, times)?;
            self.compose(&mut commands, &light.light)?;
        }
        self.clock.finish(commands, Stage::Rendering, times)?;
        if !changed {
            self.show_camera(raw);
        } else if let Some(picture) = self.last.read_back.take(&gpu)? {
            self.composed = picture;
            self.traffic.pictures += 1;
        }
        Ok(light)
    }

    /// G_v, G_r, transfer of the real scene, and samples for the light.
    fn transfer_light(
        &mut self,
        commands: &mut Commands<'_>,
        view: View,
        times: &mut StageTimes,
    ) -> Result<(), PipelineError> {
        let towards_light = self.light.as_ref().and_then(|l| l.light.dominant_direction());
        let Some(Map { volume, surface, .. }) = &mut self.map else { return Ok(()) };
        let FrameBuffers { frame, real, maps, .. } = &mut self.last;
        let clock = &mut self.clock;
        surface.update(commands, volume, view, towards_light)?;
        clock.end_stage(commands, Stage::Surface, times)?;
        self.dyn_geo.run(commands, frame, &surface.main, real)?;
        clock.end_stage(commands, Stage::DynGeo, times)?;
        let scene = RealScene { volume, buffers: (real, &surface.auxiliary) };
        self.radiance_transfer.transfer(commands, scene, &maps.real)?;
        clock.end_stage(commands, Stage::RadTransfer, times)?;
        if self.given_light.is_none() {
            self.samples.run(commands, frame, real, &maps.real)?;
        }
        Ok(())
    }

    /// The light, fitted on the host to the samples of this frame.
    fn estimate(
        &mut self,
        at: Option<glam::Vec3>,
        view: &View,
        times: &mut StageTimes,
    ) -> Result<LightEstimate, PipelineError> {
        if let Some(light) = &self.given_light {
            return Ok(LightEstimate::given(light.clone()));
        }
        let (gpu, samples, estimator) = (&*self.gpu, &mut self.samples, &mut self.estimator);
        let bands = self.settings.transfer.bands;
        let fitted =
            self.clock.on_host(Stage::LightEst, times, || samples.estimate(gpu, estimator, at))?;
        Ok(fitted.unwrap_or_else(|| estimator.without_surface(view, bands)))
    }

    /// Draws the virtual scene into all views; whether it may change the picture.
    fn draw_objects(
        &mut self,
        commands: &mut Commands<'_>,
        index: usize,
    ) -> Result<bool, PipelineError> {
        let Some(Map { surface, sides, .. }) = &mut self.map else { return Ok(false) };
        let FrameBuffers { real, merged, .. } = &mut self.last;
        let (rasteriser, scene) = (&mut self.rasteriser, &mut self.scene);
        if scene.waits_at(index) {
            scene.resolve(index, &real.download(&self.gpu)?);
        }
        match self.settings.transfer.method {
            TransferMethod::ImageSpace => {
                if !merged.may_show(scene, real) && !MergedSides::may_show(scene, surface) {
                    return Ok(false);
                }
                let in_main = merged.draw(commands, rasteriser, scene, real)?;
                let in_sides = sides.draw(commands, rasteriser, scene, surface)?;
                Ok(in_main || in_sides)
            }
            // rays meet objects that no view shows, and look at no side view
            TransferMethod::RayTraced => {
                merged.draw(commands, rasteriser, scene, real)?;
                Ok(scene.bounds().next().is_some())
            }
        }
    }

    /// Transfer and bounce with virtual objects.
    fn light_objects(
        &mut self,
        commands: &mut Commands<'_>,
        light: &ShLight,
    ) -> Result<(), PipelineError> {
        let Some(Map { volume, surface, sides }) = &mut self.map else { return Ok(()) };
        let FrameBuffers { frame, real, merged, maps, .. } = &mut self.last;
        let bounce = self.settings.bounce.enabled;
        if bounce {
            let light = DominantLight::of(light);
            let exitant = ExitantPass::new(light, self.settings.light.mean_albedo);
            merged.radiate(commands, &exitant, &frame.color)?;
            sides.radiate(commands, &exitant)?;
        }
        Ok(self.radiance_transfer.transfer_and_bounce(
            commands,
            RealScene { volume, buffers: (real, &surface.auxiliary) },
            MergedScene {
                objects: &self.scene,
                buffers: (&merged.buffer, &sides.buffers),
                radiance: bounce.then_some((&merged.radiance, &sides.radiance)),
            },
            &maps.real,
            &maps.merged,
            &maps.indirect,
        )?)
    }

    fn compose(
        &mut self,
        commands: &mut Commands<'_>,
        light: &ShLight,
    ) -> Result<(), PipelineError> {
        let FrameBuffers { frame, merged, maps, picture, read_back, .. } = &mut self.last;
        let input = GpuComposeInput {
            frame,
            merged: &merged.buffer,
            layer: &merged.layer,
            real_transfer: &maps.real,
            merged_transfer: &maps.merged,
            indirect: self.settings.bounce.enabled.then_some(&maps.indirect),
            light,
            mean_albedo: self.settings.light.mean_albedo,
        };
        self.compositor.run(commands, &input, picture)?;
        read_back.request(commands, picture);
        Ok(())
    }

    /// The camera's picture as it is.
    fn show_camera(&mut self, raw: &RawFrame) {
        self.composed.reshape(raw.color.size(), [0; 3]);
        self.composed.as_mut_slice().copy_from_slice(raw.color.as_slice());
    }

    /// As [`Pipeline::set_light`].
    pub fn set_light(&mut self, light: Option<ShLight>) {
        let bands = self.settings.transfer.bands;
        self.given_light = light.map(|light| shared::with_bands(light, bands));
    }

    /// The composed picture of the last frame.
    pub fn composed(&self) -> &Image<[u8; 3]> {
        &self.composed
    }

    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The light of the last frame.
    pub fn light(&self) -> Option<&LightEstimate> {
        self.light.as_ref()
    }

    /// As [`Pipeline::mesh`]; the volume comes back for it.
    pub fn mesh(&self) -> Result<TriangleMesh, PipelineError> {
        let mesh = self.map.as_ref().map(|m| m.volume.mesh(&self.gpu)).transpose()?;
        Ok(shared::mesh_in_world(mesh.unwrap_or_default(), self.origin.as_ref()))
    }

    /// What computes, and what the frames so far have moved.
    pub fn record(&self) -> BackendRecord {
        BackendRecord {
            name: "gpu".to_owned(),
            adapter: Some(self.gpu.summary().to_string()),
            clock: self.clock.name().to_owned(),
            traffic: self.traffic.of_a_frame(self.camera.size()),
            handovers: Vec::new(),
        }
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
}

impl Backend for GpuPipeline {
    fn process(&mut self, raw: RawFrame, times: StageTimes) -> Result<FrameOutcome, PipelineError> {
        self.process(&raw, times)
    }

    fn reconfigure(&mut self, settings: Settings) -> Result<(), PipelineError> {
        self.reconfigure(settings)
    }

    fn composed(&self) -> &Image<[u8; 3]> {
        self.composed()
    }

    fn settings(&self) -> &Settings {
        self.settings()
    }

    fn light(&self) -> Option<&LightEstimate> {
        self.light()
    }

    fn mesh(&self) -> Result<TriangleMesh, PipelineError> {
        self.mesh()
    }

    fn record(&self) -> BackendRecord {
        self.record()
    }

    fn on_host(&self) -> Option<&Pipeline> {
        None
    }
}
