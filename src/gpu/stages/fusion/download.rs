//! The volume comes back as the CPU's: for its mesh, and for tests.

use super::GpuVolume;
use crate::fusion::TsdfVolume;
use crate::fusion::block::{EMPTY, UNSEEN, VOXELS};
use crate::fusion::stored::StoredBlock;
use crate::gpu::{Gpu, GpuBuffer, GpuError, ReadBack};
use crate::mesh::TriangleMesh;

impl GpuVolume {
    /// The surface, now, as [`TsdfVolume::mesh`].
    pub fn mesh(&self, gpu: &Gpu) -> Result<TriangleMesh, GpuError> {
        Ok(self.download(gpu)?.mesh())
    }

    /// Everything that was submitted, now.
    pub fn download(&self, gpu: &Gpu) -> Result<TsdfVolume, GpuError> {
        let used: u32 = self.counters.download(gpu)?.iter().map(|c| c.used).sum();
        let words = (used as usize + 1) * VOXELS;
        let table = self.table.download(gpu)?;
        let voxels = first_words(gpu, self.voxels(), words)?;
        let colors = self.pool.colors.as_ref().map(|c| first_words(gpu, c, words)).transpose()?;
        let stored = table.iter().enumerate().filter(|&(_, &slot)| slot != EMPTY);
        let blocks = stored.map(|(index, &slot)| {
            let of_block = slot as usize * VOXELS..(slot as usize + 1) * VOXELS;
            let words = &voxels[of_block.clone()];
            StoredBlock {
                index,
                tsdf: std::array::from_fn(|i| distance(words[i])),
                weight: std::array::from_fn(|i| (words[i] >> 16) as u16),
                color: colors.as_ref().map(|colors| {
                    let colors = &colors[of_block];
                    Box::new(std::array::from_fn(|i| colors[i].to_le_bytes()))
                }),
            }
        });
        Ok(TsdfVolume::from_blocks(&self.params, self.lattice, blocks))
    }
}

/// As `stored_distance` in `shaders/fusion/voxels.wgsl`.
fn distance(word: u32) -> i16 {
    (word as i16).wrapping_add(UNSEEN)
}

fn first_words(gpu: &Gpu, buffer: &GpuBuffer<u32>, words: usize) -> Result<Vec<u32>, GpuError> {
    let mut read_back = ReadBack::new(gpu, buffer.label(), words)?;
    let mut commands = gpu.commands();
    read_back.request(&mut commands, buffer, words);
    commands.submit()?;
    Ok(read_back.take(gpu)?.unwrap_or_default())
}
