//! Parameters of the kernels.

use crate::fusion::Lattice;
use crate::fusion::rays::{Rays, ViewFromVoxel};
use crate::gpu::uniform;
use crate::math::View;
use glam::Vec3;

uniform! {
    /// [`Rays`] of a view's pixels.
    pub struct RaysUniform {
        eye: [f32; 4],
        x: [f32; 4],
        y: [f32; 4],
        z: [f32; 4],
        centre: [f32; 2],
        per_pixel: [f32; 2],
        size: [u32; 2],
        perspective: u32,
        pad: u32,
    }
}

uniform! {
    /// [`ViewFromVoxel`], and how the view projects.
    pub struct ViewFromVoxelUniform {
        origin: [f32; 4],
        x: [f32; 4],
        y: [f32; 4],
        z: [f32; 4],
        scale: [f32; 2],
        centre: [f32; 2],
        size: [u32; 2],
        perspective: u32,
        pad: u32,
    }
}

uniform! {
    pub struct MarkUniform {
        rays: RaysUniform,
        truncation_m: f32,
        grid: u32,
        pad0: u32,
        pad1: u32,
    }
}

uniform! {
    pub struct FuseUniform {
        view: ViewFromVoxelUniform,
        voxel_m: f32,
        truncation_m: f32,
        max_weight: f32,
        free_weight: f32,
        grid: u32,
        capacity: u32,
        edge: f32,
        pad: u32,
    }
}

uniform! {
    pub struct GridUniform {
        grid: u32,
        capacity: u32,
    }
}

uniform! {
    pub struct TilesUniform {
        view: ViewFromVoxelUniform,
        voxel_m: f32,
        grid: u32,
        pad0: u32,
        pad1: u32,
    }
}

uniform! {
    pub struct RaycastUniform {
        rays: RaysUniform,
        last: f32,
        scale: f32,
        grid: u32,
        most_steps: u32,
    }
}

fn size_of_view(view: &View) -> [u32; 2] {
    let size = view.size();
    [size.width as u32, size.height as u32]
}

fn padded(v: Vec3) -> [f32; 4] {
    v.extend(0.0).to_array()
}

impl RaysUniform {
    pub fn new(lattice: &Lattice, view: &View) -> Self {
        let rays = Rays::new(lattice, view);
        Self {
            eye: padded(rays.eye),
            x: padded(rays.x),
            y: padded(rays.y),
            z: padded(rays.z),
            centre: rays.centre.to_array(),
            per_pixel: rays.per_pixel.to_array(),
            size: size_of_view(view),
            perspective: u32::from(rays.perspective),
            pad: 0,
        }
    }
}

impl ViewFromVoxelUniform {
    pub fn new(lattice: &Lattice, view: &View) -> Self {
        let from_voxel = ViewFromVoxel::new(lattice, view);
        let (scale, centre) = view.scale_and_centre();
        Self {
            origin: padded(from_voxel.origin),
            x: padded(from_voxel.x),
            y: padded(from_voxel.y),
            z: padded(from_voxel.z),
            scale: scale.to_array(),
            centre: centre.to_array(),
            size: size_of_view(view),
            perspective: u32::from(view.is_perspective()),
            pad: 0,
        }
    }
}
