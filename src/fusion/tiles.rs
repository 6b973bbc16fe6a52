//! Where along a ray surfaces can lie at all: depth ranges of 8x8-pixel tiles, drawn from the
//! boxes of the blocks that hold surface (after Kaehler et al., "Very high frame rate volumetric
//! integration of depth images on mobile devices", 2015).

use super::TsdfVolume;
use super::block::SIDE;
use super::crossings::octant_bricks;
use super::packet::MAX_STEP;
use super::rays::ViewFromVoxel;
use crate::image::Size;
use crate::math::View;
use glam::{Vec2, Vec3};

/// Pixels a side of a tile.
pub(crate) const TILE: usize = 8;
/// Boxes nearer than this cannot be projected: they may cover the whole picture.
pub(crate) const NEAREST_M: f32 = 1e-3;

/// Voxels a side of an octant of a block.
pub(crate) const OCTANT: f32 = (SIDE / 2) as f32;
/// An octant's voxels reach half a voxel beyond their centres; the rest is against rounding.
pub(crate) const MARGIN: f32 = 0.6;

/// Depth range of each tile; `near > far` where no surface can be.
#[derive(Debug, Default)]
pub(super) struct TileMap {
    width: usize,
    height: usize,
    ranges: Vec<(f32, f32)>,
}

impl TileMap {
    pub fn range(&self, tile_x: usize, tile_y: usize) -> (f32, f32) {
        self.ranges[tile_y * self.width + tile_x]
    }

    fn clear(&mut self, size: Size) {
        self.width = size.width.div_ceil(TILE);
        self.height = size.height.div_ceil(TILE);
        self.ranges.clear();
        self.ranges.resize(self.width * self.height, (f32::INFINITY, 0.0));
    }

    /// Draws every octant of a block that may hold surface.
    pub fn draw(&mut self, volume: &TsdfVolume, view: &View) {
        self.clear(view.size());
        let from_voxel = ViewFromVoxel::new(&volume.lattice, view);
        for (index, &bricks) in volume.store.crossings.iter().enumerate() {
            if bricks == 0 {
                continue;
            }
            let low = volume.store.coords(index).map(|v| f32::from(v) * SIDE as f32);
            for octant in (0..8).filter(|&octant| bricks & octant_bricks(octant) != 0) {
                let low = Vec3::from(low) + corner(octant) * OCTANT;
                self.draw_box(view, &from_voxel, low - MARGIN, volume.lattice.voxel_m);
            }
        }
    }

    fn draw_box(&mut self, view: &View, from_voxel: &ViewFromVoxel, low: Vec3, voxel_m: f32) {
        let (scale, centre) = view.scale_and_centre();
        let (mut near, mut far) = (f32::INFINITY, f32::NEG_INFINITY);
        let (mut min, mut max) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
        for i in 0..8 {
            let p = from_voxel.apply(low + corner(i) * (OCTANT + 2.0 * MARGIN - 1.0));
            (near, far) = (near.min(p.z), far.max(p.z));
            let w = if view.is_perspective() { p.z.max(NEAREST_M) } else { 1.0 };
            let pixel = p.truncate() * scale / w + centre;
            (min, max) = (min.min(pixel), max.max(pixel));
        }
        if far <= NEAREST_M {
            return;
        }
        if view.is_perspective() && near <= NEAREST_M {
            (min, max) = (Vec2::ZERO, Vec2::splat(f32::MAX));
        }
        // one pixel more against rounding; casts saturate
        let last = |pixels: usize, tiles: usize| (pixels.saturating_add(1) / TILE).min(tiles - 1);
        if max.x < -1.0 || max.y < -1.0 || self.ranges.is_empty() {
            return;
        }
        let x = (min.x - 1.0) as usize / TILE..=last(max.x as usize, self.width);
        let y = (min.y - 1.0) as usize / TILE..=last(max.y as usize, self.height);
        for ty in y {
            for tx in x.clone() {
                let range = &mut self.ranges[ty * self.width + tx];
                *range = (range.0.min(near), range.1.max(far + MAX_STEP * voxel_m));
            }
        }
    }
}

/// Corner of a cube of side 1, x fastest.
fn corner(i: u32) -> Vec3 {
    Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32)
}
