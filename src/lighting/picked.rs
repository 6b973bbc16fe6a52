//! A frame's samples, picked elsewhere than in [`super::samples`] and by the same rules.

use super::bank::{Batch, Sample};
use super::samples::Counts;
use crate::math::{View, sh};
use glam::Vec3;

/// What [`super::LightEstimator::estimate_picked`] needs of a frame.
#[derive(Clone, Debug)]
pub struct PickedSamples {
    pub view: View,
    pub counts: Counts,
    pub bands: usize,
    /// At most [`super::most_samples`], in the order of the picture.
    pub points: Vec<PickedPoint>,
    /// `bands * bands` coefficients a point.
    pub transfer: Vec<f32>,
}

/// A surface point of the frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PickedPoint {
    /// World axes.
    pub position: Vec3,
    pub normal: Vec3,
    /// Linear light.
    pub rgb: [f32; 3],
    /// Luminance in the picture that was kept last; 0 where that does not show this surface.
    pub then: f32,
}

impl PickedSamples {
    /// As [`super::samples::Samples::pick`].
    pub(crate) fn fill(&self, hidden_radiance: f32, out: &mut Batch) {
        let rows = self.transfer.chunks_exact(sh::coefficients(self.bands));
        for (point, transfer) in self.points.iter().zip(rows) {
            let PickedPoint { position, normal, rgb, .. } = *point;
            out.push(&Sample { transfer, position, normal, rgb });
        }
        out.take_indirect_light(hidden_radiance);
    }
}
