//! What the CPU's stages gave, on the device.

use crate::geometry::GBuffer;
use crate::gpu::{Gpu, GpuError, GpuGBuffer, GpuImage};
use crate::image::Image;
use crate::transfer::Radiance;

pub fn buffer(gpu: &Gpu, from: &GBuffer) -> Result<GpuGBuffer, GpuError> {
    let mut out = GpuGBuffer::empty(gpu, from.view)?;
    out.upload(gpu, from);
    Ok(out)
}

pub fn buffers(gpu: &Gpu, from: &[GBuffer]) -> Result<Vec<GpuGBuffer>, GpuError> {
    from.iter().map(|from| buffer(gpu, from)).collect()
}

/// Radiance, or linear colour.
pub fn rgb(gpu: &Gpu, from: &Image<[f32; 3]>) -> Result<GpuImage<[f32; 4]>, GpuError> {
    let padded = from.as_slice().iter().map(|&[r, g, b]| [r, g, b, 0.0]).collect();
    GpuImage::from_image(gpu, "linear colour", &Image::from_vec(from.size(), padded))
}

/// Radiance on the device: of a main buffer, and of its side views.
pub type OwnedRadiance = (GpuImage<[f32; 4]>, Vec<GpuImage<[f32; 4]>>);

pub fn radiance(gpu: &Gpu, (main, sides): Radiance) -> Result<OwnedRadiance, GpuError> {
    let sides: Result<_, _> = sides.iter().map(|image| rgb(gpu, image)).collect();
    Ok((rgb(gpu, main)?, sides?))
}
