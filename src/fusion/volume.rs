//! The volume itself: its place in the world, its storage, its revision.

use super::allocate::BlockMarks;
use super::block::{BlockStore, ONE, SIDE, UNSEEN};
use super::sample::Sampler;
use super::tiles::TileMap;
use super::{Lattice, VolumeParams};
use crate::image::Size;
use glam::Vec3;
use std::sync::Mutex;

#[derive(Debug, thiserror::Error)]
pub enum FusionError {
    #[error("volume: {0}")]
    Params(String),
    #[error("frame {frame}: depth is {depth}, its view is {view}")]
    Size { frame: usize, depth: Size, view: Size },
    #[error("frame {frame}: the pose holds values that are not finite")]
    Pose { frame: usize },
    #[cfg(feature = "gpu")]
    #[error(
        "the volume is full: its memory on the GPU holds {blocks} blocks of 8x8x8 voxels, {refused} more found no \
         room; lower volume.resolution"
    )]
    Full { blocks: usize, refused: usize },
    #[cfg(feature = "gpu")]
    #[error(transparent)]
    Gpu(#[from] crate::gpu::GpuError),
}

/// What a voxel knows of the surface next to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Voxel {
    /// Along the view's z axis, positive in free space; at most the truncation distance either way.
    pub distance_m: f32,
    /// Frames in its average.
    pub weight: u16,
}

/// Truncated signed distances in a world-aligned cube, a [`Lattice`].
#[derive(Debug)]
pub struct TsdfVolume {
    pub(super) params: VolumeParams,
    pub(super) lattice: Lattice,
    pub(super) store: BlockStore,
    pub(super) marks: BlockMarks,
    pub(super) tiles: Mutex<TileMap>,
    pub(super) revision: u64,
}

impl TsdfVolume {
    /// An empty volume around `centre` (world, metres). `params.centre` is not read: it tells the
    /// caller where to place the cube.
    pub fn new(params: &VolumeParams, centre: Vec3) -> Result<Self, FusionError> {
        Ok(Self::on(params, Lattice::new(params, centre)?))
    }

    /// An empty volume on a lattice of these parameters.
    pub(super) fn on(params: &VolumeParams, lattice: Lattice) -> Self {
        Self {
            params: params.clone(),
            lattice,
            store: BlockStore::new(lattice.grid, params.color),
            marks: BlockMarks::new(lattice.blocks()),
            tiles: Mutex::default(),
            revision: 0,
        }
    }

    /// Forgets everything seen; keeps memory.
    pub fn reset(&mut self) {
        self.store.clear();
        self.revision += 1;
    }

    /// Changes whenever the contents may have changed.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    pub fn is_empty(&self) -> bool {
        self.store.live_blocks() == 0
    }

    /// Lowest and highest corner in world coordinates.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        self.lattice.bounds()
    }

    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    pub fn voxel_m(&self) -> f32 {
        self.lattice.voxel_m
    }

    /// The truncation distance in use.
    pub fn truncation_m(&self) -> f32 {
        self.lattice.truncation_m
    }

    pub fn params(&self) -> &VolumeParams {
        &self.params
    }

    /// Blocks of 8x8x8 voxels that have storage.
    pub fn allocated_blocks(&self) -> usize {
        self.store.live_blocks()
    }

    /// A voxel by its place in the lattice; `None` outside, and where no frame has seen it.
    pub fn voxel(&self, at: [usize; 3]) -> Option<Voxel> {
        if at.iter().any(|&v| v >= self.lattice.grid * SIDE) {
            return None;
        }
        let index = self.store.index(at.map(|v| (v / SIDE) as u16));
        let block = &self.store.blocks[self.store.table[index] as usize];
        let [x, y, z] = at.map(|v| v % SIDE);
        let k = (z * SIDE + y) * SIDE + x;
        (block.tsdf[k] != UNSEEN).then(|| Voxel {
            distance_m: f32::from(block.tsdf[k]) / f32::from(ONE) * self.lattice.truncation_m,
            weight: block.weight[k],
        })
    }

    pub fn memory_bytes(&self) -> usize {
        self.store.memory_bytes() + self.marks.memory_bytes()
    }

    pub(super) fn sampler(&self) -> Sampler<'_> {
        Sampler::new(&self.store)
    }

    pub(super) fn world_from_voxel(&self, point: Vec3) -> Vec3 {
        self.lattice.world_from_voxel(point)
    }
}
