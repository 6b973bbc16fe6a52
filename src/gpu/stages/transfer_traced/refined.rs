//! Adaptive refinement: every pixel gets transfer, interpolated between coarse points on one smooth surface,
//! traced elsewhere.

use super::level::Level;
use super::uniforms::TracedUniform;
use super::with_bands;
use crate::gpu::stages::GpuTransferMap;
use crate::gpu::{Commands, Gpu, GpuBuffer, GpuError, GpuGBuffer, Shader};
use crate::image::Size;
use crate::transfer::TransferParams;
use crate::transfer::traced::place;

pub struct Refined {
    /// Every pixel.
    pub pixels: Level,
    /// Transfer of the coarse points.
    pub real: GpuTransferMap,
    pub merged: GpuTransferMap,
    /// For each cell between coarse points, whether it lies on one smooth surface.
    is_smooth: GpuBuffer<u32>,
    /// Where columns lie between coarse points, then rows: as `transfer_traced/refine.wgsl` wants it.
    places: GpuBuffer<[u32; 4]>,
}

pub fn cells_shader(bands: usize) -> Shader {
    with_bands("transfer_traced/cells", bands)
}

pub fn refine_shader(bands: usize) -> Shader {
    with_bands("transfer_traced/refine", bands)
}

pub fn interpolate_shader(bands: usize) -> Shader {
    with_bands("transfer_traced/interpolate", bands)
}

impl Refined {
    pub fn new(gpu: &Gpu, params: &TransferParams, image: Size) -> Result<Self, GpuError> {
        let map = || GpuTransferMap::new(gpu, params.bands, params.subsampling, image);
        let real = map()?;
        Ok(Self {
            pixels: Level::new(gpu, params, 1, image)?,
            is_smooth: GpuBuffer::new(gpu, "smooth cells", real.grid.pixels())?,
            places: GpuBuffer::from_slice(
                gpu,
                "places between points",
                &places(params.subsampling, image),
            )?,
            real,
            merged: map()?,
        })
    }

    /// Plans which pixels are interpolated.
    pub fn plan(
        &self,
        commands: &mut Commands<'_>,
        uniform: &TracedUniform,
        main: &GpuGBuffer,
        how: &GpuBuffer<u32>,
    ) -> Result<(), GpuError> {
        let bands = self.real.bands;
        commands
            .pass(&cells_shader(bands))?
            .uniform(uniform)?
            .read(&main.surface)?
            .write(&self.is_smooth)?
            .over(self.real.grid)?;
        commands
            .pass(&refine_shader(bands))?
            .uniform(uniform)?
            .read(&main.surface)?
            .read(&self.places)?
            .read(&self.is_smooth)?
            .write(how)?
            .over(self.pixels.grid)
    }

    pub fn interpolate(
        &self,
        commands: &mut Commands<'_>,
        uniform: &TracedUniform,
        how: &GpuBuffer<u32>,
        coarse: &GpuTransferMap,
        out: &GpuBuffer<f32>,
    ) -> Result<(), GpuError> {
        commands
            .pass(&interpolate_shader(self.real.bands))?
            .uniform(uniform)?
            .read(&self.places)?
            .read(how)?
            .read(&coarse.coefficients)?
            .write(out)?
            .over(self.pixels.grid)
    }
}

fn places(step: usize, image: Size) -> Vec<[u32; 4]> {
    let (mut columns, mut rows) = (Vec::new(), Vec::new());
    place(&mut columns, step, image.width);
    place(&mut rows, step, image.height);
    columns.iter().chain(&rows).map(|p| [p.first, p.second, p.share.to_bits(), 0]).collect()
}
