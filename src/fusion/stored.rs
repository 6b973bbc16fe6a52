//! A volume from blocks that were kept elsewhere.

use super::block::{Block, ColorBlock, EMPTY, VOXELS};
#[cfg(test)]
use super::crossings::Bricks;
use super::crossings::Sides;
use super::integrate::lowest;
use super::{Lattice, TsdfVolume, VolumeParams};

/// A block's voxels, x fastest.
pub(crate) struct StoredBlock {
    /// Number of the block in the volume, x fastest.
    pub index: usize,
    pub tsdf: [i16; VOXELS],
    pub weight: [u16; VOXELS],
    pub color: Option<Box<ColorBlock>>,
}

impl TsdfVolume {
    /// A volume that holds these blocks. `lattice` must be that of `params`, indices must be below its
    /// number of blocks.
    pub(crate) fn from_blocks(
        params: &VolumeParams,
        lattice: Lattice,
        blocks: impl IntoIterator<Item = StoredBlock>,
    ) -> Self {
        let mut volume = Self::on(params, lattice);
        for stored in blocks {
            volume.store.allocate(stored.index);
            let slot = volume.store.table[stored.index];
            let block = &mut volume.store.blocks[slot as usize];
            block.lowest = lowest(&stored.tsdf);
            block.sides = Sides::of(&stored.tsdf);
            block.tsdf = stored.tsdf;
            block.weight = stored.weight;
            if params.color && stored.color.is_some() {
                block.color = stored.color;
            }
        }
        volume.store.find_crossings();
        volume.revision += 1;
        volume
    }

    /// Every block that has storage, by its number.
    pub(crate) fn stored_blocks(&self) -> Vec<StoredBlock> {
        let stored = self.store.table.iter().enumerate().filter(|&(_, &slot)| slot != EMPTY);
        let blocks = stored.map(|(index, &slot)| (index, &self.store.blocks[slot as usize]));
        let copy = |(index, block): (usize, &Block)| StoredBlock {
            index,
            tsdf: block.tsdf,
            weight: block.weight,
            color: block.color.clone(),
        };
        blocks.map(copy).collect()
    }

    /// By block: the bricks that may hold surface.
    #[cfg(test)]
    pub(crate) fn crossings(&self) -> &[Bricks] {
        &self.store.crossings
    }
}
