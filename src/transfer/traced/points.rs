//! Surface points of pixels in world axes, sixteen at a time.

use super::super::directions::LANES;
use crate::geometry::GBuffer;
use crate::math::View;
use glam::{Affine3A, Vec2, Vec3};

pub(super) type Lanes = [f32; LANES];
/// 1 or 0 a lane.
pub(super) type Mask = [u32; LANES];

/// What a pixel shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Surface {
    pub position: Vec3,
    pub normal: Vec3,
}

/// Takes pixels of a buffer to points of the world.
#[derive(Clone, Copy)]
pub(super) struct Surfaces<'a> {
    pub buffer: &'a GBuffer,
    perspective: bool,
    inverse_scale: Vec2,
    centre: Vec2,
    world_from_view: Affine3A,
}

impl<'a> Surfaces<'a> {
    pub fn new(buffer: &'a GBuffer) -> Self {
        let view: &View = &buffer.view;
        let (scale, centre) = view.scale_and_centre();
        Self {
            buffer,
            perspective: view.is_perspective(),
            inverse_scale: 1.0 / scale,
            centre,
            world_from_view: view.world_from_view_f32(),
        }
    }

    /// `None` where depth is missing, or the normal is not of about unit length (NaN included).
    #[inline(always)]
    pub fn at(&self, x: usize, y: usize) -> Option<Surface> {
        let depth_m = self.buffer.depth_m.row(y)[x];
        let normal = self.buffer.normals.at(x, y);
        let squared = normal.length_squared();
        if !(depth_m > 0.0 && depth_m < f32::INFINITY && squared > 0.25 && squared < 4.0) {
            return None;
        }
        let w = if self.perspective { depth_m } else { 1.0 };
        let aside = (Vec2::new(x as f32, y as f32) - self.centre) * self.inverse_scale * w;
        let position = self.world_from_view.transform_point3(aside.extend(depth_m));
        Some(Surface { position, normal })
    }
}

/// Up to sixteen pixels of a row, and their places in a row of results.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Picked {
    pub count: usize,
    pub columns: [u32; LANES],
    pub slots: [u32; LANES],
}

impl Picked {
    pub fn push(&mut self, column: usize, slot: usize) {
        (self.columns[self.count], self.slots[self.count]) = (column as u32, slot as u32);
        self.count += 1;
    }

    pub fn is_full(&self) -> bool {
        self.count == LANES
    }

    /// The lanes in use: column and slot.
    pub fn lanes(&self) -> impl Iterator<Item = (usize, usize, usize)> + '_ {
        (0..self.count).map(|i| (i, self.columns[i] as usize, self.slots[i] as usize))
    }
}

/// The surface points of picked pixels; lanes without surface have a zero normal.
pub(super) struct Points {
    pub valid: Mask,
    pub position: [Lanes; 3],
    pub normal: [Lanes; 3],
}

impl Points {
    pub fn gather(surfaces: &Surfaces, y: usize, picked: &Picked) -> Self {
        let mut points =
            Self { valid: [0; LANES], position: [[0.0; LANES]; 3], normal: [[0.0; LANES]; 3] };
        for (lane, x, _) in picked.lanes() {
            let Some(surface) = surfaces.at(x, y) else { continue };
            points.valid[lane] = 1;
            for axis in 0..3 {
                points.position[axis][lane] = surface.position[axis];
                points.normal[axis][lane] = surface.normal[axis];
            }
        }
        points
    }

    pub fn any(&self) -> bool {
        self.valid.contains(&1)
    }

    /// Lifted off the surface along the normal.
    #[inline(always)]
    pub fn lifted(&self, lift_m: f32) -> [Lanes; 3] {
        let mut out = self.position;
        for axis in 0..3 {
            for i in 0..LANES {
                out[axis][i] += lift_m * self.normal[axis][i];
            }
        }
        out
    }

    /// max(0, n.w) of each lane.
    #[inline(always)]
    pub fn cosines(&self, w: Vec3) -> Lanes {
        let mut out = [0.0; LANES];
        for i in 0..LANES {
            let dot = self.normal[0][i] * w.x + self.normal[1][i] * w.y + self.normal[2][i] * w.z;
            out[i] = if dot > 0.0 { dot } else { 0.0 };
        }
        out
    }

    /// Centre and radius of a sphere around all points.
    pub fn bounds(&self) -> (Vec3, f32) {
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for i in (0..LANES).filter(|&i| self.valid[i] == 1) {
            let p = self.point(i);
            (low, high) = (low.min(p), high.max(p));
        }
        (0.5 * (low + high), 0.5 * (high - low).length())
    }

    fn point(&self, lane: usize) -> Vec3 {
        Vec3::from(self.position.map(|p| p[lane]))
    }
}
