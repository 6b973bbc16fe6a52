//! Memory for voxels, by slots of a block each. It grows with what is in use.

use crate::fusion::Lattice;
use crate::fusion::block::{SIDE, VOXELS};
use crate::gpu::{Commands, Gpu, GpuBuffer, GpuError};

/// Slots at most, the first one included, which stays unseen: as many words of voxels as WebGPU binds
/// everywhere, and as many workgroups as it runs.
const MOST_SLOTS: usize = 65536;

/// Slots are taken by so many: 1 MiB of voxels.
const STEP: usize = 512;

pub(super) struct Pool {
    /// Blocks at most.
    most: usize,
    /// Blocks that one picture may bring.
    reserve: usize,
    /// Words by slot.
    pub voxels: GpuBuffer<u32>,
    pub colors: Option<GpuBuffer<u32>>,
    /// Slots that came back.
    pub free: GpuBuffer<u32>,
    /// Blocks that the newest picture may change.
    pub work: GpuBuffer<u32>,
}

/// As many blocks as a binding holds.
pub(super) fn most_blocks(gpu: &Gpu) -> usize {
    let bytes = gpu.limits().max_storage_buffer_binding_size as usize;
    MOST_SLOTS.min(bytes / (VOXELS * size_of::<u32>())).max(2) - 1
}

impl Pool {
    /// For up to `most` blocks, with room for a few until the first picture.
    pub fn new(gpu: &Gpu, lattice: &Lattice, most: usize, color: bool) -> Result<Self, GpuError> {
        // a surface right across the volume and aslant, with the band around it
        let layers = 3 + (2.0 * lattice.truncation_voxels() / SIDE as f32).ceil() as usize;
        let reserve = layers * lattice.grid * lattice.grid;
        Self::with_slots(gpu, most, reserve, color, (most + 1).min(STEP))
    }

    pub fn with_slots(
        gpu: &Gpu,
        most: usize,
        reserve: usize,
        color: bool,
        slots: usize,
    ) -> Result<Self, GpuError> {
        let colors = || GpuBuffer::new(gpu, "voxel colours", slots * VOXELS);
        Ok(Self {
            most,
            reserve,
            voxels: GpuBuffer::new(gpu, "voxels", slots * VOXELS)?,
            colors: color.then(colors).transpose()?,
            free: GpuBuffer::new(gpu, "free slots", slots)?,
            work: GpuBuffer::new(gpu, "blocks to integrate", slots)?,
        })
    }

    pub fn slots(&self) -> usize {
        self.free.len()
    }

    pub fn most(&self) -> usize {
        self.most
    }

    pub fn bytes(&self) -> usize {
        let colors = self.colors.as_ref().map_or(0, GpuBuffer::len);
        size_of::<u32>() * (self.voxels.len() + colors + self.free.len() + self.work.len())
    }

    /// Whether it can't grow.
    pub fn is_at_its_limit(&self) -> bool {
        self.slots() > self.most
    }

    /// Makes room for a picture, where `blocks` are in use or wanted: for as many more, and for the reserve.
    /// Slots keep their contents and numbers.
    ///
    /// # Errors
    /// Where the device has no memory for `blocks`; for more than these, it goes on with what there is.
    /// Either way nothing has changed.
    pub fn make_room(
        &mut self,
        commands: &mut Commands<'_>,
        blocks: usize,
    ) -> Result<(), GpuError> {
        if self.is_at_its_limit() || self.slots() > blocks + blocks.max(self.reserve) {
            return Ok(());
        }
        let wanted = (blocks + self.reserve.max(2 * blocks) + 1).next_multiple_of(STEP);
        let slots = wanted.min(self.most + 1);
        let color = self.colors.is_some();
        match Self::with_slots(commands.gpu(), self.most, self.reserve, color, slots) {
            Ok(grown) => self.replace_by(commands, grown),
            Err(error) if error.is_out_of_memory() && self.slots() > blocks => {
                self.most = self.slots() - 1;
                log::warn!("the volume keeps room for {} blocks only: {error}", self.most);
            }
            Err(error) => return Err(error),
        }
        Ok(())
    }

    fn replace_by(&mut self, commands: &mut Commands<'_>, grown: Self) {
        commands.copy(&self.voxels, &grown.voxels, self.voxels.len());
        if let (Some(old), Some(new)) = (&self.colors, &grown.colors) {
            commands.copy(old, new, old.len());
        }
        commands.copy(&self.free, &grown.free, self.free.len());
        *self = grown;
    }
}
