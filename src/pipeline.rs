//! The order of the stages and what lives from frame to frame; nothing else.

mod backend;
mod buffers;
#[cfg(feature = "gpu")]
mod fallback;
mod inspect;
mod merged;
#[cfg(feature = "gpu")]
mod on_gpu;
mod origin;
mod shared;
#[cfg(test)]
mod tests;

pub use backend::{Backend, BackendRecord, FrameTraffic, Handover};
pub use buffers::{Buffer, BufferValues};
#[cfg(feature = "gpu")]
pub use fallback::{OpenDevice, WithFallback};
pub use inspect::{ObjectBuffers, StageBuffers};
#[cfg(feature = "gpu")]
pub use on_gpu::GpuPipeline;
pub use origin::{FARTHEST_M, WorldOrigin};

use crate::capture::{InputStage, RawFrame, RgbdFrame};
use crate::compositing::{ComposeInput, CompositingStage, ShadingBuffers};
use crate::config::Settings;
use crate::fusion::{SurfaceStage, TsdfVolume};
use crate::geometry::{DynGeo, GBuffer};
use crate::image::{Image, Size};
use crate::lighting::{LightEstimate, LightEstimator, ShLight};
use crate::math::{Pinhole, Pose, View};
use crate::mesh::TriangleMesh;
use crate::scene::{Rasteriser, VirtualScene};
use crate::timing::{Stage, StageTimes};
use crate::tracking::{Tracker, Tracking, TrackingState};
use crate::transfer::{
    IndirectMap, MergedScene, RealScene, TransferMap, TransferMethod, TransferStage,
};
use merged::{MergedMain, MergedSides, Reflection};
use std::time::{Duration, Instant};

#[derive(Debug, thiserror::Error)]
pub enum PipelineError {
    #[error("{section} cannot change while the pipeline runs: it would lose the map or the camera")]
    Fixed { section: &'static str },
    #[error("frame {frame}: the camera is lost ({reason}) and tracking.on_lost is \"stop\"")]
    Lost { frame: usize, reason: String },
    #[error("the camera {0}")]
    Camera(String),
    #[error("frame {frame}: colour is {color}, depth {depth}; both must be pictures of one camera")]
    Pictures { frame: usize, color: Size, depth: Size },
    #[error(transparent)]
    Volume(#[from] crate::fusion::FusionError),
    #[error(transparent)]
    Transfer(#[from] crate::transfer::TransferError),
    #[cfg(feature = "gpu")]
    #[error(transparent)]
    Gpu(#[from] crate::gpu::GpuError),
}

/// What one frame gave. Poses are in the recording's world.
#[derive(Clone, Debug)]
pub struct FrameOutcome {
    pub index: usize,
    pub timestamp_s: f64,
    pub tracking: Tracking,
    pub recorded_pose: Option<Pose>,
    pub light: LightEstimate,
    /// Whether virtual objects were composed: not where the camera is lost.
    pub composed: bool,
    pub times: StageTimes,
    /// From asking for the frame to having its result, what lies between the stages included.
    pub duration: Duration,
    pub volume_bytes: usize,
}

impl FrameOutcome {
    /// From local coordinates to those of the recording.
    fn in_recordings_world(mut self, origin: &WorldOrigin) -> Self {
        self.tracking.world_from_camera = origin.world_from_local(&self.tracking.world_from_camera);
        let offset = glam::DVec3::from(origin.offset()).as_vec3();
        self.light.field = self.light.field.translated(offset);
        self
    }
}

/// The map of the room; it exists from the first fused frame on.
struct Map {
    volume: TsdfVolume,
    surface: SurfaceStage,
    /// The auxiliary buffers of `surface` with virtual objects.
    sides: MergedSides,
}

/// All stages, and the state carried between frames.
pub struct Pipeline {
    settings: Settings,
    camera: Pinhole,
    origin: Option<WorldOrigin>,
    scene: VirtualScene,
    input: InputStage,
    tracker: Tracker,
    map: Option<Map>,
    dyn_geo: DynGeo,
    radiance_transfer: TransferStage,
    estimator: LightEstimator,
    /// Stands in for the estimate where it is set.
    given_light: Option<ShLight>,
    /// Of the last frame.
    light: Option<LightEstimate>,
    composed_last: bool,
    rasteriser: Rasteriser,
    compositor: CompositingStage,
    last: FrameBuffers,
    composed: Image<[u8; 3]>,
}

/// Everything that is known about the newest frame before it is composed.
struct FrameBuffers {
    frame: RgbdFrame,
    /// G_r, the filtered geometry buffer.
    real: GBuffer,
    merged: MergedMain,
    real_transfer: TransferMap,
    /// Whether virtual objects change anything; where not, the two maps below are those of an earlier frame.
    changed: bool,
    merged_transfer: TransferMap,
    indirect: IndirectMap,
}

impl Pipeline {
    /// `settings` must have been validated; `camera` is that of every frame to come.
    pub fn new(
        settings: Settings,
        camera: Pinhole,
        scene: VirtualScene,
    ) -> Result<Self, PipelineError> {
        shared::check_camera(&camera)?;
        let view = View::perspective(camera, Pose::identity());
        Ok(Self {
            input: InputStage::new(&settings.input),
            tracker: Tracker::new(&settings.tracking, camera),
            dyn_geo: DynGeo::new(&settings.dyn_geo),
            radiance_transfer: TransferStage::new(&settings.transfer, &settings.bounce)?,
            estimator: LightEstimator::new(&settings.light),
            compositor: CompositingStage::new(&settings.compositing),
            rasteriser: Rasteriser::default(),
            last: FrameBuffers {
                frame: RgbdFrame::default(),
                real: GBuffer::empty(view),
                merged: MergedMain::default(),
                real_transfer: TransferMap::default(),
                changed: false,
                merged_transfer: TransferMap::default(),
                indirect: IndirectMap::default(),
            },
            composed: Image::new(camera.size(), [0; 3]),
            map: None,
            origin: None,
            given_light: None,
            light: None,
            composed_last: false,
            scene,
            camera,
            settings,
        })
    }

    /// Takes other settings from the next frame on; map, camera and, where bands and channels stay,
    /// the light's memory are kept. Refuses other `input`, `tracking` and `volume`, and then
    /// changes nothing. `settings` must have been validated.
    ///
    /// The composed picture stays; the newest frame's buffers ([`Self::geometry`],
    /// [`Self::shading`]) are gone until the next frame.
    pub fn reconfigure(&mut self, settings: Settings) -> Result<(), PipelineError> {
        let old = &self.settings;
        shared::may_change(old, &settings)?;
        if (&settings.transfer, &settings.bounce) != (&old.transfer, &old.bounce) {
            self.radiance_transfer = TransferStage::new(&settings.transfer, &settings.bounce)?;
        }
        if settings.dyn_geo != old.dyn_geo {
            self.dyn_geo = DynGeo::new(&settings.dyn_geo);
        }
        if settings.compositing != old.compositing {
            self.compositor = CompositingStage::new(&settings.compositing);
        }
        if let (Some(map), true) = (&mut self.map, settings.surface != old.surface) {
            map.surface.reconfigure(&settings.surface);
        }
        self.estimator.reconfigure(&settings.light, settings.transfer.bands);
        self.composed_last = false;
        self.settings = settings;
        Ok(())
    }

    /// Runs one frame through all stages. `times` already holds what reading the frame took.
    pub fn process(
        &mut self,
        mut raw: RawFrame,
        mut times: StageTimes,
    ) -> Result<FrameOutcome, PipelineError> {
        let (start, before) = (Instant::now(), times.update());
        shared::check_frame(&raw)?;
        let origin = shared::local_world(
            &mut self.origin,
            &mut self.scene,
            raw.world_from_camera,
            self.settings.tracking.mode,
        );
        let pose_in_world = raw.world_from_camera.take();
        raw.world_from_camera = pose_in_world.and_then(|pose| origin.local_camera(&pose));
        let recorded_pose = pose_in_world.filter(|_| raw.world_from_camera.is_some());

        times.measure(Stage::Input, || self.input.prepare(raw, &mut self.last.frame));
        let tracking = times.measure(Stage::Reconstruct, || self.reconstruct())?;
        let view = View::perspective(self.camera, tracking.world_from_camera);

        let towards_light = self.light.as_ref().and_then(|l| l.light.dominant_direction());
        let light = match (&mut self.map, tracking.state) {
            (
                Some(map),
                TrackingState::Init | TrackingState::Tracking | TrackingState::Degraded,
            ) => {
                times.measure(Stage::Surface, || {
                    map.surface.update(&map.volume, view, towards_light)
                });
                self.light_the_scene(&mut times)
            }
            _ => {
                self.show_camera();
                None
            }
        };
        let composed = light.is_some();
        self.composed_last = composed;
        let bands = self.settings.transfer.bands;
        let light = light.unwrap_or_else(|| self.estimator.without_surface(&view, bands));
        self.light = Some(light.clone());
        let outcome = FrameOutcome {
            index: self.last.frame.index,
            timestamp_s: self.last.frame.timestamp_s,
            tracking,
            recorded_pose,
            light,
            composed,
            times,
            duration: before + start.elapsed(),
            volume_bytes: self.map.as_ref().map_or(0, |m| m.volume.memory_bytes()),
        };
        Ok(outcome.in_recordings_world(&origin))
    }

    /// Camera pose, and integration of well tracked frames into V.
    fn reconstruct(&mut self) -> Result<Tracking, PipelineError> {
        let model = self.map.as_ref().map(|m| &m.surface.main);
        let map = self.map.as_ref();
        let tracking = self.tracker.track(&self.last.frame, model, &mut |view, out| match map {
            Some(map) => map.volume.raycast(view, out),
            None => out.set_view(*view),
        });
        let params = &self.settings.tracking;
        if shared::begins_anew(params, &tracking, self.last.frame.index)? {
            self.map = None;
            self.tracker.reset(tracking.world_from_camera);
        }
        if tracking.may_fuse() {
            let view = View::perspective(self.camera, tracking.world_from_camera);
            if self.map.is_none() {
                self.map = self.start_map(&view)?;
            }
            if let Some(map) = &mut self.map {
                map.volume.integrate(&self.last.frame, &view)?;
            }
        }
        Ok(tracking)
    }

    /// Places V by the settings or from what this frame sees; none where it sees nothing.
    fn start_map(&self, view: &View) -> Result<Option<Map>, PipelineError> {
        let origin = self.origin.as_ref();
        let centre = shared::map_centre(&self.settings, origin, &self.last.frame, view);
        let Some(centre) = centre else { return Ok(None) };
        let volume = TsdfVolume::new(&self.settings.volume, centre)?;
        let surface = SurfaceStage::new(&volume, *view, &self.settings.surface);
        Ok(Some(Map { volume, surface, sides: MergedSides::default() }))
    }

    /// From the model seen in this frame's view to the composed picture.
    fn light_the_scene(&mut self, times: &mut StageTimes) -> Option<LightEstimate> {
        let Map { volume, surface, .. } = self.map.as_ref()?;
        let FrameBuffers { frame, real, real_transfer, .. } = &mut self.last;

        times.measure(Stage::DynGeo, || self.dyn_geo.run(frame, &surface.main, real));
        times.measure(Stage::RadTransfer, || {
            let scene = RealScene { volume, main: real, auxiliary: &surface.auxiliary };
            self.radiance_transfer.transfer(scene, real_transfer);
        });
        let at = shared::light_point(&self.settings, self.origin.as_ref(), &self.scene);
        let light = times.measure(Stage::LightEst, || match &self.given_light {
            Some(light) => LightEstimate::given(light.clone()),
            None => self.estimator.estimate(frame, real, real_transfer, at),
        });

        self.last.changed = times.measure(Stage::Rendering, || self.draw_objects());
        if self.last.changed {
            times.measure(Stage::RadTransfer, || self.light_objects(&light.light));
        }
        times.measure(Stage::Rendering, || self.compose(&light.light));
        Some(light)
    }

    /// Draws the virtual scene into all views; whether it can change the picture.
    fn draw_objects(&mut self) -> bool {
        let Some(Map { surface, sides, .. }) = &mut self.map else { return false };
        let FrameBuffers { frame, real, merged, .. } = &mut self.last;
        let (rasteriser, scene) = (&mut self.rasteriser, &mut self.scene);
        scene.resolve(frame.index, real);
        let in_main = merged.draw(rasteriser, scene, real);
        match self.settings.transfer.method {
            TransferMethod::ImageSpace => {
                let drawn = in_main || MergedSides::may_show(scene, surface);
                let in_sides = drawn && sides.draw(rasteriser, scene, surface);
                in_main || in_sides
            }
            // rays meet objects that no view shows, and look at no side view
            TransferMethod::RayTraced => scene.bounds().next().is_some(),
        }
    }

    /// Transfer and bounce with virtual objects.
    fn light_objects(&mut self, light: &ShLight) {
        let Some(Map { volume, surface, sides }) = &mut self.map else { return };
        let FrameBuffers { frame, real, merged, real_transfer, merged_transfer, indirect, .. } =
            &mut self.last;
        let bounce = self.settings.bounce.enabled;
        if bounce {
            let reflection = Reflection::of(light, self.settings.light.mean_albedo);
            merged.radiate(real, &frame.color, reflection);
            sides.radiate(reflection);
        }
        let with_virtual = MergedScene {
            objects: &self.scene,
            main: merged.buffer(real),
            auxiliary: &sides.buffers,
            radiance: bounce.then_some((&merged.radiance, &sides.radiance)),
        };
        self.radiance_transfer.transfer_and_bounce(
            RealScene { volume, main: real, auxiliary: &surface.auxiliary },
            with_virtual,
            real_transfer,
            merged_transfer,
            indirect,
        );
    }

    /// The camera's picture as it is.
    fn show_camera(&mut self) {
        let picture = &self.last.frame.color_srgb;
        self.composed.reshape(picture.size(), [0; 3]);
        self.composed.as_mut_slice().copy_from_slice(picture.as_slice());
    }

    fn compose(&mut self, light: &ShLight) {
        if self.last.changed {
            let input = self.last.compose_input(&self.settings, light);
            self.compositor.compose(&input, &mut self.composed);
        } else {
            self.show_camera();
        }
    }

    /// From the next frame on, composes under this light, which is times the scene's mean albedo as an
    /// estimate is, instead of the estimated one; `None` estimates again. Bands beyond those of the
    /// transfer are dropped.
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

    /// The newest frame after the Input stage.
    pub fn frame(&self) -> &RgbdFrame {
        &self.last.frame
    }

    /// G_v: the model in the newest view.
    pub fn model(&self) -> Option<&GBuffer> {
        self.map.as_ref().map(|m| &m.surface.main)
    }

    /// G_r, and the same with virtual objects; `None` where the newest frame was not composed.
    pub fn geometry(&self) -> Option<(&GBuffer, &GBuffer)> {
        let FrameBuffers { real, merged, .. } = &self.last;
        self.composed_last.then(|| (real, merged.buffer(real)))
    }

    /// Transfer of G_r; `None` where the newest frame was not composed.
    pub fn transfer(&self) -> Option<&TransferMap> {
        self.composed_last.then_some(&self.last.real_transfer)
    }

    /// R and R' of the newest frame at full resolution. Computed anew: for looking, not for speed.
    pub fn shading(&self) -> Option<ShadingBuffers> {
        let light = self.light.as_ref().filter(|_| self.composed_last)?;
        let input = self.last.compose_input(&self.settings, &light.light);
        Some(self.compositor.clone().shading_buffers(&input))
    }

    /// The reconstructed surface in the recording's world; empty before the first fused frame.
    pub fn mesh(&self) -> TriangleMesh {
        let mesh = self.map.as_ref().map(|m| m.volume.mesh()).unwrap_or_default();
        shared::mesh_in_world(mesh, self.origin.as_ref())
    }
}

impl FrameBuffers {
    fn compose_input<'a>(&'a self, settings: &Settings, light: &'a ShLight) -> ComposeInput<'a> {
        let bounce = settings.bounce.enabled && self.changed;
        ComposeInput {
            frame: &self.frame,
            real: &self.real,
            merged: self.merged.buffer(&self.real),
            layer: &self.merged.layer,
            real_transfer: &self.real_transfer,
            merged_transfer: if self.changed { &self.merged_transfer } else { &self.real_transfer },
            indirect: bounce.then_some(&self.indirect),
            light,
            mean_albedo: settings.light.mean_albedo,
        }
    }
}
