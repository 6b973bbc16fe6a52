//! Depth and normals of the volume's surfaces in a view, perspective or orthographic.

use super::TsdfVolume;
use super::packet::{self, Field, Hits, LANES, Packet};
use super::rays::Rays;
use super::tiles::{TILE, TileMap};
use crate::geometry::{GBuffer, Origin};
use crate::math::View;
use glam::Vec3;
use rayon::prelude::*;
use std::sync::PoisonError;

/// Surfaces nearer than this are not seen; depth 0 means missing.
pub(crate) const NEAREST_M: f32 = 1e-3;

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
    fn set(&mut self, at: usize, hits: &Hits, lane: usize) {
        let depth = hits.depth_m[lane];
        self.depth[at] = depth;
        self.normals.0[at] = hits.normal[0][lane];
        self.normals.1[at] = hits.normal[1][lane];
        self.normals.2[at] = hits.normal[2][lane];
        self.origin[at] = if depth > 0.0 { Origin::Model } else { Origin::None };
    }
}

/// Components of a direction, voxels per metre, are not smaller.
pub(crate) const LEAST_COMPONENT: f32 = 1e-9;

/// A ray along an axis never crosses the planes of the others: far away, not 0/0.
pub(super) fn away_from_zero(component: f32) -> f32 {
    if component.abs() < LEAST_COMPONENT { LEAST_COMPONENT } else { component }
}

/// Rows of a tile that one packet covers.
const PACKET_ROWS: usize = LANES / TILE;

struct Caster<'a> {
    field: Field<'a>,
    rays: Rays,
}

impl<'a> Caster<'a> {
    fn new(volume: &'a TsdfVolume, view: &View) -> Self {
        Self { field: Field::of(volume), rays: Rays::new(&volume.lattice, view) }
    }

    fn cast_tile_row(&self, tiles: &TileMap, tile_y: usize, mut rows: TileRow<'_>) {
        let height = rows.depth.len() / rows.width;
        for tile_x in 0..rows.width.div_ceil(TILE) {
            let range = tiles.range(tile_x, tile_y);
            for y in (0..height).step_by(PACKET_ROWS) {
                let (x, image_y) = (tile_x * TILE, tile_y * TILE + y);
                let hits = if range.0 < range.1 {
                    packet::cast(&self.field, &self.packet(x, image_y, range))
                } else {
                    Hits::default()
                };
                for lane in 0..LANES {
                    let (x, y) = (x + lane % TILE, y + lane / TILE);
                    if x < rows.width && y < height {
                        rows.set(y * rows.width + x, &hits, lane);
                    }
                }
            }
        }
    }

    /// Rays of 8x2 pixels. Those past the image's border are cast as well, and not stored.
    fn packet(&self, x: usize, y: usize, range: (f32, f32)) -> Packet {
        let mut packet = Packet::default();
        for lane in 0..LANES {
            let (u, v) = ((x + lane % TILE) as f32, (y + lane / TILE) as f32);
            let (origin, direction) = self.rays.at(u, v);
            let direction = direction.map(away_from_zero);
            for axis in 0..3 {
                packet.origin[axis][lane] = origin[axis];
                packet.direction[axis][lane] = direction[axis];
            }
            (packet.near[lane], packet.far[lane]) = self.clip(origin, direction, range);
        }
        packet
    }

    /// The part of a depth range that lies in the volume; `near > far` where there is none.
    fn clip(&self, origin: Vec3, direction: Vec3, range: (f32, f32)) -> (f32, f32) {
        let (a, b) = (-origin / direction, (self.field.last - origin) / direction);
        let near = a.min(b).max_element().max(range.0).max(NEAREST_M);
        (near, a.max(b).min_element().min(range.1))
    }
}
