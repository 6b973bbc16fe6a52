//! The Rendering stage, as [`crate::compositing::CompositingStage`].
//!
//! ```text
//! transfer, light -> R, R' on the grid -> smoothed -> up-sampled -> virtual light -> display pixels
//! ```
//!
//! Every point is looked at, and left where no virtual object has changed anything near it; so a picture
//! without virtual objects is the recorded one, byte by byte. Shading always has three channels. The real
//! scene's geometry buffer is not needed: what it gives is in the real transfer.

mod grid;
mod lamp;
mod means;
mod picture;
mod pixels;
#[cfg(test)]
mod tests;
mod upsample;

pub use picture::{GpuPicture, PictureReadBack};

use super::transfer_map::grid_size;
use super::{FramePictures, GpuIndirectMap, GpuTransferMap, GpuVirtualLayer};
use crate::compositing::{CompositingParams, Compositor, Lamp, ShadingBuffers, Upsampling};
use crate::gpu::{Commands, Gpu, GpuBuffer, GpuError, GpuGBuffer};
use crate::image::{Image, Size};
use crate::lighting::ShLight;
use crate::timing::Stage;
use grid::ShadingGrid;
use means::Means;
use pixels::Pixels;
use upsample::{BicubicGauss, JointBilateral};

/// One frame with everything that is known about it; as [`crate::compositing::ComposeInput`]. All images
/// have the camera's size, all maps one grid.
#[derive(Clone, Copy)]
pub struct GpuComposeInput<'a> {
    pub frame: &'a FramePictures,
    /// Geometry with virtual objects, seen by the (perspective) camera.
    pub merged: &'a GpuGBuffer,
    pub layer: &'a GpuVirtualLayer,
    pub real_transfer: &'a GpuTransferMap,
    pub merged_transfer: &'a GpuTransferMap,
    /// Light of one bounce that virtual objects bring or receive; none, no bounce.
    pub indirect: Option<&'a GpuIndirectMap>,
    /// Times `mean_albedo`.
    pub light: &'a ShLight,
    pub mean_albedo: f32,
}

/// What the passes of one frame share.
struct Frame<'a> {
    params: &'a CompositingParams,
    size: Size,
    grid: Size,
    step: usize,
    lamp: Lamp,
    /// 2, or 3 with a bounce.
    planes: usize,
    /// Virtual points are shaded by the part of the light that arrives. Blind up-sampling mixes real and
    /// virtual points, whose planes must then mean the same.
    visibility: bool,
    /// Shades also what virtual objects do not change.
    everywhere: bool,
}

enum Upsampler {
    /// The grid has all pixels.
    None,
    JointBilateral(Box<JointBilateral>),
    BicubicGauss(Box<BicubicGauss>),
}

/// The stage, with its memory for images of one size.
pub struct CompositingPass {
    params: CompositingParams,
    size: Size,
    step: usize,
    grid: ShadingGrid,
    means: Means,
    upsampler: Upsampler,
    pixels: Pixels,
}

#[cfg(test)]
pub(super) fn shaders() -> Vec<crate::gpu::Shader> {
    let mut all = vec![means::means_shader()];
    for on in [false, true] {
        all.push(upsample::blur_shader(17, on));
    }
    for planes in [2, 3] {
        all.extend([1, 4].map(|step| grid::smooth_shader(planes, step)));
        all.extend([means::sums_shader(planes), upsample::upsample_shader(planes)]);
        for on in [false, true] {
            all.push(grid::shade_shader(4, planes, on));
            all.push(upsample::bicubic_shader(planes, on));
            all.extend([false, true].map(|a| pixels::virtual_light_shader(planes, on, a)));
        }
        for compositor in [Compositor::Ratio, Compositor::Difference] {
            all.push(pixels::pixels_shader(planes, compositor));
        }
    }
    all
}

impl CompositingPass {
    /// For images of this size and transfer on every `step`-th pixel.
    pub fn new(
        gpu: &Gpu,
        params: &CompositingParams,
        size: Size,
        step: usize,
    ) -> Result<Self, GpuError> {
        let grid = grid_size(step, size);
        let upsampler = match params.upsampling {
            _ if step == 1 => Upsampler::None,
            Upsampling::JointBilateral => {
                Upsampler::JointBilateral(Box::new(JointBilateral::new(gpu, size, grid, step)?))
            }
            Upsampling::BicubicGauss => {
                let made = BicubicGauss::new(gpu, size, grid, step, params.gauss_radius)?;
                Upsampler::BicubicGauss(Box::new(made))
            }
        };
        Ok(Self {
            params: params.clone(),
            size,
            step,
            grid: ShadingGrid::new(gpu, grid)?,
            means: Means::new(gpu, grid)?,
            upsampler,
            pixels: Pixels::new(gpu, params, size)?,
        })
    }

    /// Records the passes that write the camera image with virtual objects to `out`.
    ///
    /// # Panics
    /// If sizes or grids differ from those that the stage was made for, or transfers in their bands.
    pub fn run(
        &self,
        commands: &mut Commands<'_>,
        input: &GpuComposeInput,
        out: &GpuPicture,
    ) -> Result<(), GpuError> {
        assert_eq!(out.size, self.size, "size of the display picture");
        let frame = self.frame(input, false);
        if self.size.pixels() == 0 {
            return Ok(());
        }
        commands.stage(Stage::Rendering);
        let shading = self.shade(commands, &frame, input)?;
        self.pixels.write(commands, &frame, input, (shading, &self.means.means), out)
    }

    /// R and R' at full resolution, everywhere, now: for looking at.
    ///
    /// # Panics
    /// As [`Self::run`].
    pub fn shading_buffers(
        &self,
        gpu: &Gpu,
        input: &GpuComposeInput,
    ) -> Result<ShadingBuffers, GpuError> {
        let frame = self.frame(input, true);
        if self.size.pixels() == 0 {
            return Ok(ShadingBuffers::default());
        }
        let mut commands = gpu.commands();
        commands.stage(Stage::Rendering);
        let shading = self.shade(&mut commands, &frame, input)?;
        commands.submit()?;
        let planes = shading.download(gpu)?;
        let surface = input.merged.surface.buffer().download(gpu)?;
        let plane = |first: usize| {
            let values = planes[first..].iter().zip(&surface);
            let rgb =
                values.map(|(&[r, g, b, _], s)| if s[3] > 0.0 { [r, g, b] } else { [1.0; 3] });
            Image::from_vec(self.size, rgb.collect())
        };
        Ok(ShadingBuffers { real: plane(0), merged: plane(self.size.pixels()) })
    }

    fn frame(&self, input: &GpuComposeInput, everywhere: bool) -> Frame<'_> {
        let grid = grid_size(self.step, self.size);
        assert_eq!(input.merged.size(), self.size, "merged geometry");
        assert_eq!(input.frame.size, self.size, "picture");
        assert_eq!(input.layer.size(), self.size, "virtual layer");
        let (real, merged) = (input.real_transfer, input.merged_transfer);
        assert_eq!(real.bands, merged.bands, "bands of real and merged transfer");
        for (map, step, points) in
            [("real transfer", real.step, real.grid), ("merged transfer", merged.step, merged.grid)]
                .into_iter()
                .chain(input.indirect.map(|bounce| ("bounce", bounce.step, bounce.grid)))
        {
            assert_eq!((step, points), (self.step, grid), "{map}");
        }
        Frame {
            params: &self.params,
            size: self.size,
            grid,
            step: self.step,
            lamp: Lamp::new(input.light),
            planes: if input.indirect.is_some() { 3 } else { 2 },
            visibility: !matches!(self.upsampler, Upsampler::BicubicGauss(_)),
            everywhere,
        }
    }

    /// Full-resolution shading, and the light of virtual pixels.
    fn shade(
        &self,
        commands: &mut Commands<'_>,
        frame: &Frame,
        input: &GpuComposeInput,
    ) -> Result<&GpuBuffer<[f32; 4]>, GpuError> {
        self.grid.shade(commands, frame, input)?;
        if self.needs_means() {
            self.means.run(commands, frame, &self.grid)?;
        }
        let shading = match &self.upsampler {
            Upsampler::None => {
                self.grid.smooth(commands, frame, input.merged)?;
                &self.grid.smoothed
            }
            Upsampler::JointBilateral(upsampler) => {
                self.grid.smooth(commands, frame, input.merged)?;
                upsampler.run(commands, frame, &self.grid, input.merged)?;
                &upsampler.full
            }
            Upsampler::BicubicGauss(upsampler) => {
                upsampler.run(commands, frame, &self.grid, &self.means)?;
                &upsampler.full
            }
        };
        self.pixels.light(commands, frame, input, shading)?;
        Ok(shading)
    }

    fn needs_means(&self) -> bool {
        self.params.compositor == Compositor::Difference
            || matches!(self.upsampler, Upsampler::BicubicGauss(_))
    }
}
