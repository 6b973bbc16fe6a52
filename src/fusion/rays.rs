//! Rays of a view in a volume's voxel coordinates.

use super::Lattice;
use crate::math::View;
use glam::{Vec2, Vec3};

/// Ray of a pixel: `origin + direction * depth_m`, for both projections.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rays {
    pub eye: Vec3,
    /// Voxels along the view's axes per metre.
    pub x: Vec3,
    pub y: Vec3,
    pub z: Vec3,
    pub centre: Vec2,
    pub per_pixel: Vec2,
    pub perspective: bool,
}

impl Rays {
    pub fn new(lattice: &Lattice, view: &View) -> Self {
        let world_from_view = view.world_from_view_f32();
        let axes = world_from_view.matrix3 * (1.0 / lattice.voxel_m);
        let (scale, centre) = view.scale_and_centre();
        Self {
            eye: lattice.voxel_from_world(world_from_view.translation.into()),
            x: axes.x_axis.into(),
            y: axes.y_axis.into(),
            z: axes.z_axis.into(),
            centre,
            per_pixel: scale.recip(),
            perspective: view.is_perspective(),
        }
    }

    /// Origin and direction of the ray through a pixel.
    #[inline(always)]
    pub fn at(&self, u: f32, v: f32) -> (Vec3, Vec3) {
        let offset = (Vec2::new(u, v) - self.centre) * self.per_pixel;
        let aside = self.x * offset.x + self.y * offset.y;
        if self.perspective { (self.eye, aside + self.z) } else { (self.eye + aside, self.z) }
    }
}

/// Linear map from voxel coordinates to a view's axes, metres.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ViewFromVoxel {
    pub origin: Vec3,
    pub x: Vec3,
    pub y: Vec3,
    pub z: Vec3,
}

impl ViewFromVoxel {
    pub fn new(lattice: &Lattice, view: &View) -> Self {
        let view_from_world = view.view_from_world_f32();
        let axes = view_from_world.matrix3 * lattice.voxel_m;
        Self {
            origin: view_from_world.transform_point3(lattice.world_from_voxel(Vec3::ZERO)),
            x: axes.x_axis.into(),
            y: axes.y_axis.into(),
            z: axes.z_axis.into(),
        }
    }

    #[inline(always)]
    pub fn apply(&self, p: Vec3) -> Vec3 {
        self.origin + self.x * p.x + self.y * p.y + self.z * p.z
    }
}
