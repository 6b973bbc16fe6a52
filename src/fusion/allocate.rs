//! Which blocks a frame needs: those that the truncation band around its depth passes through.

use super::TsdfVolume;
use super::block::{EMPTY, ONE, SIDE};
use super::rays::Rays;
use crate::image::Image;
use crate::math::View;
use glam::{IVec3, Vec3};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Above this a block holds free space only: it has no voxel near a surface, and its neighbours
/// come back when a surface does. Not exactly 1: a long average stops half a step of its weight
/// short of the limit.
pub(crate) const FREE: i16 = (0.95 * ONE as f32) as i16;

/// Blocks this far from the volume are left alone: their coordinates may not fit integers.
pub(crate) const FAR_AWAY: f32 = 1e6;

/// A bit for each block of the volume. Bits are only ever set while threads share it, so the
/// result does not depend on their order.
#[derive(Debug)]
pub(super) struct BlockMarks {
    words: Vec<AtomicU64>,
}

impl BlockMarks {
    pub fn new(blocks: usize) -> Self {
        Self { words: (0..blocks.div_ceil(64)).map(|_| AtomicU64::new(0)).collect() }
    }

    pub fn memory_bytes(&self) -> usize {
        size_of_val(self.words.as_slice())
    }

    fn clear(&mut self) {
        self.words.iter_mut().for_each(|word| *word.get_mut() = 0);
    }

    #[inline(always)]
    fn set(&self, index: usize) {
        let (word, bit) = (&self.words[index / 64], 1 << (index % 64));
        if word.load(Relaxed) & bit == 0 {
            word.fetch_or(bit, Relaxed);
        }
    }

    fn contains(&self, index: usize) -> bool {
        self.words[index / 64].load(Relaxed) >> (index % 64) & 1 == 1
    }

    /// Set bits in ascending order.
    fn iter(&self) -> impl Iterator<Item = usize> {
        self.words.iter().enumerate().flat_map(|(i, word)| {
            let mut rest = word.load(Relaxed);
            std::iter::from_fn(move || {
                let bit = (rest != 0).then(|| rest.trailing_zeros() as usize)?;
                rest &= rest - 1;
                Some(i * 64 + bit)
            })
        })
    }
}

impl TsdfVolume {
    /// Gives storage to every block that the band of one truncation length around the depth
    /// passes through.
    pub(super) fn allocate_near(&mut self, depth_m: &Image<f32>, view: &View) {
        self.marks.clear();
        let rays = Rays::new(&self.lattice, view);
        let (volume, width) = (&*self, depth_m.width());
        depth_m.as_slice().par_chunks(width.max(1)).enumerate().for_each(|(y, row)| {
            volume.mark_row(&rays, y as f32, row);
        });
        for index in self.marks.iter() {
            self.store.allocate(index);
        }
    }

    fn mark_row(&self, rays: &Rays, v: f32, row: &[f32]) {
        let truncation_m = self.lattice.truncation_m;
        let mut last = (IVec3::MIN, IVec3::MIN);
        for (x, &depth) in row.iter().enumerate() {
            if !(depth > 0.0 && depth.is_finite()) {
                continue;
            }
            let (origin, direction) = rays.at(x as f32, v);
            let (near, far) = ((depth - truncation_m).max(0.0), depth + truncation_m);
            // block coordinates: block b holds voxel coordinates 8 b - 1/2 to 8 b + 15/2
            let a = (origin + direction * near + 0.5) / SIDE as f32;
            let b = (origin + direction * far + 0.5) / SIDE as f32;
            let reach = a.abs().max(b.abs()).max_element();
            if reach.is_nan() || reach > FAR_AWAY {
                continue;
            }
            let ends = (a.floor().as_ivec3(), b.floor().as_ivec3());
            if ends != last {
                self.mark_segment(a, b, ends);
            } else if (ends.1 - ends.0).abs().element_sum() > 1 {
                self.mark_segment(a, b, ends); // the blocks between may differ
            }
            last = ends;
        }
    }

    /// Every block from `a` to `b` (Amanatides and Woo, "A fast voxel traversal algorithm", 1987).
    fn mark_segment(&self, a: Vec3, b: Vec3, (mut block, end): (IVec3, IVec3)) {
        let grid = self.store.grid as i32;
        let direction = b - a;
        let step = (end - block).signum();
        let crossing = (block + step.max(IVec3::ZERO)).as_vec3();
        // 0/0 only where the axis is never crossed; those steps are zero and masked below
        let mut next = ((crossing - a) / direction).to_array();
        let each = direction.recip().abs().to_array();
        for axis in 0..3 {
            if step[axis] == 0 {
                next[axis] = f32::INFINITY;
            }
        }
        // Rounding may order two crossings wrongly but each axis is crossed as often as it must be.
        let mut left = (end - block).abs();
        loop {
            if block.min_element() >= 0 && block.max_element() < grid {
                self.marks.set(((block.z * grid + block.y) * grid + block.x) as usize);
            }
            if left == IVec3::ZERO {
                return;
            }
            let axis = (0..3)
                .filter(|&axis| left[axis] > 0)
                .min_by(|&i, &j| next[i].total_cmp(&next[j]))
                .unwrap_or(0);
            block[axis] += step[axis];
            left[axis] -= 1;
            next[axis] += each[axis];
        }
    }

    /// Takes the storage of blocks that hold free space only. Blocks near this frame's depth are
    /// kept, and blocks beside a surface, whose cells need their voxels.
    pub(super) fn release_free_blocks(&mut self) {
        for slot in 0..self.store.blocks.len() {
            let block = &self.store.blocks[slot];
            if !block.live || block.lowest < FREE {
                continue;
            }
            let wanted = self.marks.contains(self.store.index(block.coords));
            if !wanted && self.store.neighbourhood(block.coords).all(|b| b.lowest >= 0) {
                self.store.release(slot as u32);
            }
        }
        debug_assert!(
            self.store.table.iter().filter(|&&s| s != EMPTY).count() == self.store.live_blocks()
        );
    }
}
