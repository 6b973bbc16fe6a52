//! Distances between voxels: trilinear values and gradients.

use super::block::{BlockStore, EMPTY, ONE, SIDE, UNSEEN, VOXELS};
use glam::{IVec3, Vec3};

const SCALE: f32 = 1.0 / ONE as f32;
/// Block offset of the voxel one step along y, z.
const DY: usize = SIDE;
const DZ: usize = SIDE * SIDE;

/// Reads distances at voxel coordinates.
#[derive(Clone, Copy)]
pub(super) struct Sampler<'a> {
    store: &'a BlockStore,
    resolution: i32,
}

/// The eight distances around a point, x fastest, and the point's place between them.
pub(super) struct Cell {
    corners: [f32; 8],
    fraction: Vec3,
}

impl<'a> Sampler<'a> {
    pub fn new(store: &'a BlockStore) -> Self {
        Self { store, resolution: (store.grid * SIDE) as i32 }
    }

    /// Table index of the block around a voxel, which must lie in the volume.
    #[inline(always)]
    pub fn block_index(&self, voxel: IVec3) -> usize {
        let (b, grid): (IVec3, usize) = (voxel >> 3, self.store.grid);
        (b.z as usize * grid + b.y as usize) * grid + b.x as usize
    }

    /// Distances of a block by table index.
    #[inline(always)]
    pub fn block(&self, index: usize) -> Option<&'a [i16; VOXELS]> {
        match self.store.table[index] {
            EMPTY => None,
            slot => Some(&self.store.blocks[slot as usize].tsdf),
        }
    }

    /// The stored distance of a voxel; `UNSEEN` outside the volume and in empty blocks.
    #[inline]
    pub fn voxel(&self, voxel: IVec3) -> i16 {
        if voxel.min_element() < 0 || voxel.max_element() >= self.resolution {
            return UNSEEN;
        }
        self.block(self.block_index(voxel)).map_or(UNSEEN, |block| block[local(voxel)])
    }

    /// The cell around a point; `None` where one of its corners was not seen.
    #[inline]
    pub fn cell(&self, point: Vec3) -> Option<Cell> {
        let (base, fraction) = split(point);
        Some(Cell { corners: self.corners(base)?, fraction })
    }

    #[inline(always)]
    fn corners(&self, base: IVec3) -> Option<[f32; 8]> {
        let raw = if base.min_element() >= 0
            && base.max_element() < self.resolution
            && (base & 7).max_element() < 7
        {
            let first = local(base);
            let v = &self.block(self.block_index(base))?[first..first + 1 + DY + DZ + 1];
            [v[0], v[1], v[DY], v[DY + 1], v[DZ], v[DZ + 1], v[DZ + DY], v[DZ + DY + 1]]
        } else {
            self.corners_across_blocks(base)
        };
        (!raw.contains(&UNSEEN)).then(|| raw.map(|v| f32::from(v) * SCALE))
    }

    fn corners_across_blocks(&self, base: IVec3) -> [i16; 8] {
        std::array::from_fn(|i| {
            let i = i as i32;
            self.voxel(base + IVec3::new(i & 1, (i >> 1) & 1, i >> 2))
        })
    }

    /// Outward unit normal: central differences over two voxels, interpolated; where their
    /// surroundings were not seen, the gradient of the cell itself. It faces against `direction`.
    pub fn normal(&self, point: Vec3, direction: Vec3) -> Option<Vec3> {
        let against = |n: &Vec3| n.dot(direction) < 0.0;
        self.central_gradient(point)
            .and_then(Vec3::try_normalize)
            .filter(against)
            .or_else(|| self.cell(point)?.gradient().try_normalize().filter(against))
    }

    /// Gradient of a vertex on the surface, facing outwards.
    pub fn gradient(&self, point: Vec3) -> Option<Vec3> {
        self.central_gradient(point)
            .or_else(|| self.cell(point).map(|cell| cell.gradient()))
            .and_then(Vec3::try_normalize)
    }

    fn central_gradient(&self, point: Vec3) -> Option<Vec3> {
        let (base, f) = split(point);
        let v = self.surroundings(base - 1)?;
        let at = |x: usize, y: usize, z: usize| v[(z * 4 + y) * 4 + x];
        let mut sum = Vec3::ZERO;
        for z in 1..3 {
            for y in 1..3 {
                for x in 1..3 {
                    let weight = pick(f.x, x) * pick(f.y, y) * pick(f.z, z);
                    sum.x += weight * (at(x + 1, y, z) - at(x - 1, y, z));
                    sum.y += weight * (at(x, y + 1, z) - at(x, y - 1, z));
                    sum.z += weight * (at(x, y, z + 1) - at(x, y, z - 1));
                }
            }
        }
        Some(sum)
    }

    /// 4x4x4 voxels from `first`; `None` where one that a central difference reads was not seen.
    #[inline]
    fn surroundings(&self, first: IVec3) -> Option<[f32; 64]> {
        let mut values = [0.0; 64];
        if first.min_element() < 0 || first.max_element() + 3 >= self.resolution {
            return None;
        }
        let whole = (first & 7).max_element() <= 4;
        let block = if whole { Some(self.block(self.block_index(first))?) } else { None };
        for z in 0..4 {
            for y in 0..4 {
                let outer = usize::from(z == 0 || z == 3) + usize::from(y == 0 || y == 3);
                if outer == 2 {
                    continue; // an edge of the 4x4x4 cube: no difference reads it
                }
                let xs = if outer == 1 { 1..3 } else { 0..4 };
                let at = first + IVec3::new(0, y, z);
                let row = &mut values[(z * 4 + y) as usize * 4..][..4];
                for x in xs {
                    let raw = match block {
                        Some(block) => block[local(at) + x],
                        None => self.voxel_inside(at + IVec3::new(x as i32, 0, 0)),
                    };
                    if raw == UNSEEN {
                        return None;
                    }
                    row[x] = f32::from(raw);
                }
            }
        }
        Some(values)
    }

    #[inline(always)]
    fn voxel_inside(&self, voxel: IVec3) -> i16 {
        self.block(self.block_index(voxel)).map_or(UNSEEN, |block| block[local(voxel)])
    }
}

/// Lowest corner of the cell around a point, and the place within. Truncation rounds down, as
/// points in the volume have no negative coordinates, and is cheaper than `floor`.
#[inline(always)]
fn split(point: Vec3) -> (IVec3, Vec3) {
    let base = point.as_ivec3();
    (base, point - base.as_vec3())
}

/// Linear weight of the lower (1) or upper (2) of the inner samples.
#[inline(always)]
fn pick(fraction: f32, side: usize) -> f32 {
    if side == 1 { 1.0 - fraction } else { fraction }
}

/// Place of a voxel within its block.
#[inline(always)]
pub(super) fn local(voxel: IVec3) -> usize {
    let v = voxel & 7;
    (v.z as usize * SIDE + v.y as usize) * SIDE + v.x as usize
}

impl Cell {
    /// Derivative of the trilinear value per voxel.
    pub fn gradient(&self) -> Vec3 {
        let (c, f) = (&self.corners, self.fraction);
        let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let edge = |i: usize, step: usize| c[i + step] - c[i];
        Vec3::new(
            mix(mix(edge(0, 1), edge(2, 1), f.y), mix(edge(4, 1), edge(6, 1), f.y), f.z),
            mix(mix(edge(0, 2), edge(1, 2), f.x), mix(edge(4, 2), edge(5, 2), f.x), f.z),
            mix(mix(edge(0, 4), edge(1, 4), f.x), mix(edge(2, 4), edge(3, 4), f.x), f.y),
        )
    }
}
