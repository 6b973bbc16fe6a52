//! The tracker of pictures on the device.

use super::cells::CellMeans;
use super::pyramid::FramePyramid;
use super::sums::AlignmentSums;
use crate::gpu::stages::FramePictures;
use crate::gpu::{Commands, Gpu, GpuError, GpuGBuffer};
use crate::image::Size;
use crate::math::{Pinhole, Pose, View};
use crate::timing::Stage;
use crate::tracking::{
    Follower, FrameTag, Gates, ModelPicture, PicturePair, Sums, Thumbnail, Tracking, TrackingParams,
};

/// Records what draws the map from a view into a buffer of that view's size.
pub type RenderModel<'a> =
    dyn FnMut(&mut Commands<'_>, &View, &mut GpuGBuffer) -> Result<(), GpuError> + 'a;

/// The newest frame.
#[derive(Clone, Copy)]
pub struct TrackedFrame<'a> {
    pub tag: FrameTag,
    pub pictures: &'a FramePictures,
    /// Share of its pixels with depth that the tracker can use, which the host knows before the device.
    pub depth_share: f32,
}

/// Follows the camera as [`crate::tracking::Tracker`] does, by the same states.
///
/// Every iteration waits for its sums, and nothing else is waited for.
pub struct GpuTracker {
    follower: Follower,
    pyramid: FramePyramid,
    sums: AlignmentSums,
    cells: CellMeans,
    /// Ray-cast where the caller's picture does not serve.
    rendered: Option<GpuGBuffer>,
}

impl GpuTracker {
    /// `camera` is that of all frames.
    pub fn new(gpu: &Gpu, params: &TrackingParams, camera: Pinhole) -> Result<Self, GpuError> {
        Ok(Self {
            follower: Follower::new(params, camera),
            pyramid: FramePyramid::new(gpu, params, camera)?,
            sums: AlignmentSums::new(gpu, camera.size().pixels())?,
            cells: CellMeans::new(gpu)?,
            rendered: None,
        })
    }

    /// Begins anew at this pose: for when the map has been emptied.
    pub fn reset(&mut self, world_from_camera: Pose) {
        self.follower.reset(world_from_camera);
    }

    /// The pose of this frame; `commands` may hold what makes it and `model`, and are submitted with the
    /// first iteration, if there is one.
    ///
    /// `model` is the map's picture at the pose of the frame before, `None` before anything was fused.
    /// `render` is called when the camera is lost, or when `model` shows another place than the guess.
    pub fn track(
        &mut self,
        commands: &mut Commands<'_>,
        frame: TrackedFrame<'_>,
        model: Option<&GpuGBuffer>,
        render: &mut RenderModel<'_>,
    ) -> Result<Tracking, GpuError> {
        let Self { follower, pyramid, sums, cells, rendered, .. } = self;
        let model = ModelPicture::given(model);
        commands.stage(Stage::Reconstruct);
        let pictures =
            &mut DevicePictures { commands, frame, model, pyramid, sums, cells, rendered, render };
        follower.follow(frame.tag, pictures)
    }
}

struct DevicePictures<'a, 'g, 'r> {
    commands: &'a mut Commands<'g>,
    frame: TrackedFrame<'a>,
    model: ModelPicture<'a, GpuGBuffer>,
    pyramid: &'a FramePyramid,
    sums: &'a mut AlignmentSums,
    cells: &'a mut CellMeans,
    rendered: &'a mut Option<GpuGBuffer>,
    render: &'a mut RenderModel<'r>,
}

impl PicturePair for DevicePictures<'_, '_, '_> {
    type Error = GpuError;

    fn frame_size(&self) -> Size {
        self.frame.pictures.size
    }

    fn prepare(&mut self) -> Result<f32, GpuError> {
        self.pyramid.record(self.commands, self.frame.pictures)?;
        Ok(self.frame.depth_share)
    }

    fn levels(&self) -> usize {
        self.pyramid.levels.len()
    }

    fn thumbnail(&mut self) -> Result<Thumbnail, GpuError> {
        self.cells.thumbnail(self.commands, self.frame.pictures)
    }

    fn model_view(&self) -> Option<View> {
        self.model.of(self.rendered).map(|picture| picture.view)
    }

    fn render_model(&mut self, view: &View) -> Result<(), GpuError> {
        if self.rendered.is_none() {
            *self.rendered = Some(GpuGBuffer::empty(self.commands.gpu(), *view)?);
        }
        if let Some(picture) = self.rendered {
            picture.view = *view;
            (self.render)(self.commands, view, picture)?;
        }
        self.model = ModelPicture::Rendered;
        Ok(())
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
        self.sums.evaluate(self.commands, level, picture, &model_camera, model_from_camera, gates)
    }
}
