//! Shading at the grid points: from the transfer, and smoothed.

use super::lamp::LampUniform;
use super::{Frame, GpuComposeInput};
use crate::compositing::{Likeness, MAX_VISIBILITY, PixelSteps};
use crate::gpu::{Commands, Constant, Gpu, GpuBuffer, GpuError, GpuGBuffer, Shader, uniform};
use crate::image::Size;

/// Planes of a shading: R, R' and the bounce.
pub const MAX_PLANES: usize = 3;

uniform! {
    struct ShadeUniform {
        lamp: LampUniform,
        grid: [u32; 2],
        image: [u32; 2],
        step: u32,
        pad0: u32,
        pad1: u32,
        pad2: u32,
    }
}

uniform! {
    /// For `shaders/compositing/likeness.wgsl`.
    pub struct EdgeAwareUniform {
        step_x: [f32; 4],
        step_y: [f32; 4],
        step_z: [f32; 4],
        grid: [u32; 2],
        image: [u32; 2],
        step: u32,
        plane_tolerance: f32,
        normal_exponent: f32,
        everywhere: u32,
    }
}

impl EdgeAwareUniform {
    pub fn new(frame: &Frame, merged: &GpuGBuffer) -> Self {
        let steps = PixelSteps::new(&merged.view);
        let likeness = Likeness::new(frame.params);
        let axis = |v: glam::Vec3| v.extend(0.0).to_array();
        Self {
            step_x: axis(steps.x),
            step_y: axis(steps.y),
            step_z: axis(steps.z),
            grid: pair(frame.grid),
            image: pair(frame.size),
            step: frame.step as u32,
            plane_tolerance: likeness.plane_tolerance,
            normal_exponent: likeness.normal_exponent,
            everywhere: u32::from(frame.everywhere),
        }
    }
}

pub fn pair(size: Size) -> [u32; 2] {
    [size.width as u32, size.height as u32]
}

pub fn shade_shader(bands: usize, planes: usize, visibility: bool) -> Shader {
    Shader::new("compositing/shade")
        .with_u32("COEFFICIENTS", bands * bands)
        .with_u32("PLANES", planes)
        .with("MAX_VISIBILITY", Constant::F32(MAX_VISIBILITY))
        .with_bool("VISIBILITY", visibility)
}

/// The filter mixes a point with its neighbours. Where pixels then take theirs from the 4 x 4 points around,
/// a changed point is seen by those one further away, which must be smoothed as well.
pub fn smooth_shader(planes: usize, step: usize) -> Shader {
    let reach = if step > 1 { 2 } else { 1 };
    Shader::new("compositing/smooth").with_u32("PLANES", planes).with_u32("REACH", reach)
}

/// Shading of the grid points of one image.
pub struct ShadingGrid {
    /// As `shaders/compositing/planes.wgsl` lays them out.
    pub planes: GpuBuffer<[f32; 4]>,
    pub smoothed: GpuBuffer<[f32; 4]>,
    /// Bound where there is no bounce.
    no_light: GpuBuffer<[f32; 4]>,
}

impl ShadingGrid {
    pub fn new(gpu: &Gpu, grid: Size) -> Result<Self, GpuError> {
        let planes = |label| GpuBuffer::new(gpu, label, MAX_PLANES * grid.pixels());
        Ok(Self {
            planes: planes("shading of the grid")?,
            smoothed: planes("smoothed shading")?,
            no_light: GpuBuffer::new(gpu, "no indirect light", 1)?,
        })
    }

    pub fn shade(
        &self,
        commands: &mut Commands<'_>,
        frame: &Frame,
        input: &GpuComposeInput,
    ) -> Result<(), GpuError> {
        let shade = ShadeUniform {
            lamp: LampUniform::new(&frame.lamp),
            grid: pair(frame.grid),
            image: pair(frame.size),
            step: frame.step as u32,
            pad0: 0,
            pad1: 0,
            pad2: 0,
        };
        commands
            .pass(&shade_shader(input.real_transfer.bands, frame.planes, frame.visibility))?
            .uniform(&shade)?
            .read(&input.real_transfer.coefficients)?
            .read(&input.merged_transfer.coefficients)?
            .read(input.indirect.map_or(&self.no_light, |indirect| &indirect.light))?
            .read(&input.merged.surface)?
            .read(&input.merged.origin)?
            .write(&self.planes)?
            .over(frame.grid)
    }

    pub fn smooth(
        &self,
        commands: &mut Commands<'_>,
        frame: &Frame,
        merged: &GpuGBuffer,
    ) -> Result<(), GpuError> {
        commands
            .pass(&smooth_shader(frame.planes, frame.step))?
            .uniform(&EdgeAwareUniform::new(frame, merged))?
            .read(&merged.surface)?
            .read(&self.planes)?
            .write(&self.smoothed)?
            .over(frame.grid)
    }
}
