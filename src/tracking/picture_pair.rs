//! What the tracker needs of the device on which the pictures lie.

use super::keyframes::Thumbnail;
use super::normal_equations::{Gates, Sums};
use crate::image::Size;
use crate::math::{Pinhole, Pose, View};

/// What is said about a frame beside its pictures.
#[derive(Clone, Copy, Debug)]
pub struct FrameTag {
    pub index: usize,
    /// `world_from_camera` of the recording.
    pub recorded_pose: Option<Pose>,
}

/// The newest frame, and a picture of the map to align it with.
pub(crate) trait PicturePair {
    /// What the device can fail with.
    type Error;

    /// Of the frame's depth picture.
    fn frame_size(&self) -> Size;

    /// Filters the frame's depth into all levels; called once, before [`Self::sums`], for a frame of the
    /// camera's size. Returns the share of pixels that have depth.
    fn prepare(&mut self) -> Result<f32, Self::Error>;

    /// Number of levels; 0 where the camera has no pixels.
    fn levels(&self) -> usize;

    fn thumbnail(&mut self) -> Result<Thumbnail, Self::Error>;

    /// Where the map's picture is taken from; `None` before anything was fused.
    fn model_view(&self) -> Option<View>;

    /// Replaces the map's picture by one from this view.
    fn render_model(&mut self, view: &View) -> Result<(), Self::Error>;

    /// Sums of the alignment over all pixels of `level`, 0 is the finest. There is a picture of the map, it
    /// has pixels and `model_camera` is its projection.
    fn sums(
        &mut self,
        level: usize,
        model_camera: Pinhole,
        model_from_camera: &Pose,
        gates: &Gates,
    ) -> Result<Sums, Self::Error>;
}

/// Which picture of the map the frame is aligned with.
pub(crate) enum ModelPicture<'a, P> {
    Missing,
    Given(&'a P),
    /// The one that the device keeps for [`PicturePair::render_model`].
    Rendered,
}

impl<'a, P> ModelPicture<'a, P> {
    pub fn given(picture: Option<&'a P>) -> Self {
        picture.map_or(Self::Missing, Self::Given)
    }

    pub fn of<'p>(&'p self, rendered: &'p Option<P>) -> Option<&'p P> {
        match self {
            Self::Missing => None,
            Self::Given(given) => Some(given),
            Self::Rendered => rendered.as_ref(),
        }
    }
}
