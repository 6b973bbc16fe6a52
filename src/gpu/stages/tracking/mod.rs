//! The camera part of the Reconstruct stage, as [`crate::tracking`]: filtered pyramid, sums of the alignment
//! and thumbnails are made on the device; the states and the 6x6 solves are the CPU tracker's own.

mod cells;
mod pyramid;
mod sums;
#[cfg(test)]
mod test_scene;
#[cfg(test)]
mod tests;
mod tracker;

pub use tracker::{GpuTracker, RenderModel, TrackedFrame};

use crate::gpu::uniform;
use crate::math::Pinhole;

uniform! {
    struct Lens {
        scale: [f32; 2],
        centre: [f32; 2],
        inverse_scale: [f32; 2],
        size: [u32; 2],
    }
}

impl Lens {
    fn new(camera: &Pinhole) -> Self {
        Self {
            scale: [camera.fx, camera.fy],
            centre: [camera.cx, camera.cy],
            inverse_scale: [1.0 / camera.fx, 1.0 / camera.fy],
            size: [camera.width as u32, camera.height as u32],
        }
    }
}

#[cfg(test)]
pub(super) fn shaders() -> Vec<crate::gpu::Shader> {
    [pyramid::shaders(), sums::shaders(), vec![cells::shader()]].concat()
}
