//! Which bricks of 2x2x2 voxels may hold surface: rays pass all others without reading voxels.

use super::block::{BlockStore, SIDE, UNSEEN, VOXELS};
use rayon::prelude::*;

/// A bit for each of a block's 4x4x4 bricks, x fastest.
pub(crate) type Bricks = u64;

/// Bricks with a voxel in front of a surface, and with one on it or behind it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sides {
    front: Bricks,
    behind: Bricks,
}

/// Bricks along a block's side.
const ACROSS: usize = SIDE / 2;

/// Bricks of an octant of a block, octants counted x fastest.
pub(super) fn octant_bricks(octant: u32) -> Bricks {
    FIRST_OCTANT << ((octant & 1) * 2 + (octant >> 1 & 1) * 8 + (octant >> 2) * 32)
}

/// The 2x2x2 first bricks of a block.
pub(crate) const FIRST_OCTANT: Bricks = 0x0033_0033;

impl Sides {
    #[inline(always)]
    pub fn of(tsdf: &[i16; VOXELS]) -> Self {
        let mut sides = Self::default();
        for row in 0..ACROSS * ACROSS {
            let first = (row / ACROSS * 2 * SIDE + row % ACROSS * 2) * SIDE;
            // of the four rows of voxels: an unseen one is on neither side
            let (mut highest, mut lowest) = ([UNSEEN; SIDE], [1; SIDE]);
            for start in [first, first + SIDE, first + SIDE * SIDE, first + SIDE * SIDE + SIDE] {
                for x in 0..SIDE {
                    let v = tsdf[start + x];
                    highest[x] = highest[x].max(v);
                    lowest[x] = lowest[x].min(if v == UNSEEN { 1 } else { v });
                }
            }
            for x in 0..ACROSS {
                let bit = row * ACROSS + x;
                let front = highest[2 * x].max(highest[2 * x + 1]) > 0;
                let behind = lowest[2 * x].min(lowest[2 * x + 1]) <= 0;
                sides.front |= Bricks::from(front) << bit;
                sides.behind |= Bricks::from(behind) << bit;
            }
        }
        sides
    }
}

impl BlockStore {
    /// Marks the bricks that have both sides within themselves and the 26 around them. A cell
    /// with a zero crossing has both sides among its corners, so every brick that such a cell
    /// reaches into is marked: no crossing lies closer than half a voxel to an unmarked one.
    pub fn find_crossings(&mut self) {
        let (table, blocks, grid) = (&self.table, &self.blocks, self.grid);
        self.crossings.par_chunks_mut(grid).enumerate().for_each(|(row, crossings)| {
            for (x, crossing) in crossings.iter_mut().enumerate() {
                if !blocks[table[row * grid + x] as usize].live {
                    continue; // such an entry stays 0
                }
                let around = |offset: [usize; 3]| {
                    let at = [x, row % grid, row / grid];
                    // offsets count from -1; below zero wraps around and is outside too
                    let [x, y, z] = [0, 1, 2].map(|i| (at[i] + offset[i]).wrapping_sub(1));
                    let inside = x < grid && y < grid && z < grid;
                    let slot = if inside { table[(z * grid + y) * grid + x] } else { 0 };
                    blocks[slot as usize].sides
                };
                *crossing = dilate(|at| around(at).front) & dilate(|at| around(at).behind);
            }
        });
    }
}

/// A block's bricks and those beside them, from the 27 blocks around (offset by 1).
fn dilate(bricks: impl Fn([usize; 3]) -> Bricks) -> Bricks {
    let along_x = |y, z| spread(1, 0x1111_1111_1111_1111, [0, 1, 2].map(|x| bricks([x, y, z])));
    let along_y = |z| spread(4, 0x000f_000f_000f_000f, [0, 1, 2].map(|y| along_x(y, z)));
    spread(16, 0xffff, [0, 1, 2].map(along_y))
}

/// Bricks of the block in the middle and those one step along an axis before and after them.
/// `stride` is the axis's step in bits, `first` its first plane.
fn spread(stride: u32, first: Bricks, [before, middle, after]: [Bricks; 3]) -> Bricks {
    let across = stride * (ACROSS as u32 - 1);
    let last = first << across;
    middle
        | (middle & !last) << stride
        | (middle & !first) >> stride
        | (before & last) >> across
        | (after & first) << across
}
