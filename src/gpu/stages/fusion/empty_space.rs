//! How far around each block there is no surface, as [`crate::fusion::EmptySpace`].

use super::{GpuVolume, shaders};
use crate::gpu::{Commands, Gpu, GpuBuffer, GpuError, Shader};

/// For each block, how many blocks away (the largest of the three axes) the nearest one is that may
/// hold surface; 0 is such a block itself.
pub struct EmptySpacePass {
    shaders: [Shader; 3],
    distances: GpuBuffer<u32>,
    /// Two axes of them.
    narrow: GpuBuffer<u32>,
}

impl EmptySpacePass {
    /// For volumes with as many blocks as this one.
    pub fn new(gpu: &Gpu, volume: &GpuVolume) -> Result<Self, GpuError> {
        let blocks = volume.lattice.blocks();
        Ok(Self {
            shaders: shaders::surveys(),
            distances: GpuBuffer::new(gpu, "distances to surface", blocks)?,
            narrow: GpuBuffer::new(gpu, "distances along two axes", blocks)?,
        })
    }

    /// Records the taking in of what the volume holds then, as a part of the stage that is being
    /// recorded.
    ///
    /// # Panics
    /// If the volume has another number of blocks.
    pub fn survey(&self, commands: &mut Commands<'_>, volume: &GpuVolume) -> Result<(), GpuError> {
        let blocks = volume.lattice.blocks();
        assert_eq!(self.distances.len(), blocks, "blocks of the volume");
        let [x, y, z] = &self.shaders;
        commands
            .pass(x)?
            .uniform(&volume.grid_uniform())?
            .read(&volume.crossings)?
            .write(&self.distances)?
            .over_count(blocks)?;
        for (shader, from, to) in
            [(y, &self.distances, &self.narrow), (z, &self.narrow, &self.distances)]
        {
            commands
                .pass(shader)?
                .uniform(&volume.grid_uniform())?
                .read(from)?
                .write(to)?
                .over_count(blocks)?;
        }
        Ok(())
    }

    /// In the order of the volume's table.
    pub fn distances(&self) -> &GpuBuffer<u32> {
        &self.distances
    }
}
