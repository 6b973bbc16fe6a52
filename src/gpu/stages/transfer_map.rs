//! Transfer and bounce on the grid, on the device.

use crate::gpu::{Gpu, GpuBuffer, GpuError};
use crate::image::Size;
use crate::transfer::{IndirectMap, TransferMap};

/// A [`TransferMap`] on the device.
pub struct GpuTransferMap {
    pub bands: usize,
    pub step: usize,
    pub grid: Size,
    /// Row-major grid points, `bands * bands` contiguous coefficients each; all zero where there is no
    /// surface.
    pub coefficients: GpuBuffer<f32>,
}

impl GpuTransferMap {
    /// No surface, on every `step`-th pixel of an image.
    pub fn new(gpu: &Gpu, bands: usize, step: usize, image: Size) -> Result<Self, GpuError> {
        let grid = grid_size(step, image);
        let len = grid.pixels() * bands * bands;
        Ok(Self { bands, step, grid, coefficients: GpuBuffer::new(gpu, "transfer", len)? })
    }

    /// # Panics
    /// If bands, steps or grids differ.
    pub fn upload(&self, gpu: &Gpu, from: &TransferMap) {
        let Self { bands, step, grid, .. } = *self;
        assert_eq!((from.bands, from.step, from.grid), (bands, step, grid), "transfer");
        self.coefficients.upload(gpu, &from.coefficients);
    }
}

/// An [`IndirectMap`] on the device.
pub struct GpuIndirectMap {
    pub step: usize,
    pub grid: Size,
    /// Row-major grid points, linear RGB; zero where there is no surface. The fourth value means nothing.
    pub light: GpuBuffer<[f32; 4]>,
}

impl GpuIndirectMap {
    /// No light, on every `step`-th pixel of an image.
    pub fn new(gpu: &Gpu, step: usize, image: Size) -> Result<Self, GpuError> {
        let grid = grid_size(step, image);
        Ok(Self { step, grid, light: GpuBuffer::new(gpu, "indirect light", grid.pixels())? })
    }

    /// # Panics
    /// If steps or grids differ.
    pub fn upload(&self, gpu: &Gpu, from: &IndirectMap) {
        assert_eq!((from.step, from.grid), (self.step, self.grid), "indirect light");
        let light: Vec<_> = from.rgb.iter().map(|&[r, g, b]| [r, g, b, 0.0]).collect();
        self.light.upload(gpu, &light);
    }
}

/// Points of the grid with one point for every `step` x `step` pixels, begun ones counted.
pub(super) fn grid_size(step: usize, image: Size) -> Size {
    Size::new(image.width.div_ceil(step), image.height.div_ceil(step))
}
