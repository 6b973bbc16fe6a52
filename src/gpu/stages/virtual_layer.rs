//! What the rasteriser knows of virtual objects, on the device.

use crate::compositing::VirtualLayer;
use crate::gpu::{Gpu, GpuBuffer, GpuError, GpuImage};
use crate::image::{Image, Size};

/// A [`VirtualLayer`] on the device.
pub struct GpuVirtualLayer {
    /// Linear albedo of virtual pixels, and the visible share of the pixel that virtual objects cover.
    pub texels: GpuImage<[f32; 4]>,
}

impl GpuVirtualLayer {
    /// No virtual object.
    pub fn empty(gpu: &Gpu, size: Size) -> Result<Self, GpuError> {
        Ok(Self { texels: GpuImage::new(gpu, "virtual layer", size)? })
    }

    /// # Panics
    /// If the sizes differ.
    pub fn upload(&self, gpu: &Gpu, from: &VirtualLayer) {
        let pairs = from.albedo.as_slice().iter().zip(from.coverage.as_slice());
        let texels = pairs.map(|(&[r, g, b], &coverage)| [r, g, b, coverage]).collect();
        self.texels.upload(gpu, &Image::from_vec(from.albedo.size(), texels));
    }

    pub fn size(&self) -> Size {
        self.texels.size()
    }
}

impl AsRef<GpuBuffer<[f32; 4]>> for GpuVirtualLayer {
    fn as_ref(&self) -> &GpuBuffer<[f32; 4]> {
        self.texels.buffer()
    }
}
