//! The tracker of pictures in the host's memory.

use super::follower::Follower;
use super::keyframes::Thumbnail;
use super::normal_equations::{Gates, ModelView, Reduction, Sums};
use super::picture_pair::{FrameTag, ModelPicture, PicturePair};
use super::pyramid::Pyramid;
use super::{Tracking, TrackingParams};
use crate::capture::RgbdFrame;
use crate::geometry::GBuffer;
use crate::image::Size;
use crate::math::{Pinhole, Pose, View};
use std::convert::Infallible;

/// Follows the camera. One frame at a time; what a frame did is in its [`Tracking`].
///
/// ```text
/// Init ──> Tracking <──> Degraded         every frame with a model is aligned with it
///              │  ^          │
///              v  └──────┐   v
///             Lost <──> Relocalising      a pose is believed when it fits two frames in a row
/// ```
///
/// While lost, the pose is the last one that was well tracked. [`OnLost::Stop`](super::OnLost::Stop) and
/// [`OnLost::Reset`](super::OnLost::Reset) are for the caller to carry out when it sees
/// [`TrackingState::Lost`](super::TrackingState::Lost) (the latter by emptying the map and calling
/// [`Tracker::reset`]); the tracker itself then holds.
#[derive(Debug)]
pub struct Tracker {
    follower: Follower,
    pyramid: Pyramid,
    reduction: Reduction,
    /// Ray-cast where the caller's picture does not serve.
    rendered: Option<GBuffer>,
}

impl Tracker {
    /// `camera` is that of all frames.
    pub fn new(params: &TrackingParams, camera: Pinhole) -> Self {
        Self {
            follower: Follower::new(params, camera),
            pyramid: Pyramid::new(params, camera),
            reduction: Reduction::default(),
            rendered: None,
        }
    }

    /// Begins anew at this pose: for when the map has been emptied.
    pub fn reset(&mut self, world_from_camera: Pose) {
        self.follower.reset(world_from_camera);
    }

    /// The pose of this frame.
    ///
    /// `model` is the map's picture at the pose of the frame before, `None` before anything was fused.
    /// `render` draws the map from another view; it is called when the camera is lost, or when
    /// `model` shows another place than the guess.
    pub fn track(
        &mut self,
        frame: &RgbdFrame,
        model: Option<&GBuffer>,
        render: &mut dyn FnMut(&View, &mut GBuffer),
    ) -> Tracking {
        let tag = FrameTag { index: frame.index, recorded_pose: frame.world_from_camera };
        let Self { follower, pyramid, reduction, rendered } = self;
        let model = ModelPicture::given(model);
        let mut pictures = HostPictures { frame, model, pyramid, reduction, rendered, render };
        let Ok(tracking) = follower.follow(tag, &mut pictures);
        tracking
    }
}

struct HostPictures<'a> {
    frame: &'a RgbdFrame,
    model: ModelPicture<'a, GBuffer>,
    pyramid: &'a mut Pyramid,
    reduction: &'a mut Reduction,
    rendered: &'a mut Option<GBuffer>,
    render: &'a mut dyn FnMut(&View, &mut GBuffer),
}

impl PicturePair for HostPictures<'_> {
    type Error = Infallible;

    fn frame_size(&self) -> Size {
        self.frame.depth_m.size()
    }

    fn prepare(&mut self) -> Result<f32, Infallible> {
        Ok(self.pyramid.update(&self.frame.depth_m))
    }

    fn levels(&self) -> usize {
        self.pyramid.levels.len()
    }

    fn thumbnail(&mut self) -> Result<Thumbnail, Infallible> {
        Ok(Thumbnail::new(self.frame))
    }

    fn model_view(&self) -> Option<View> {
        self.model.of(self.rendered).map(|picture| picture.view)
    }

    fn render_model(&mut self, view: &View) -> Result<(), Infallible> {
        let picture = self.rendered.get_or_insert_with(|| GBuffer::empty(*view));
        picture.set_view(*view);
        (self.render)(view, picture);
        self.model = ModelPicture::Rendered;
        Ok(())
    }

    fn sums(
        &mut self,
        level: usize,
        model_camera: Pinhole,
        model_from_camera: &Pose,
        gates: &Gates,
    ) -> Result<Sums, Infallible> {
        let picture = self.model.of(self.rendered).expect("a picture of the map");
        let model = ModelView::new(picture, model_camera);
        let level = &self.pyramid.levels[level];
        Ok(self.reduction.accumulate(level, &model, model_from_camera, gates))
    }
}
