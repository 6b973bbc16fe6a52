//! Intermediate buffers of the newest frame, to be looked at wherever the pipeline runs.

use super::Pipeline;
use crate::geometry::Origin;
use crate::image::{Image, NormalImage};

/// Which buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Buffer {
    /// After the Input stage.
    SensorDepth,
    /// Of G_v, the map in the newest view.
    ModelDepth,
    /// Of G_r.
    Depth,
    /// Of G_r with virtual objects.
    Normals,
    Origin,
    /// R, and R' with virtual objects, at full resolution. Computed anew: for looking, not for speed.
    Shading,
    VirtualShading,
}

/// What is in it.
#[derive(Clone, Debug, PartialEq)]
pub enum BufferValues {
    /// z-depth in metres, 0.0 where missing.
    DepthM(Image<f32>),
    /// World normals, zero where missing.
    Normals(NormalImage),
    Origins(Image<Origin>),
    /// Linear RGB.
    Light(Image<[f32; 3]>),
}

impl Pipeline {
    /// `None` where the newest frame has none: what follows the map needs a composed frame.
    pub fn buffer(&self, which: Buffer) -> Option<BufferValues> {
        let depth_m = |image: &Image<f32>| BufferValues::DepthM(image.clone());
        Some(match which {
            Buffer::SensorDepth => depth_m(&self.frame().depth_m),
            Buffer::ModelDepth => depth_m(&self.model()?.depth_m),
            Buffer::Depth => depth_m(&self.geometry()?.0.depth_m),
            Buffer::Normals => BufferValues::Normals(self.geometry()?.1.normals.clone()),
            Buffer::Origin => BufferValues::Origins(self.geometry()?.1.origin.clone()),
            Buffer::Shading => BufferValues::Light(self.shading()?.real),
            Buffer::VirtualShading => BufferValues::Light(self.shading()?.merged),
        })
    }
}
