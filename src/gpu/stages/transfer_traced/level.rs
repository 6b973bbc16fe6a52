//! Points on every n-th pixel, and what hides them.

use super::list::PointList;
use super::objects::GpuSceneRays;
use super::uniforms::TracedUniform;
use super::with_bands;
use crate::gpu::stages::fusion::with_walk;
use crate::gpu::stages::transfer_map::grid_size;
use crate::gpu::stages::{EmptySpacePass, GpuVolume};
use crate::gpu::{Commands, Gpu, GpuBuffer, GpuError, GpuGBuffer, Shader};
use crate::image::Size;
use crate::transfer::TransferParams;

/// What a pass found at each point.
pub struct Found {
    /// How it gets its transfer: numbers as in `shaders/transfer_traced/points.wgsl`.
    pub how: GpuBuffer<u32>,
    /// A bit for each direction that is hidden from a traced point: words of 32 directions one after
    /// the other, all points in each.
    pub hits: GpuBuffer<u32>,
}

impl Found {
    fn new(gpu: &Gpu, points: usize, words: usize) -> Result<Self, GpuError> {
        Ok(Self {
            how: GpuBuffer::new(gpu, "points of rays", points)?,
            hits: GpuBuffer::new(gpu, "hidden directions", points * words)?,
        })
    }
}

/// A grid of points, for the real pass and for that with virtual objects.
pub struct Level {
    pub step: usize,
    pub grid: Size,
    bands: usize,
    list: PointList,
    pub real: Found,
    pub merged: Found,
}

/// Where rays go.
#[derive(Clone, Copy)]
pub struct Room<'a> {
    /// A direction, then its spherical harmonics.
    pub directions: &'a GpuBuffer<[f32; 4]>,
    pub volume: &'a GpuVolume,
    pub space: &'a EmptySpacePass,
}

pub fn plan_shader(bands: usize) -> Shader {
    with_bands("transfer_traced/plan", bands)
}

pub fn volume_shader(bands: usize) -> Shader {
    with_walk(with_bands("transfer_traced/volume", bands))
}

pub fn again_shader(bands: usize) -> Shader {
    with_bands("transfer_traced/again", bands)
}

pub fn objects_shader(bands: usize) -> Shader {
    with_bands("transfer_traced/objects", bands)
}

pub fn project_shader(bands: usize) -> Shader {
    with_bands("transfer_traced/project", bands)
}

impl Level {
    pub fn new(
        gpu: &Gpu,
        params: &TransferParams,
        step: usize,
        image: Size,
    ) -> Result<Self, GpuError> {
        let (grid, words) = (grid_size(step, image), params.directions.div_ceil(32));
        Ok(Self {
            step,
            grid,
            bands: params.bands,
            list: PointList::new(gpu, params.bands, grid, words)?,
            real: Found::new(gpu, grid.pixels(), words)?,
            merged: Found::new(gpu, grid.pixels(), words)?,
        })
    }

    pub fn points(&self) -> [u32; 2] {
        [self.grid.width as u32, self.grid.height as u32]
    }

    /// Plans to trace every point that shows a surface.
    pub fn plan(
        &self,
        commands: &mut Commands<'_>,
        uniform: &TracedUniform,
        main: &GpuGBuffer,
        how: &GpuBuffer<u32>,
    ) -> Result<(), GpuError> {
        commands
            .pass(&plan_shader(self.bands))?
            .uniform(&uniform.of(self))?
            .read(&main.surface)?
            .write(how)?
            .over(self.grid)
    }

    /// Traces the real scene as planned.
    pub fn trace(
        &self,
        commands: &mut Commands<'_>,
        uniform: &TracedUniform,
        room: Room<'_>,
        main: &GpuGBuffer,
        out: &GpuBuffer<f32>,
    ) -> Result<(), GpuError> {
        self.trace_volume(commands, uniform, room, main, &self.real)?;
        self.project(commands, uniform, room, main, &self.real, out)
    }

    /// Traces the scene with objects as planned. What the real pass found is used again; `out` holds its
    /// transfer, which stays where no object is near.
    pub fn trace_again(
        &self,
        commands: &mut Commands<'_>,
        uniform: &TracedUniform,
        room: Room<'_>,
        objects: &GpuSceneRays,
        (real, merged): (&GpuGBuffer, &GpuGBuffer),
        out: &GpuBuffer<f32>,
    ) -> Result<(), GpuError> {
        commands
            .pass(&again_shader(self.bands))?
            .uniform(&uniform.of(self))?
            .read(&merged.surface)?
            .read(&real.surface)?
            .read(&self.real.how)?
            .read(&objects.instances)?
            .write(&self.merged.how)?
            .over(self.grid)?;
        commands.copy(&self.real.hits, &self.merged.hits, self.real.hits.len());
        self.trace_volume(commands, uniform, room, merged, &self.merged)?;
        self.list.fill(commands, &uniform.of(self), &self.merged.how, true)?;
        commands
            .pass(&objects_shader(self.bands))?
            .uniform(&uniform.of(self))?
            .read(&merged.surface)?
            .read(room.directions)?
            .read(&objects.instances)?
            .read(&objects.nodes)?
            .read(&objects.triangles)?
            .read(&self.list.points)?
            .write(&self.merged.hits)?
            .workgroups_from(&self.list.groups)?;
        self.project(commands, uniform, room, merged, &self.merged, out)
    }

    fn trace_volume(
        &self,
        commands: &mut Commands<'_>,
        uniform: &TracedUniform,
        Room { directions, volume, space }: Room<'_>,
        main: &GpuGBuffer,
        found: &Found,
    ) -> Result<(), GpuError> {
        self.list.fill(commands, &uniform.of(self), &found.how, false)?;
        commands
            .pass(&volume_shader(self.bands))?
            .uniform(&uniform.of(self))?
            .read(&main.surface)?
            .read(directions)?
            .read(volume.table())?
            .read(volume.crossings())?
            .read(volume.voxels())?
            .read(space.distances())?
            .read(&self.list.points)?
            .write(&found.hits)?
            .workgroups_from(&self.list.groups)
    }

    fn project(
        &self,
        commands: &mut Commands<'_>,
        uniform: &TracedUniform,
        room: Room<'_>,
        main: &GpuGBuffer,
        found: &Found,
        out: &GpuBuffer<f32>,
    ) -> Result<(), GpuError> {
        commands
            .pass(&project_shader(self.bands))?
            .uniform(&uniform.of(self))?
            .read(&main.surface)?
            .read(room.directions)?
            .read(&found.how)?
            .read(&found.hits)?
            .write(out)?
            .over(self.grid)
    }
}
