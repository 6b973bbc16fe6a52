//! Depth and normals of the volume's surfaces in a view, perspective or orthographic.

use super::TsdfVolume;
use super::block::{ONE, SIDE, UNSEEN};
use super::rays::Rays;
use super::sample::{Sampler, local};
use super::tiles::{TILE, TileMap};
use crate::geometry::{GBuffer, Origin};
use crate::math::View;
use glam::{IVec3, Vec3};
use rayon::prelude::*;
use std::sync::PoisonError;

/// Shortest step, voxels: half a voxel finds every crossing that trilinear values can show twice.
const MIN_STEP: f32 = 0.5;
/// Share of the distance to the surface that a step covers. Projective distances are longer than
/// true ones on slanted surfaces.
const STEP_SHARE: f32 = 0.8;
/// The stored voxel looked at instead of the trilinear value lies within a voxel's diagonal.
const DIAGONAL: f32 = 1.75;
/// A crossing is refined until its distance is below this, voxels, or for `REFINEMENTS` steps.
const CLOSE: f32 = 0.01;
const REFINEMENTS: usize = 4;
/// Step past the border of an empty block, voxels.
const NUDGE: f32 = 0.01;
/// Surfaces nearer than this are not seen; depth 0 means missing.
const NEAREST_M: f32 = 1e-3;

impl TsdfVolume {
    /// Casts a ray through every pixel centre. A surface is where distances along the ray turn
    /// from positive to negative (a front face) between voxels that were seen. Normals are
    /// gradients of the distance; pixels without surface hold depth 0, normal 0 and no origin.
    pub fn raycast(&self, view: &View, out: &mut GBuffer) {
        out.set_view(*view);
        let size = view.size();
        if self.is_empty() || size.pixels() == 0 {
            clear(out);
            return;
        }
        let mut tiles = self.take_tiles();
        tiles.draw(self, view);
        let caster = Caster::new(self, view);
        let rows = size.width * TILE;
        let GBuffer { depth_m, normals, origin, .. } = out;
        let depth = depth_m.as_mut_slice().par_chunks_mut(rows);
        let x = normals.x.as_mut_slice().par_chunks_mut(rows);
        let y = normals.y.as_mut_slice().par_chunks_mut(rows);
        let z = normals.z.as_mut_slice().par_chunks_mut(rows);
        let origin = origin.as_mut_slice().par_chunks_mut(rows);
        (depth, (x, y, z), origin).into_par_iter().enumerate().for_each(
            |(tile_y, (depth, normals, origin))| {
                let rows = TileRow { width: size.width, depth, normals, origin };
                caster.cast_tile_row(&tiles, tile_y, rows);
            },
        );
        *self.tiles.lock().unwrap_or_else(PoisonError::into_inner) = tiles;
    }

    /// Scratch memory; a second cast at the same time makes its own.
    fn take_tiles(&self) -> TileMap {
        std::mem::take(&mut *self.tiles.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

fn clear(out: &mut GBuffer) {
    out.depth_m.fill(0.0);
    out.normals.x.fill(0.0);
    out.normals.y.fill(0.0);
    out.normals.z.fill(0.0);
    out.origin.fill(Origin::None);
}

/// Eight rows of a geometry buffer, fewer at the bottom.
struct TileRow<'a> {
    width: usize,
    depth: &'a mut [f32],
    normals: (&'a mut [f32], &'a mut [f32], &'a mut [f32]),
    origin: &'a mut [Origin],
}

impl TileRow<'_> {
    fn set(&mut self, at: usize, hit: Option<(f32, Vec3)>) {
        let (depth, normal) = hit.unwrap_or_default();
        self.depth[at] = depth;
        self.normals.0[at] = normal.x;
        self.normals.1[at] = normal.y;
        self.normals.2[at] = normal.z;
        self.origin[at] = if hit.is_some() { Origin::Model } else { Origin::None };
    }
}

/// A ray along an axis never crosses the planes of the others: far away, not 0/0.
fn away_from_zero(component: f32) -> f32 {
    if component.abs() < 1e-9 { 1e-9 } else { component }
}

struct Caster<'a> {
    sampler: Sampler<'a>,
    rays: Rays,
    /// Highest voxel coordinate.
    last: f32,
    truncation_voxels: f32,
}

impl<'a> Caster<'a> {
    fn new(volume: &'a TsdfVolume, view: &View) -> Self {
        Self {
            sampler: volume.sampler(),
            rays: Rays::new(volume, view),
            last: (volume.params.resolution - 1) as f32,
            truncation_voxels: volume.truncation_m / volume.voxel_m,
        }
    }

    fn cast_tile_row(&self, tiles: &TileMap, tile_y: usize, mut rows: TileRow<'_>) {
        let (width, height) = (rows.width, rows.depth.len() / rows.width);
        for tile_x in 0..width.div_ceil(TILE) {
            let range = tiles.range(tile_x, tile_y);
            for y in 0..height {
                for x in tile_x * TILE..((tile_x + 1) * TILE).min(width) {
                    let (origin, direction) = self.rays.at(x as f32, (tile_y * TILE + y) as f32);
                    let direction = direction.map(away_from_zero);
                    rows.set(y * width + x, self.hit(origin, direction, range));
                }
            }
        }
    }

    /// Depth and normal of the first front face between two depths.
    fn hit(&self, origin: Vec3, direction: Vec3, range: (f32, f32)) -> Option<(f32, Vec3)> {
        let (near, far) = self.clip(origin, direction, range)?;
        let t = self.march(origin, direction, near, far)?;
        Some((t, self.sampler.normal(origin + direction * t, direction)?))
    }

    /// The part of a depth range that lies in the volume.
    fn clip(&self, origin: Vec3, direction: Vec3, range: (f32, f32)) -> Option<(f32, f32)> {
        let (a, b) = (-origin / direction, (self.last - origin) / direction);
        let near = a.min(b).max_element().max(range.0).max(NEAREST_M);
        let far = a.max(b).min_element().min(range.1);
        (near < far).then_some((near, far))
    }

    fn march(&self, origin: Vec3, direction: Vec3, near: f32, far: f32) -> Option<f32> {
        let per_voxel = direction.length_recip();
        let inverse = direction.recip();
        let mut t = near;
        // the last sample in front of a surface: place and distance
        let mut front: Option<(f32, f32)> = None;
        let top = IVec3::splat(self.last as i32);
        while t <= far {
            let point = (origin + direction * t).clamp(Vec3::ZERO, Vec3::splat(self.last));
            let voxel = (point + 0.5).as_ivec3().min(top);
            let Some(block) = self.sampler.block(self.sampler.block_index(voxel)) else {
                front = None;
                t = (t + NUDGE * per_voxel).max(self.leave(voxel, origin, inverse));
                continue;
            };
            let stored = block[local(voxel)];
            if stored == UNSEEN {
                front = None;
                t += MIN_STEP * per_voxel;
                continue;
            }
            let voxels = f32::from(stored) * (self.truncation_voxels / f32::from(ONE));
            if voxels > DIAGONAL + MIN_STEP {
                front = Some((t, voxels));
                t += (voxels - DIAGONAL).max(MIN_STEP) * per_voxel;
                continue;
            }
            let Some(value) = self.sampler.value(point) else {
                front = None;
                t += MIN_STEP * per_voxel;
                continue;
            };
            let distance = value * self.truncation_voxels;
            if distance > 0.0 {
                front = Some((t, distance));
            } else if let Some(hit) =
                front.take().and_then(|f| self.refine(origin, direction, f, (t, distance)))
            {
                return Some(hit);
            }
            t += (distance.abs() * STEP_SHARE).max(MIN_STEP) * per_voxel;
        }
        None
    }

    /// Depth just past the block around a voxel.
    #[inline]
    fn leave(&self, voxel: IVec3, origin: Vec3, inverse: Vec3) -> f32 {
        // a voxel's share of space ends half a voxel from its centre
        let low = (voxel & !7).as_vec3() - 0.5;
        let exits = ((low - origin) * inverse).max((low + SIDE as f32 - origin) * inverse);
        exits.min_element() + NUDGE * inverse.abs().min_element()
    }

    /// Regula falsi (Illinois) between a place in front of the surface and one behind.
    fn refine(
        &self,
        origin: Vec3,
        direction: Vec3,
        (mut a, mut fa): (f32, f32),
        (mut b, mut fb): (f32, f32),
    ) -> Option<f32> {
        let mut t = b;
        for _ in 0..REFINEMENTS {
            t = a + (b - a) * fa / (fa - fb);
            let value = self.sampler.value(origin + direction * t)? * self.truncation_voxels;
            if value.abs() < CLOSE {
                return Some(t);
            }
            if value > 0.0 {
                (a, fa, fb) = (t, value, 0.5 * fb);
            } else {
                (b, fb, fa) = (t, value, 0.5 * fa);
            }
        }
        Some(t)
    }
}
