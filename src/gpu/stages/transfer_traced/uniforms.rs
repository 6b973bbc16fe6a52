//! Parameters of the kernels.

use super::level::Level;
use crate::gpu::stages::GpuVolume;
use crate::gpu::uniform;
use crate::math::View;
use crate::math::sh::{self, MAX_BANDS};
use crate::transfer::TransferParams;
use crate::transfer::traced::{OBJECT_LIFT_M, Smooth, volume_lift_m};
use glam::Mat4;

uniform! {
    pub struct TracedUniform {
        world_from_view: [[f32; 4]; 4],
        lobe: [[f32; 4]; MAX_BANDS * MAX_BANDS / 4],
        inverse_scale: [f32; 2],
        centre: [f32; 2],
        image: [u32; 2],
        perspective: u32,
        directions: u32,
        points: [u32; 2],
        step: u32,
        coarse_step: u32,
        coarse: [u32; 2],
        smooth_cosine: f32,
        smooth_m: f32,
        min_corner: [f32; 4],
        last: f32,
        scale: f32,
        voxel_m: f32,
        grid: u32,
        most_steps: u32,
        instances: u32,
        reach_m: f32,
        lift_m: f32,
        object_lift_m: f32,
        pad0: u32,
        pad1: u32,
        pad2: u32,
    }
}

impl TracedUniform {
    /// For the points of `coarse`; [`Self::of`] takes another level.
    pub fn new(
        params: &TransferParams,
        volume: &GpuVolume,
        view: &View,
        coarse: &Level,
        instances: usize,
    ) -> Self {
        let (scale, centre) = view.scale_and_centre();
        let (size, lattice, smooth) = (view.size(), volume.lattice(), Smooth::new(params));
        Self {
            world_from_view: Mat4::from(view.world_from_view_f32()).to_cols_array_2d(),
            lobe: bytemuck::cast(sh::lobe_factors()),
            inverse_scale: (1.0 / scale).to_array(),
            centre: centre.to_array(),
            image: [size.width as u32, size.height as u32],
            perspective: u32::from(view.is_perspective()),
            directions: params.directions as u32,
            points: coarse.points(),
            step: coarse.step as u32,
            coarse_step: coarse.step as u32,
            coarse: coarse.points(),
            smooth_cosine: smooth.cosine,
            smooth_m: smooth.depth_m,
            min_corner: lattice.min_corner.extend(0.0).to_array(),
            last: volume.last_voxel(),
            scale: volume.voxels_per_step(),
            voxel_m: lattice.voxel_m,
            grid: lattice.grid as u32,
            most_steps: volume.most_steps(),
            instances: instances as u32,
            reach_m: params.ray_length_m,
            lift_m: volume_lift_m(params, lattice.voxel_m),
            object_lift_m: OBJECT_LIFT_M,
            pad0: 0,
            pad1: 0,
            pad2: 0,
        }
    }

    /// The same for the points of a level.
    pub fn of(mut self, level: &Level) -> Self {
        (self.points, self.step) = (level.points(), level.step as u32);
        self
    }
}
