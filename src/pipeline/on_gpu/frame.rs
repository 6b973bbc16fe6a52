//! The order of the stages in a frame, and what the host waits for.
//!
//! ```text
//! upload, input, pyramid, sums ─> solve ─> sums ─> ... ─> solve            every iteration waits
//!   ─> fusion, surface, DynGeo, transfer, samples ─> light, fitted on the host   waits for the samples
//!   ─> objects drawn, and transfer that needs no light: while the host fits
//!   ─> exitant light, bounce, composed picture ─> read back                      waits for the picture
//! ```

use super::GpuPipeline;
use super::buffers::{FrameBuffers, Map};
use super::merged::MergedSides;
use super::transfer::{MergedScene, RealScene};
use crate::capture::{RawFrame, RgbdFrame};
use crate::fusion::Lattice;
use crate::gpu::Commands;
use crate::gpu::stages::{ExitantPass, FramePictures, GpuVolume, SurfacePass, TrackedFrame};
use crate::image::Image;
use crate::lighting::exitant::DominantLight;
use crate::lighting::{LightEstimate, ShLight};
use crate::math::{Pose, View};
use crate::pipeline::{FrameOutcome, PipelineError, shared};
use crate::timing::{Stage, StageTimes};
use crate::tracking::{DEPTH_RANGE_M, FrameTag, Tracking, TrackingState};
use crate::transfer::TransferMethod;
use std::time::Instant;

impl GpuPipeline {
    /// Runs one frame through all stages. `times` already holds what reading the frame took.
    pub fn process(
        &mut self,
        raw: &RawFrame,
        mut times: StageTimes,
    ) -> Result<FrameOutcome, PipelineError> {
        let (start, before) = (Instant::now(), times.update());
        shared::check_frame(raw)?;
        let origin = shared::local_world(
            &mut self.origin,
            &mut self.scene,
            raw.world_from_camera,
            self.settings.tracking.mode,
        );
        let recorded_pose = raw.world_from_camera.and_then(|pose| origin.local_camera(&pose));

        let gpu = self.gpu.clone();
        self.traffic.start_frame(&gpu);
        let mut commands = self.clock.start(&gpu);
        self.take_in(&mut commands, raw, &mut times)?;
        let tracking = self.track(&mut commands, raw, recorded_pose, &mut times)?;
        let view = View::perspective(self.camera, tracking.world_from_camera);
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
        self.composed_last = composed;
        let bands = self.settings.transfer.bands;
        let light = light.unwrap_or_else(|| self.estimator.without_surface(&view, bands));
        self.light = Some(light.clone());
        self.last_pose = Some(tracking.world_from_camera);
        self.traffic.end_frame(&gpu, std::mem::take(&mut self.last.picture_bytes));
        let outcome = FrameOutcome {
            index: raw.index,
            timestamp_s: raw.timestamp_s,
            tracking,
            recorded_pose: raw.world_from_camera.filter(|_| recorded_pose.is_some()),
            light,
            composed,
            times,
            duration: before + start.elapsed(),
            volume_bytes: self.map.as_ref().map_or(0, |m| m.volume.memory_bytes()),
        };
        Ok(outcome.in_recordings_world(&origin))
    }

    /// Uploads and filters the frame.
    fn take_in(
        &mut self,
        commands: &mut Commands<'_>,
        raw: &RawFrame,
        times: &mut StageTimes,
    ) -> Result<(), PipelineError> {
        if raw.color.size() != self.last.frame.size {
            self.last.frame = FramePictures::new(commands.gpu(), raw.color.size())?;
        }
        let (input, frame) = (&self.input, &self.last.frame);
        self.clock.on_host(Stage::Input, times, || input.run(commands, raw, frame))?;
        Ok(self.clock.end_stage(commands, Stage::Input, times)?)
    }

    /// Camera pose.
    fn track(
        &mut self,
        commands: &mut Commands<'_>,
        raw: &RawFrame,
        recorded_pose: Option<Pose>,
        times: &mut StageTimes,
    ) -> Result<Tracking, PipelineError> {
        let (tracker, caster, map) = (&mut self.tracker, &mut self.caster, self.map.as_ref());
        let frame = TrackedFrame {
            tag: FrameTag { index: raw.index, recorded_pose },
            pictures: &self.last.frame,
            depth_share: self.input.depth_share(&raw.depth_m, &DEPTH_RANGE_M),
        };
        let model = map.map(|m| &m.surface.main);
        let tracking = self.clock.tracking(commands, times, |commands| {
            tracker.track(commands, frame, model, &mut |commands, view, out| match map {
                Some(map) => caster.cast(commands, &map.volume, view, out),
                None => {
                    out.view = *view;
                    commands.clear(out.surface.buffer());
                    commands.clear(out.origin.buffer());
                    Ok(())
                }
            })
        })?;
        if shared::begins_anew(&self.settings.tracking, &tracking, raw.index)? {
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
            // the depth picture is looked at
            commands.flush()?;
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
        let (params, surface) = (&self.settings.volume, &self.settings.surface);
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
        let samples = self.clock.submit_stage(&mut commands, Stage::LightEst, times)?;
        let at = shared::light_point(&self.settings, self.origin.as_ref(), &self.scene);
        self.last.changed = self.prepare_objects(&mut commands, raw.index, times)?;
        self.clock.wait_for(&self.gpu, samples)?;
        let light = self.estimate(at, &view, times)?;

        if self.last.changed {
            if self.settings.bounce.enabled {
                self.light_objects(&mut commands, Some(&light.light))?;
                self.clock.end_stage(&mut commands, Stage::RadTransfer, times)?;
            }
            self.compose(&mut commands, &light.light)?;
        }
        self.clock.finish(commands, Stage::Rendering, times)?;
        if !self.last.changed {
            self.show_camera(raw);
        } else if let Some(picture) = self.last.read_back.take(&self.gpu)? {
            self.composed = picture;
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

    /// Hands the device all that virtual objects need before the light is known; whether they may change the
    /// picture.
    fn prepare_objects(
        &mut self,
        commands: &mut Commands<'_>,
        index: usize,
        times: &mut StageTimes,
    ) -> Result<bool, PipelineError> {
        if !self.draw_objects(commands, index)? {
            return Ok(false);
        }
        if self.settings.bounce.enabled {
            self.clock.submit_stage(commands, Stage::Rendering, times)?;
        } else {
            self.clock.end_stage(commands, Stage::Rendering, times)?;
            self.light_objects(commands, None)?;
            self.clock.submit_stage(commands, Stage::RadTransfer, times)?;
        }
        Ok(true)
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

    /// Transfer with virtual objects, and a bounce of `light`, where there is one.
    fn light_objects(
        &mut self,
        commands: &mut Commands<'_>,
        light: Option<&ShLight>,
    ) -> Result<(), PipelineError> {
        let Some(Map { volume, surface, sides }) = &mut self.map else { return Ok(()) };
        let FrameBuffers { frame, real, merged, maps, .. } = &mut self.last;
        if let Some(light) = light.map(DominantLight::of) {
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
                radiance: light.map(|_| (&merged.radiance, &sides.radiance[..])),
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
        let input = self.last.compose_input(&self.settings, light);
        self.compositor.run(commands, &input, &self.last.picture)?;
        let FrameBuffers { picture, read_back, picture_bytes, .. } = &mut self.last;
        *picture_bytes = read_back.request(commands, picture);
        Ok(())
    }

    /// The camera's picture as it is.
    fn show_camera(&mut self, raw: &RawFrame) {
        self.composed.reshape(raw.color.size(), [0; 3]);
        self.composed.as_mut_slice().copy_from_slice(raw.color.as_slice());
    }
}
