//! The volume's memory.

use super::pool::{Pool, most_blocks};
use super::shaders;
use super::uniforms::GridUniform;
use crate::fusion::block::{ONE, SIDE};
use crate::fusion::{FusionError, Lattice, VolumeParams};
use crate::gpu::{Commands, Gpu, GpuBuffer, GpuError, ReadBack, Shader};
use wgpu::BufferUsages;

/// As in `shaders/fusion/blocks.wgsl`, where it is told what they count.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct Counters {
    pub used: u32,
    pub free: u32,
    pub taken: u32,
    pub released: u32,
    pub refused: u32,
    pub max_depth_bits: u32,
}

/// [`crate::fusion::TsdfVolume`] on the device.
///
/// A voxel is one word: the distance, plus 32768, in its lower half and the weight in its upper half.
/// Unseen voxels are zero.
pub struct GpuVolume {
    pub(super) params: VolumeParams,
    pub(super) lattice: Lattice,
    pub(super) revision: u64,
    /// By block, x fastest: its slot, 0 without storage.
    pub(super) table: GpuBuffer<u32>,
    /// By block: the bricks that may hold surface.
    pub(super) crossings: GpuBuffer<[u32; 2]>,
    pub(super) pool: Pool,
    /// By block: what decides on its release, and what its crossings are made of.
    pub(super) lowest: GpuBuffer<i32>,
    pub(super) sides: GpuBuffer<[u32; 4]>,
    /// A bit for each block that the newest picture needs.
    pub(super) marks: GpuBuffer<u32>,
    /// How many blocks the newest picture may change, as workgroups.
    pub(super) groups: GpuBuffer<u32>,
    pub(super) counters: GpuBuffer<Counters>,
    counted: ReadBack<Counters>,
    /// Of the integration before the newest, while that is under way.
    newest: Counters,
    /// Blocks that found no room in that one.
    refused: usize,
    pub(super) kernels: Kernels,
}

pub(super) struct Kernels {
    pub mark: Shader,
    pub allocate: Shader,
    pub integrate: Shader,
    pub color: Shader,
    pub release: Shader,
    pub crossings: Shader,
    pub settle: Shader,
}

impl GpuVolume {
    /// An empty volume. `lattice` must have been made of `params`.
    pub fn new(gpu: &Gpu, params: &VolumeParams, lattice: Lattice) -> Result<Self, GpuError> {
        Self::with_blocks(gpu, params, lattice, lattice.blocks().min(most_blocks(gpu)))
    }

    /// With storage for this many blocks at most.
    pub(super) fn with_blocks(
        gpu: &Gpu,
        params: &VolumeParams,
        lattice: Lattice,
        most: usize,
    ) -> Result<Self, GpuError> {
        let blocks = lattice.blocks();
        let groups = GpuBuffer::with_usage(gpu, "groups", 3, BufferUsages::INDIRECT)?;
        groups.upload(gpu, &[0, 1, 1]);
        Ok(Self {
            params: params.clone(),
            lattice,
            revision: 0,
            table: GpuBuffer::new(gpu, "block table", blocks)?,
            crossings: GpuBuffer::new(gpu, "crossings", blocks)?,
            pool: Pool::new(gpu, &lattice, most, params.color)?,
            lowest: GpuBuffer::new(gpu, "lowest distances", blocks)?,
            sides: GpuBuffer::new(gpu, "sides of bricks", blocks)?,
            marks: GpuBuffer::new(gpu, "marked blocks", blocks.div_ceil(32))?,
            groups,
            counters: GpuBuffer::new(gpu, "volume counters", 1)?,
            counted: ReadBack::new(gpu, "volume counters", 1)?,
            newest: Counters::default(),
            refused: 0,
            kernels: Kernels {
                mark: shaders::mark(),
                allocate: shaders::allocate(),
                integrate: shaders::integrate(),
                color: shaders::color(),
                release: shaders::release(),
                crossings: shaders::crossings(),
                settle: shaders::settle(),
            },
        })
    }

    /// Forgets everything seen; keeps memory, for a cube elsewhere, of the same parameters.
    pub fn restart(&mut self, commands: &mut Commands<'_>, lattice: Lattice) {
        assert_eq!(lattice.grid, self.lattice.grid, "blocks a side");
        self.lattice = lattice;
        commands.clear(&self.table);
        commands.clear(&self.crossings);
        commands.clear(&self.lowest);
        commands.clear(&self.sides);
        commands.clear(&self.counters);
        (self.newest, self.refused) = (Counters::default(), 0);
        self.revision += 1;
    }

    /// Changes whenever the contents may have changed.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    pub fn params(&self) -> &VolumeParams {
        &self.params
    }

    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// Slot of each block, x fastest, 0 without storage: slot 0 is a block that stays unseen.
    pub fn table(&self) -> &GpuBuffer<u32> {
        &self.table
    }

    /// Words of voxels by slot.
    pub fn voxels(&self) -> &GpuBuffer<u32> {
        &self.pool.voxels
    }

    /// A bit for each of a block's bricks of 2x2x2 voxels that may hold surface, in the table's order.
    pub fn crossings(&self) -> &GpuBuffer<[u32; 2]> {
        &self.crossings
    }

    /// Blocks of 8x8x8 voxels that have storage after the newest integration, which must have been
    /// submitted; waits for it.
    ///
    /// # Errors
    /// [`FusionError::Full`] where blocks were refused storage.
    pub fn allocated_blocks(&mut self, gpu: &Gpu) -> Result<usize, FusionError> {
        self.take_counters(gpu)?;
        Ok(self.blocks_in_use())
    }

    fn blocks_in_use(&self) -> usize {
        (self.newest.used - self.newest.free) as usize
    }

    /// In use or refused, as the counters say that were taken last.
    pub(super) fn known_blocks(&self) -> usize {
        self.blocks_in_use() + self.refused
    }

    /// Bytes on the device.
    pub fn memory_bytes(&self) -> usize {
        let words = self.table.len() * (1 + 2 + 1 + 4) + self.marks.len();
        let fixed = size_of::<u32>() * (words + self.groups.len()) + size_of::<Counters>();
        fixed + self.pool.bytes()
    }

    pub(super) fn grid_uniform(&self) -> GridUniform {
        GridUniform { grid: self.lattice.grid as u32, capacity: self.pool.slots() as u32 }
    }

    fn voxels_a_side(&self) -> usize {
        self.lattice.grid * SIDE
    }

    /// Highest voxel coordinate.
    pub(in crate::gpu::stages) fn last_voxel(&self) -> f32 {
        (self.voxels_a_side() - 1) as f32
    }

    /// Of a stored distance.
    pub(in crate::gpu::stages) fn voxels_per_step(&self) -> f32 {
        self.lattice.truncation_voxels() / f32::from(ONE)
    }

    /// Of a ray, more than any takes: a diagonal of half voxels, and a jump over each brick on the way along
    /// every axis.
    pub(in crate::gpu::stages) fn most_steps(&self) -> u32 {
        8 * self.voxels_a_side() as u32
    }

    /// Has the counters copied when everything recorded so far is done.
    pub(super) fn request_counters(&mut self, commands: &mut Commands<'_>) {
        self.counted.request(commands, &self.counters, 1);
    }

    /// Takes the counters that were requested, if any. A picture may have brought more blocks than there was
    /// room for: these find it in the next one, unless the pool can't grow.
    pub(super) fn take_counters(&mut self, gpu: &Gpu) -> Result<(), FusionError> {
        let before = self.newest.refused;
        if let Some(&[counters]) = self.counted.take(gpu)?.as_deref() {
            self.refused = (counters.refused - before) as usize;
            self.newest = counters;
        }
        if self.refused > 0 && self.pool.is_at_its_limit() {
            return Err(FusionError::Full { blocks: self.pool.most(), refused: self.refused });
        }
        if self.refused > 0 && before == 0 {
            let (blocks, room) = (self.refused, self.pool.slots() - 1);
            log::warn!("{blocks} blocks of the volume found no room beside {room}: it grows now");
        }
        Ok(())
    }
}
