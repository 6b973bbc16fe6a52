//! Views of the volume's surfaces.

use super::uniforms::{RaycastUniform, RaysUniform, TilesUniform, ViewFromVoxelUniform};
use super::{GpuVolume, shaders};
use crate::fusion::tiles::TILE;
use crate::gpu::{Commands, Gpu, GpuBuffer, GpuError, GpuGBuffer, Shader};
use crate::image::Size;
use crate::math::View;

/// Casts rays into volumes; its memory serves one view after the other.
pub struct RayCaster {
    tiles: Shader,
    raycast: Shader,
    /// Depth range of each tile.
    ranges: GpuBuffer<[u32; 2]>,
}

fn tiles(size: Size) -> usize {
    size.width.div_ceil(TILE) * size.height.div_ceil(TILE)
}

impl RayCaster {
    /// For views of up to this size; larger ones take more memory when they come.
    pub fn new(gpu: &Gpu, largest: Size) -> Result<Self, GpuError> {
        Ok(Self {
            tiles: shaders::tiles(),
            raycast: shaders::raycast(),
            ranges: GpuBuffer::new(gpu, "depth ranges of tiles", tiles(largest))?,
        })
    }

    /// Records the passes that write what is seen in `view`, as
    /// [`crate::fusion::TsdfVolume::raycast`] does, as a part of the stage that is being recorded.
    ///
    /// # Panics
    /// If `out` is not as large as the view.
    pub fn cast(
        &mut self,
        commands: &mut Commands<'_>,
        volume: &GpuVolume,
        view: &View,
        out: &mut GpuGBuffer,
    ) -> Result<(), GpuError> {
        let size = view.size();
        assert_eq!(out.size(), size, "geometry buffer of the view");
        out.view = *view;
        if size.pixels() == 0 {
            return Ok(());
        }
        if tiles(size) > self.ranges.len() {
            self.ranges = GpuBuffer::new(commands.gpu(), "depth ranges of tiles", tiles(size))?;
        }
        self.draw_tiles(commands, volume, view)?;
        let lattice = &volume.lattice;
        let uniform = RaycastUniform {
            rays: RaysUniform::new(lattice, view),
            last: volume.last_voxel(),
            scale: volume.voxels_per_step(),
            grid: lattice.grid as u32,
            most_steps: volume.most_steps(),
        };
        commands
            .pass(&self.raycast)?
            .uniform(&uniform)?
            .read(&volume.table)?
            .read(&volume.crossings)?
            .read(volume.voxels())?
            .read(&self.ranges)?
            .write(&out.surface)?
            .write(&out.origin)?
            .over(size)
    }

    fn draw_tiles(
        &self,
        commands: &mut Commands<'_>,
        volume: &GpuVolume,
        view: &View,
    ) -> Result<(), GpuError> {
        commands.clear(&self.ranges);
        let uniform = TilesUniform {
            view: ViewFromVoxelUniform::new(&volume.lattice, view),
            voxel_m: volume.lattice.voxel_m,
            grid: volume.lattice.grid as u32,
            pad0: 0,
            pad1: 0,
        };
        commands
            .pass(&self.tiles)?
            .uniform(&uniform)?
            .read(&volume.crossings)?
            .write(&self.ranges)?
            .over_count(8 * volume.lattice.blocks())
    }
}
