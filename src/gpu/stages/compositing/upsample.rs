//! From the grid to every pixel: joint bilateral, or bicubic and Gaussian.

use super::Frame;
use super::grid::{EdgeAwareUniform, MAX_PLANES, ShadingGrid, pair};
use super::means::Means;
use crate::compositing::{Between, MIN_WEIGHT, between, gaussian};
use crate::gpu::{Commands, Constant, Gpu, GpuBuffer, GpuError, GpuGBuffer, Shader, uniform};
use crate::image::Size;
use crate::transfer::grid_pixel;

uniform! {
    struct BicubicUniform {
        before: [u32; 2],
        after: [u32; 2],
    }
}

uniform! {
    struct BlurUniform {
        size: [u32; 2],
    }
}

pub fn upsample_shader(planes: usize) -> Shader {
    Shader::new("compositing/upsample")
        .with_u32("PLANES", planes)
        .with("MIN_WEIGHT", Constant::F32(MIN_WEIGHT))
}

/// The first of the two passes fills points without a surface.
pub fn bicubic_shader(planes: usize, along_x: bool) -> Shader {
    Shader::new("compositing/bicubic")
        .with_u32("PLANES", planes)
        .with_bool("ALONG_X", along_x)
        .with_bool("FILL", along_x)
}

pub fn blur_shader(taps: usize, along_x: bool) -> Shader {
    Shader::new("compositing/blur").with_u32("TAPS", taps).with_bool("ALONG_X", along_x)
}

/// [`Between`] as `shaders/compositing/between.wgsl` has it.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct GpuBetween {
    first: u32,
    second: u32,
    share: f32,
}

/// Of every pixel along each image axis the grid points on either side.
struct Axes {
    columns: GpuBuffer<GpuBetween>,
    rows: GpuBuffer<GpuBetween>,
}

impl Axes {
    fn new(gpu: &Gpu, size: Size, grid: Size, step: usize) -> Result<Self, GpuError> {
        Ok(Self {
            columns: axis(gpu, "columns between grid points", size.width, grid.width, step)?,
            rows: axis(gpu, "rows between grid points", size.height, grid.height, step)?,
        })
    }
}

fn axis(
    gpu: &Gpu,
    label: &'static str,
    length: usize,
    points: usize,
    step: usize,
) -> Result<GpuBuffer<GpuBetween>, GpuError> {
    let pixels: Vec<f32> = (0..points).map(|i| grid_pixel(step, i, length) as f32).collect();
    let mut all = Vec::new();
    between(&pixels, length, &mut all);
    let all: Vec<_> = all
        .into_iter()
        .map(|Between { first, second, share }| GpuBetween {
            first: first as u32,
            second: second as u32,
            share,
        })
        .collect();
    GpuBuffer::from_slice(gpu, label, &all)
}

/// Follows depth and normal edges.
pub struct JointBilateral {
    axes: Axes,
    pub full: GpuBuffer<[f32; 4]>,
}

impl JointBilateral {
    pub fn new(gpu: &Gpu, size: Size, grid: Size, step: usize) -> Result<Self, GpuError> {
        Ok(Self {
            axes: Axes::new(gpu, size, grid, step)?,
            full: GpuBuffer::new(gpu, "shading", MAX_PLANES * size.pixels())?,
        })
    }

    pub fn run(
        &self,
        commands: &mut Commands<'_>,
        frame: &Frame,
        grid: &ShadingGrid,
        merged: &GpuGBuffer,
    ) -> Result<(), GpuError> {
        commands
            .pass(&upsample_shader(frame.planes))?
            .uniform(&EdgeAwareUniform::new(frame, merged))?
            .read(&self.axes.columns)?
            .read(&self.axes.rows)?
            .read(&merged.surface)?
            .read(&merged.origin)?
            .read(&grid.smoothed)?
            .write(&self.full)?
            .over(frame.size)
    }
}

/// Blind to edges, as printed.
pub struct BicubicGauss {
    axes: Axes,
    kernel: GpuBuffer<f32>,
    /// Up-sampled along x alone.
    wide: GpuBuffer<[f32; 4]>,
    /// Blurred along x alone.
    spare: GpuBuffer<[f32; 4]>,
    pub full: GpuBuffer<[f32; 4]>,
}

impl BicubicGauss {
    pub fn new(
        gpu: &Gpu,
        size: Size,
        grid: Size,
        step: usize,
        radius: usize,
    ) -> Result<Self, GpuError> {
        let mut kernel = Vec::new();
        gaussian(radius, &mut kernel);
        let planes = |label, pixels| GpuBuffer::new(gpu, label, MAX_PLANES * pixels);
        Ok(Self {
            axes: Axes::new(gpu, size, grid, step)?,
            kernel: GpuBuffer::from_slice(gpu, "Gaussian", &kernel)?,
            wide: planes("shading between grid rows", size.width * grid.height)?,
            spare: planes("shading between filters", size.pixels())?,
            full: planes("shading", size.pixels())?,
        })
    }

    pub fn run(
        &self,
        commands: &mut Commands<'_>,
        frame: &Frame,
        grid: &ShadingGrid,
        means: &Means,
    ) -> Result<(), GpuError> {
        let wide = Size::new(frame.size.width, frame.grid.height);
        let cells = |size: Size| [size.width, size.height, frame.planes];
        let cubics = [
            (true, &self.axes.columns, &grid.planes, frame.grid, &self.wide, wide),
            (false, &self.axes.rows, &self.wide, wide, &self.full, frame.size),
        ];
        for (along_x, axis, from, before, to, after) in cubics {
            commands
                .pass(&bicubic_shader(frame.planes, along_x))?
                .uniform(&BicubicUniform { before: pair(before), after: pair(after) })?
                .read(axis)?
                .read(&means.means)?
                .read(from)?
                .write(to)?
                .over_3d(cells(after))?;
        }
        let blurs = [(true, &self.full, &self.spare), (false, &self.spare, &self.full)];
        for (along_x, from, to) in blurs {
            commands
                .pass(&blur_shader(self.kernel.len(), along_x))?
                .uniform(&BlurUniform { size: pair(frame.size) })?
                .read(&self.kernel)?
                .read(from)?
                .write(to)?
                .over_3d(cells(frame.size))?;
        }
        Ok(())
    }
}
