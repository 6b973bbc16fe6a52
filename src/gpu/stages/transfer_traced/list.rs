//! Which points of a level send rays: only these take part.

use super::uniforms::TracedUniform;
use super::with_bands;
use crate::gpu::{Commands, Gpu, GpuBuffer, GpuError, Shader};
use crate::image::Size;
use wgpu::BufferUsages;

/// Points of a workgroup; `LISTED_TOGETHER` in `transfer_traced/points.wgsl`.
const WORKGROUP: usize = 64;

pub fn list_shader(bands: usize, known_too: bool) -> Shader {
    with_bands("transfer_traced/list", bands).with_bool("KNOWN_TOO", known_too)
}

/// Refilled by each pass that needs one.
pub struct PointList {
    /// Numbers of points plus one, then zeros.
    pub points: GpuBuffer<u32>,
    /// A workgroup for each 64 points and 32 directions.
    pub groups: GpuBuffer<u32>,
    no_groups: GpuBuffer<u32>,
    bands: usize,
    grid: Size,
}

impl PointList {
    /// `words` of 32 directions.
    pub fn new(gpu: &Gpu, bands: usize, grid: Size, words: usize) -> Result<Self, GpuError> {
        let points = grid.pixels().next_multiple_of(WORKGROUP);
        Ok(Self {
            points: GpuBuffer::new(gpu, "points that send rays", points)?,
            groups: GpuBuffer::with_usage(gpu, "groups of rays", 4, BufferUsages::INDIRECT)?,
            no_groups: GpuBuffer::from_slice(gpu, "no groups", &[0, words as u32, 1, 0])?,
            bands,
            grid,
        })
    }

    /// Lists the points that are to be traced; `known_too`, also those that know their rays through the
    /// volume.
    pub fn fill(
        &self,
        commands: &mut Commands<'_>,
        uniform: &TracedUniform,
        how: &GpuBuffer<u32>,
        known_too: bool,
    ) -> Result<(), GpuError> {
        commands.clear(&self.points);
        commands.copy(&self.no_groups, &self.groups, 4);
        commands
            .pass(&list_shader(self.bands, known_too))?
            .uniform(uniform)?
            .read(how)?
            .write(&self.points)?
            .write(&self.groups)?
            .over(self.grid)
    }
}
