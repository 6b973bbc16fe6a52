//! A depth picture enters the volume.

use super::GpuVolume;
use super::uniforms::{FuseUniform, MarkUniform, RaysUniform, ViewFromVoxelUniform};
use crate::fusion::FusionError;
use crate::fusion::integrate::edge;
use crate::gpu::stages::FramePictures;
use crate::gpu::{Commands, GpuError};
use crate::math::View;
use crate::timing::Stage;

impl GpuVolume {
    /// Records the averaging of a frame's depth, seen in `view`, into the volume, as
    /// [`crate::fusion::TsdfVolume::integrate`] does. `index` is the frame's, for errors. The
    /// integration before must have been submitted: its counters are waited for.
    ///
    /// # Errors
    /// Where the frame does not fit, and [`FusionError::Full`] where an earlier one did not find room:
    /// what that one did shows when the device is done with it.
    pub fn integrate(
        &mut self,
        commands: &mut Commands<'_>,
        frame: &FramePictures,
        index: usize,
        view: &View,
    ) -> Result<(), FusionError> {
        let size = frame.size;
        if size != view.size() {
            return Err(FusionError::Size { frame: index, depth: size, view: view.size() });
        }
        let from_voxel = ViewFromVoxelUniform::new(&self.lattice, view);
        if ![from_voxel.origin, from_voxel.x, from_voxel.y].iter().flatten().all(|v| v.is_finite())
        {
            return Err(FusionError::Pose { frame: index });
        }
        if size.pixels() == 0 {
            return Ok(());
        }
        self.take_counters(commands.gpu())?;
        self.revision += 1;
        commands.stage(Stage::Reconstruct);
        let blocks = match self.known_blocks() {
            0 => self.blocks_wanted(commands, frame, view)?,
            blocks => blocks,
        };
        self.pool.make_room(commands, blocks)?;
        let fuse = self.fuse_uniform(from_voxel, view);
        self.mark(commands, frame, view)?;
        self.allocate(commands, &fuse)?;
        self.fuse(commands, frame, &fuse)?;
        self.survey(commands)?;
        self.request_counters(commands);
        Ok(())
    }

    fn fuse_uniform(&self, from_voxel: ViewFromVoxelUniform, view: &View) -> FuseUniform {
        let max_weight = f32::from(self.params.max_weight);
        FuseUniform {
            view: from_voxel,
            voxel_m: self.lattice.voxel_m,
            truncation_m: self.lattice.truncation_m,
            max_weight,
            free_weight: f32::from(self.params.free_weight).min(max_weight),
            grid: self.lattice.grid as u32,
            capacity: self.pool.slots() as u32,
            edge: edge(view),
            pad: 0,
        }
    }

    /// How many blocks a picture needs; waits for it.
    fn blocks_wanted(
        &self,
        commands: &mut Commands<'_>,
        frame: &FramePictures,
        view: &View,
    ) -> Result<usize, GpuError> {
        self.mark(commands, frame, view)?;
        commands.flush()?;
        let marks = self.marks.download(commands.gpu())?;
        Ok(marks.iter().map(|word| word.count_ones() as usize).sum())
    }

    /// Marks the blocks that the picture needs.
    fn mark(
        &self,
        commands: &mut Commands<'_>,
        frame: &FramePictures,
        view: &View,
    ) -> Result<(), GpuError> {
        let mark = MarkUniform {
            rays: RaysUniform::new(&self.lattice, view),
            truncation_m: self.lattice.truncation_m,
            grid: self.lattice.grid as u32,
            pad0: 0,
            pad1: 0,
        };
        commands.clear(&self.marks);
        commands
            .pass(&self.kernels.mark)?
            .uniform(&mark)?
            .read(&frame.depth_m)?
            .write(&self.marks)?
            .write(&self.counters)?
            .over(frame.size)
    }

    /// Gives storage to marked blocks, and lists those that the picture may change.
    fn allocate(&self, commands: &mut Commands<'_>, fuse: &FuseUniform) -> Result<(), GpuError> {
        commands
            .pass(&self.kernels.allocate)?
            .uniform(fuse)?
            .read(&self.marks)?
            .read(&self.pool.free)?
            .write(&self.table)?
            .write(&self.counters)?
            .write(&self.groups)?
            .write(&self.pool.work)?
            .over_count(self.lattice.blocks())
    }

    fn fuse(
        &self,
        commands: &mut Commands<'_>,
        frame: &FramePictures,
        fuse: &FuseUniform,
    ) -> Result<(), GpuError> {
        if let Some(colors) = &self.pool.colors {
            commands
                .pass(&self.kernels.color)?
                .uniform(fuse)?
                .read(&frame.depth_m)?
                .read(&frame.color_srgb)?
                .read(&self.table)?
                .read(&self.pool.work)?
                .write(colors)?
                .workgroups_from(&self.groups)?;
        }
        commands
            .pass(&self.kernels.integrate)?
            .uniform(fuse)?
            .read(&frame.depth_m)?
            .read(&self.table)?
            .read(&self.pool.work)?
            .write(&self.pool.voxels)?
            .write(&self.lowest)?
            .write(&self.sides)?
            .workgroups_from(&self.groups)
    }

    /// Releases free blocks, finds where surface may be, and settles the counts.
    fn survey(&self, commands: &mut Commands<'_>) -> Result<(), GpuError> {
        let (grid, blocks) = (self.grid_uniform(), self.lattice.blocks());
        commands
            .pass(&self.kernels.release)?
            .uniform(&grid)?
            .read(&self.marks)?
            .read(&self.lowest)?
            .write(&self.table)?
            .write(&self.sides)?
            .write(&self.pool.free)?
            .write(&self.counters)?
            .over_count(blocks)?;
        commands
            .pass(&self.kernels.crossings)?
            .uniform(&grid)?
            .read(&self.table)?
            .read(&self.sides)?
            .write(&self.crossings)?
            .over_count(blocks)?;
        commands
            .pass(&self.kernels.settle)?
            .uniform(&grid)?
            .write(&self.counters)?
            .write(&self.groups)?
            .workgroups([1; 3])
    }
}
