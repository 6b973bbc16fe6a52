//! Means over the grid points, which stay on the device.

use super::Frame;
use super::grid::{ShadingGrid, pair};
use crate::compositing::log_average_step;
use crate::gpu::{Commands, Gpu, GpuBuffer, GpuError, Shader, uniform};
use crate::image::Size;

/// Points that one workgroup sums, as `shaders/compositing/sum.wgsl` says.
const WORKGROUP: usize = 256;

uniform! {
    struct SumsUniform {
        grid: [u32; 2],
        every: u32,
        pad: u32,
    }
}

uniform! {
    struct MeansUniform {
        groups: u32,
        key: f32,
    }
}

pub fn sums_shader(planes: usize) -> Shader {
    Shader::new("compositing/sums").with_u32("PLANES", planes)
}

pub fn means_shader() -> Shader {
    Shader::new("compositing/means")
}

pub struct Means {
    /// Three vectors for each workgroup.
    sums: GpuBuffer<[f32; 4]>,
    /// Mean R with the exposure as the fourth value, and mean bounce.
    pub means: GpuBuffer<[f32; 4]>,
}

impl Means {
    pub fn new(gpu: &Gpu, grid: Size) -> Result<Self, GpuError> {
        let groups = grid.pixels().div_ceil(WORKGROUP);
        Ok(Self {
            sums: GpuBuffer::new(gpu, "sums of shading", 3 * groups)?,
            means: GpuBuffer::new(gpu, "mean shading", 2)?,
        })
    }

    pub fn run(
        &self,
        commands: &mut Commands<'_>,
        frame: &Frame,
        grid: &ShadingGrid,
    ) -> Result<(), GpuError> {
        let points = frame.grid.pixels();
        let every = log_average_step(frame.grid) as u32;
        commands
            .pass(&sums_shader(frame.planes))?
            .uniform(&SumsUniform { grid: pair(frame.grid), every, pad: 0 })?
            .read(&grid.planes)?
            .write(&self.sums)?
            .over_count(points)?;
        let groups = points.div_ceil(WORKGROUP) as u32;
        commands
            .pass(&means_shader())?
            .uniform(&MeansUniform { groups, key: frame.params.key })?
            .read(&self.sums)?
            .write(&self.means)?
            .workgroups([1, 1, 1])
    }
}
