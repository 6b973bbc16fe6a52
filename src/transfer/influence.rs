//! Where virtual geometry can change visibility.

use super::batch::Batch;
use super::occluder::transformed;
use crate::geometry::{GBuffer, Origin};
use crate::image::Size;
use crate::math::{View, affine_from_pose};
use glam::{Affine3A, Vec2, Vec3};
use rayon::prelude::*;

/// Side of a tile in pixels.
const TILE: usize = 8;

/// The virtual pixels of a buffer, counted by tiles.
#[derive(Debug, Default)]
pub(super) struct VirtualFootprint {
    perspective: bool,
    view_from_main: Affine3A,
    scale: Vec2,
    centre: Vec2,
    image: Size,
    tiles: Size,
    occupied: Vec<u32>,
    /// Number of occupied tiles above and left of a corner: (width + 1) x (height + 1).
    sums: Vec<u32>,
}

impl VirtualFootprint {
    pub fn prepare(&mut self, buffer: &GBuffer, main: &View) {
        let view = &buffer.view;
        self.perspective = view.is_perspective();
        self.view_from_main =
            affine_from_pose(&(view.world_from_view.inverse() * main.world_from_view));
        (self.scale, self.centre) = view.scale_and_centre();
        self.image = buffer.size();
        self.tiles = Size::new(self.image.width.div_ceil(TILE), self.image.height.div_ceil(TILE));
        let (width, height) = (self.tiles.width, self.tiles.height);
        self.occupied.resize(width * height, 0);
        self.occupied.par_chunks_mut(width.max(1)).enumerate().for_each(|(j, out)| {
            let rows = j * TILE..((j + 1) * TILE).min(buffer.size().height);
            out.fill(0);
            for row in rows {
                for (tile, pixels) in out.iter_mut().zip(buffer.origin.row(row).chunks(TILE)) {
                    *tile |= u32::from(pixels.contains(&Origin::Virtual));
                }
            }
        });
        self.sums.resize((width + 1) * (height + 1), 0);
        self.sums.fill(0);
        for j in 0..height {
            let mut along = 0;
            for i in 0..width {
                along += self.occupied[j * width + i];
                let above = self.sums[j * (width + 1) + i + 1];
                self.sums[(j + 1) * (width + 1) + i + 1] = above + along;
            }
        }
    }

    pub fn any(&self) -> bool {
        self.sums.last().is_some_and(|&all| all > 0)
    }

    /// Whether any sample of the batch, at up to `radius_m`, may project onto a tile with virtual pixels.
    pub fn may_meet(&self, batch: &Batch, radius_m: f32) -> bool {
        if !self.any() {
            return false;
        }
        let x = transformed(&self.view_from_main, &batch.x);
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for i in (0..batch.count).filter(|&i| batch.valid[i]) {
            let point = Vec3::new(x[0][i], x[1][i], x[2][i]);
            (low, high) = (low.min(point), high.max(point));
        }
        // A little more for rounding.
        let reach = radius_m * 1.001 + 1e-4;
        self.box_meets(low - reach, high + reach)
    }

    /// `low` and `high` are corners of a box in view axes.
    fn box_meets(&self, low: Vec3, high: Vec3) -> bool {
        if !low.cmple(high).all() || (self.perspective && high.z <= 0.0) {
            return false;
        }
        let (near, far) = match self.perspective {
            // The box reaches to the camera: anywhere in the image.
            true if low.z <= 1e-3 => return true,
            true => (1.0 / low.z, 1.0 / high.z),
            false => (1.0, 1.0),
        };
        let (low, high) = (low.truncate(), high.truncate());
        let first = (low * near).min(low * far) * self.scale + self.centre;
        let last = (high * near).max(high * far) * self.scale + self.centre;
        // Rounding to the nearest pixel moves by up to one half.
        let (first, last) = (first - 1.0, last + 1.0);
        let size = Vec2::new(self.image.width as f32, self.image.height as f32);
        if last.cmplt(Vec2::ZERO).any() || first.cmpge(size).any() {
            return false;
        }
        let tile = |v: f32, most: usize| (v.max(0.0) as usize / TILE).min(most);
        let (i0, i1) = (tile(first.x, self.tiles.width), tile(last.x, self.tiles.width - 1) + 1);
        let (j0, j1) = (tile(first.y, self.tiles.height), tile(last.y, self.tiles.height - 1) + 1);
        let at = |i: usize, j: usize| self.sums[j * (self.tiles.width + 1) + i];
        at(i1, j1) + at(i0, j0) > at(i0, j1) + at(i1, j0)
    }
}
