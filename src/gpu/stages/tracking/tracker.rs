//! The tracker of pictures on the device.

use super::cells::CellMeans;
use super::pyramid::FramePyramid;
use super::sums::AlignmentSums;
use crate::gpu::stages::FramePictures;
use crate::gpu::{Commands, Gpu, GpuError, GpuGBuffer, ReadBack};
use crate::image::Size;
use crate::math::{Pinhole, Pose, View};
use crate::timing::Stage;
use crate::tracking::{
    Follower, FrameTag, Gates, ModelPicture, PicturePair, Sums, Thumbnail, Tracking, TrackingParams,
};

/// Records what draws the map from a view into a buffer of that view's size.
pub type RenderModel<'a> =
    dyn FnMut(&mut Commands<'_>, &View, &mut GpuGBuffer) -> Result<(), GpuError> + 'a;

/// Follows the camera as [`crate::tracking::Tracker`] does, by the same states.
///
/// Every iteration waits for its sums, so the device is idle when a frame has been tracked, and the time
/// that [`Self::track`] takes on the host is all it takes.
pub struct GpuTracker {
    follower: Follower,
    pyramid: FramePyramid,
    sums: AlignmentSums,
    cells: CellMeans,
    valid: ReadBack<u32>,
    /// Ray-cast where the caller's picture does not serve.
    rendered: Option<GpuGBuffer>,
    camera: Pinhole,
}

impl GpuTracker {
    /// `camera` is that of all frames.
    pub fn new(gpu: &Gpu, params: &TrackingParams, camera: Pinhole) -> Result<Self, GpuError> {
        Ok(Self {
            follower: Follower::new(params, camera),
            pyramid: FramePyramid::new(gpu, params, camera)?,
            sums: AlignmentSums::new(gpu, camera.size().pixels())?,
            cells: CellMeans::new(gpu)?,
            valid: ReadBack::new(gpu, "pixels with depth", 1)?,
            rendered: None,
            camera,
        })
    }

    /// Begins anew at this pose: for when the map has been emptied.
    pub fn reset(&mut self, world_from_camera: Pose) {
        self.follower.reset(world_from_camera);
    }

    /// The pose of this frame; what makes `frame` and `model` has been submitted.
    ///
    /// `model` is the map's picture at the pose of the frame before, `None` before anything was fused.
    /// `render` is called when the camera is lost, or when `model` shows another place than the guess.
    pub fn track(
        &mut self,
        gpu: &Gpu,
        tag: FrameTag,
        frame: &FramePictures,
        model: Option<&GpuGBuffer>,
        render: &mut RenderModel<'_>,
    ) -> Result<Tracking, GpuError> {
        let Self { follower, pyramid, sums, cells, valid, rendered, camera } = self;
        let model = ModelPicture::given(model);
        let pictures = &mut DevicePictures {
            gpu,
            frame,
            camera: *camera,
            model,
            pyramid,
            sums,
            cells,
            valid,
            rendered,
            render,
        };
        follower.follow(tag, pictures)
    }
}

struct DevicePictures<'a, 'r> {
    gpu: &'a Gpu,
    frame: &'a FramePictures,
    camera: Pinhole,
    model: ModelPicture<'a, GpuGBuffer>,
    pyramid: &'a FramePyramid,
    sums: &'a mut AlignmentSums,
    cells: &'a mut CellMeans,
    valid: &'a mut ReadBack<u32>,
    rendered: &'a mut Option<GpuGBuffer>,
    render: &'a mut RenderModel<'r>,
}

impl<'a> DevicePictures<'a, '_> {
    fn commands(&self) -> Commands<'a> {
        let mut commands = self.gpu.commands();
        commands.stage(Stage::Reconstruct);
        commands
    }
}

impl PicturePair for DevicePictures<'_, '_> {
    type Error = GpuError;

    fn frame_size(&self) -> Size {
        self.frame.size
    }

    fn prepare(&mut self) -> Result<f32, GpuError> {
        let mut commands = self.commands();
        self.pyramid.record(&mut commands, self.frame)?;
        self.valid.request(&mut commands, &self.pyramid.valid, 1);
        commands.submit()?;
        let valid = self.valid.take(self.gpu)?.unwrap_or_default();
        let valid = valid.first().copied().unwrap_or(0);
        Ok(valid as f32 / self.camera.size().pixels().max(1) as f32)
    }

    fn levels(&self) -> usize {
        self.pyramid.levels.len()
    }

    fn thumbnail(&mut self) -> Result<Thumbnail, GpuError> {
        let commands = self.commands();
        self.cells.thumbnail(commands, self.frame)
    }

    fn model_view(&self) -> Option<View> {
        self.model.of(self.rendered).map(|picture| picture.view)
    }

    fn render_model(&mut self, view: &View) -> Result<(), GpuError> {
        let mut commands = self.commands();
        if self.rendered.is_none() {
            *self.rendered = Some(GpuGBuffer::empty(self.gpu, *view)?);
        }
        if let Some(picture) = self.rendered {
            picture.view = *view;
            (self.render)(&mut commands, view, picture)?;
        }
        self.model = ModelPicture::Rendered;
        commands.submit()
    }

    fn sums(
        &mut self,
        level: usize,
        model_camera: Pinhole,
        model_from_camera: &Pose,
        gates: &Gates,
    ) -> Result<Sums, GpuError> {
        let picture = self.model.of(self.rendered).expect("a picture of the map");
        let level = &self.pyramid.levels[level];
        let commands = self.commands();
        self.sums.evaluate(commands, level, picture, &model_camera, model_from_camera, gates)
    }
}
