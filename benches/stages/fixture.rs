//! The demo sequence's first frames, fused; and its next frame, taken through all stages.

use kinlight::capture::{
    CaptureOptions, FrameSource, InputStage, RawFrame, RgbdFrame, open_sequence,
};
use kinlight::compositing::{ComposeInput, VirtualLayer};
use kinlight::config::Settings;
use kinlight::fusion::{SurfaceStage, TsdfVolume, place_centre};
use kinlight::geometry::{DynGeo, GBuffer};
use kinlight::image::Image;
use kinlight::lighting::exitant::{DominantLight, exitant_radiance};
use kinlight::lighting::{LightEstimate, LightEstimator};
use kinlight::math::{Pinhole, Pose, View};
use kinlight::scene::{Rasteriser, VirtualScene};
use kinlight::tracking::{Tracker, Tracking, TrackingParams};
use kinlight::transfer::{IndirectMap, RadianceTransfer, TransferMap};
use std::path::Path;
use std::sync::LazyLock;

/// Frames that the volume holds.
const FUSED: usize = 20;

/// Depth, normal and origin of a pixel.
pub const GBUFFER_BYTES: usize = 4 + 12 + 1;
/// Of a voxel: the distance; and that with weight and colour.
pub const TSDF_BYTES: usize = 2;
pub const VOXEL_BYTES: usize = 2 + 2 + 4;
const BLOCK_VOXELS: usize = 8 * 8 * 8;

/// Of a sample: its position x + r w in the view (6), its pixel (4), one comparison of depths.
pub const LOOK_UP_OPERATIONS: usize = 11;

pub static FIXTURE: LazyLock<Fixture> = LazyLock::new(Fixture::load);

pub struct Fixture {
    pub settings: Settings,
    pub camera: Pinhole,
    /// The volume before `frame`, as frames to fuse, so that each benchmark has its own.
    history: Vec<(RgbdFrame, View)>,
    pub raw: RawFrame,
    pub frame: RgbdFrame,
    pub view: View,
    /// The model as the frame before saw it, and as this one does.
    previous_model: GBuffer,
    pub model: GBuffer,
    pub scene: VirtualScene,
    pub stages: FrameStages,
    light: LightEstimate,
    lit: [LitStep; 2],
}

/// What the stages before the compositing made of the frame.
pub struct FrameStages {
    pub real: GBuffer,
    pub auxiliary: Vec<GBuffer>,
    pub merged: GBuffer,
    pub merged_auxiliary: Vec<GBuffer>,
    pub layer: VirtualLayer,
    pub radiance: Image<[f32; 3]>,
    pub auxiliary_radiance: Vec<Image<[f32; 3]>>,
}

/// Results of the transfer at one subsampling, and how many points they concern.
pub struct LitStep {
    pub real_transfer: TransferMap,
    merged_transfer: TransferMap,
    indirect: IndirectMap,
    pub points: usize,
    pub changed_points: usize,
}

impl Fixture {
    fn load() -> Self {
        let settings = Settings::default();
        let sequence = Path::new(env!("CARGO_MANIFEST_DIR")).join("sequences/demo");
        let mut source = open_sequence(&sequence, &CaptureOptions::default()).expect("the demo");
        let scene = VirtualScene::load(&sequence.join("scene.toml")).expect("the demo's object");
        let camera = source.camera();
        let mut next = || source.next_frame().expect("a readable frame").expect("enough frames");
        let history: Vec<_> = (0..FUSED).map(|_| prepared(&settings, camera, next())).collect();
        let raw = next();
        let (frame, view) = prepared(&settings, camera, raw.clone());

        let volume = fuse(&settings, &history);
        let mut previous_model = GBuffer::empty(view);
        volume.raycast(&history[FUSED - 1].1, &mut previous_model);
        let mut surface = SurfaceStage::new(&volume, history[0].1, &settings.surface);
        surface.update(&volume, view, None);
        let real = dyn_geo(&settings, &frame, &surface.main);
        let mut transfer = TransferMap::default();
        radiance_transfer(&settings, 1).transfer(&real, &surface.auxiliary, &mut transfer);
        let light = LightEstimator::new(&settings.light).estimate(&frame, &real, &transfer, None);
        assert!(light.valid(), "the demo's light: {:?}", light.rejection);
        surface.update(&volume, view, light.light.dominant_direction());
        let SurfaceStage { main: model, auxiliary, .. } = surface;
        let stages = FrameStages::new(&settings, &scene, &frame, &light, real, auxiliary);
        let lit = [1, 4].map(|step| LitStep::new(&settings, &stages, step));
        Self {
            settings,
            camera,
            history,
            raw,
            frame,
            view,
            previous_model,
            model,
            scene,
            stages,
            light,
            lit,
        }
    }

    pub fn pixels(&self) -> usize {
        self.view.size().pixels()
    }

    /// The volume that holds all frames before this one.
    pub fn fused(&self) -> TsdfVolume {
        fuse(&self.settings, &self.history)
    }

    /// Voxels of the blocks that the band around this frame's depth passes through.
    pub fn band_voxels(&self) -> usize {
        let centre = volume_centre(&self.settings, &self.history[0]);
        let mut alone = TsdfVolume::new(&self.settings.volume, centre).expect("valid settings");
        alone.integrate(&self.frame, &self.view).expect("a frame of the view's size");
        alone.allocated_blocks() * BLOCK_VOXELS
    }

    fn previous_pose(&self) -> Pose {
        self.previous_model.view.world_from_view
    }

    /// This frame's pose from that of the frame before.
    pub fn track(&self, tracker: &mut Tracker) -> Tracking {
        tracker.reset(self.previous_pose());
        tracker.track(&self.frame, Some(&self.previous_model), &mut |_, _| {
            unreachable!("the frame before shows the same place")
        })
    }

    /// Iterations at the finest level until the pose stands.
    pub fn finest_iterations(&self) -> usize {
        let pose = |finest: usize| {
            let mut params: TrackingParams = self.settings.tracking.clone();
            params.iterations[0] = finest;
            self.track(&mut Tracker::new(&params, self.camera)).world_from_camera
        };
        let most = self.settings.tracking.iterations[0];
        let last = pose(most);
        (0..most).find(|&finest| pose(finest) == last).unwrap_or(most)
    }

    pub fn radiance_transfer(&self, step: usize) -> RadianceTransfer {
        radiance_transfer(&self.settings, step)
    }

    /// Transfer of step 1 or 4.
    pub fn lit(&self, step: usize) -> &LitStep {
        &self.lit[usize::from(step == 4)]
    }

    pub fn operations_per_point(&self) -> usize {
        let params = &self.settings.transfer;
        let views = 1 + self.stages.auxiliary.len();
        params.directions / 2 * params.samples * views * LOOK_UP_OPERATIONS
    }

    pub fn compose_input(&self, step: usize) -> ComposeInput<'_> {
        let lit = self.lit(step);
        ComposeInput {
            frame: &self.frame,
            real: &self.stages.real,
            merged: &self.stages.merged,
            layer: &self.stages.layer,
            real_transfer: &lit.real_transfer,
            merged_transfer: &lit.merged_transfer,
            indirect: Some(&lit.indirect),
            light: &self.light.light,
            mean_albedo: self.settings.light.mean_albedo,
        }
    }
}

fn prepared(settings: &Settings, camera: Pinhole, raw: RawFrame) -> (RgbdFrame, View) {
    let pose = raw.world_from_camera.expect("the demo's poses");
    let mut frame = RgbdFrame::default();
    InputStage::new(&settings.input).prepare(raw, &mut frame);
    (frame, View::perspective(camera, pose))
}

fn volume_centre(settings: &Settings, (frame, view): &(RgbdFrame, View)) -> glam::Vec3 {
    place_centre(frame, view, settings.volume.side_m).expect("depth in the first frame")
}

fn fuse(settings: &Settings, history: &[(RgbdFrame, View)]) -> TsdfVolume {
    let centre = volume_centre(settings, &history[0]);
    let mut volume = TsdfVolume::new(&settings.volume, centre).expect("valid settings");
    for (frame, view) in history {
        volume.integrate(frame, view).expect("a frame of the view's size");
    }
    volume
}

fn dyn_geo(settings: &Settings, frame: &RgbdFrame, model: &GBuffer) -> GBuffer {
    let mut real = GBuffer::empty(model.view);
    DynGeo::new(&settings.dyn_geo).run(frame, model, &mut real);
    real
}

fn radiance_transfer(settings: &Settings, step: usize) -> RadianceTransfer {
    let mut params = settings.transfer.clone();
    params.subsampling = step;
    RadianceTransfer::new(&params, &settings.bounce).expect("valid settings")
}

impl FrameStages {
    fn new(
        settings: &Settings,
        scene: &VirtualScene,
        frame: &RgbdFrame,
        light: &LightEstimate,
        real: GBuffer,
        auxiliary: Vec<GBuffer>,
    ) -> Self {
        let dominant = DominantLight::of(&light.light);
        let draw = |buffer: &GBuffer, color: Option<&Image<[f32; 3]>>| {
            let (mut merged, mut layer) = (GBuffer::empty(buffer.view), VirtualLayer::default());
            Rasteriser::default().draw(scene, buffer, &mut merged, &mut layer);
            let mut radiance = Image::default();
            let albedo = settings.light.mean_albedo;
            exitant_radiance(&merged, &layer, color, dominant, albedo, &mut radiance);
            (merged, layer, radiance)
        };
        let (merged, layer, radiance) = draw(&real, Some(&frame.color));
        let (merged_auxiliary, auxiliary_radiance) =
            auxiliary.iter().map(|buffer| draw(buffer, None)).map(|(m, _, r)| (m, r)).unzip();
        Self { real, auxiliary, merged, merged_auxiliary, layer, radiance, auxiliary_radiance }
    }
}

impl LitStep {
    fn new(settings: &Settings, stages: &FrameStages, step: usize) -> Self {
        let mut stage = radiance_transfer(settings, step);
        let (mut real, mut merged) = (TransferMap::default(), TransferMap::default());
        let mut indirect = IndirectMap::default();
        let merged_buffers = (&stages.merged, stages.merged_auxiliary.as_slice());
        let real_buffers = (&stages.real, stages.auxiliary.as_slice());
        stage.transfer(real_buffers.0, real_buffers.1, &mut real);
        let radiance = Some((&stages.radiance, stages.auxiliary_radiance.as_slice()));
        stage.transfer_and_bounce(
            real_buffers,
            merged_buffers,
            radiance,
            &real,
            &mut merged,
            &mut indirect,
        );
        let n = real.bands * real.bands;
        let (before, after) = (real.coefficients.chunks(n), merged.coefficients.chunks(n));
        Self {
            points: before.clone().filter(|t| t.iter().any(|&c| c != 0.0)).count(),
            changed_points: before.zip(after).filter(|(a, b)| a != b).count(),
            real_transfer: real,
            merged_transfer: merged,
            indirect,
        }
    }
}
