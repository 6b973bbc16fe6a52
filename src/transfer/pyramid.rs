//! The nearest depths of a buffer by square cells of 1, 2, 4, ... pixels.

#![allow(unsafe_code, reason = "look-ups of inner loops, whose bounds are said beside each")]

use rayon::prelude::*;

/// The coarsest cells have 2^6 pixels a side.
const COARSEST: u32 = 6;

/// Answers with one look-up what the least value among some pixels is, or a little less.
///
/// Level l, with cells of 2^l pixels, starts at row 2 h - (2 h >> l) for a height h that all cells
/// divide; all levels have the same stride. So where a value lies takes shifts and one product,
/// and lanes may look at different levels.
#[derive(Clone, Debug, Default)]
pub(super) struct NearestPyramid {
    stride: usize,
    /// Rounded up to whole cells of the coarsest level.
    height: usize,
    /// The least value of a cell.
    cells: Vec<f32>,
    /// The least value of a cell, its right, its lower and its lower right neighbour.
    quads: Vec<f32>,
}

impl NearestPyramid {
    /// NaN counts as infinite.
    pub fn build(&mut self, width: usize, height: usize, values: &[f32]) {
        assert_eq!(values.len(), width * height);
        self.stride = width;
        self.height = height.next_multiple_of(1 << COARSEST);
        self.cells.resize(2 * self.height * width, f32::INFINITY);
        self.quads.resize(2 * self.height * width, f32::INFINITY);
        if values.is_empty() {
            return;
        }
        self.cells[..values.len()].copy_from_slice(values);
        let size = |level: u32| (width.div_ceil(1 << level), height.div_ceil(1 << level));
        for level in 0..=COARSEST {
            let (first, next) = (self.first_row(level), self.first_row(level + 1));
            let (fine, coarse) = self.cells.split_at_mut(next * width);
            let fine = &fine[first * width..];
            let quads = &mut self.quads[first * width..next * width];
            let (columns, rows) = size(level);
            quads.par_chunks_mut(width).take(rows).with_min_len(32).enumerate().for_each(
                |(j, out)| {
                    let below = (j + 1).min(rows - 1);
                    let row = |j: usize| &fine[j * width..j * width + columns];
                    least_of_quads(&mut out[..columns], row(j), row(below));
                },
            );
            if level == COARSEST {
                break;
            }
            let (coarse_columns, coarse_rows) = size(level + 1);
            coarse.par_chunks_mut(width).take(coarse_rows).with_min_len(32).enumerate().for_each(
                |(j, out)| {
                    // What a quad of even coordinates holds is one cell of the next level.
                    for (out, quad) in out[..coarse_columns]
                        .iter_mut()
                        .zip(quads[2 * j * width..].iter().step_by(2))
                    {
                        *out = *quad;
                    }
                },
            );
        }
    }

    #[inline(always)]
    fn first_row(&self, level: u32) -> usize {
        2 * self.height - ((2 * self.height) >> level)
    }

    /// At most the least value of the pixels from (u0, v0) to (u1, v1), both inclusive; minus infinity where they
    /// are too many to tell.
    ///
    /// # Safety
    /// Both must lie within the picture that the pyramid was built from, and u0 <= u1, v0 <= v1.
    #[inline(always)]
    pub unsafe fn nearest(&self, [u0, v0]: [i32; 2], [u1, v1]: [i32; 2]) -> f32 {
        let extent = if u1 - u0 > v1 - v0 { u1 - u0 } else { v1 - v0 };
        // The finest level on which they span two cells at most.
        let mut level = 0;
        for l in 0..COARSEST {
            level += i32::from(extent > 1 << l);
        }
        let height = 2 * self.height as i32;
        let index =
            (height - (height >> level) + (v0 >> level)) * self.stride as i32 + (u0 >> level);
        debug_assert!((index as usize) < self.quads.len());
        // SAFETY: a pixel within the picture lies in a cell of every level.
        let nearest = unsafe { *self.quads.get_unchecked(index as usize) };
        if extent > 1 << COARSEST { f32::NEG_INFINITY } else { nearest }
    }
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn least_of_quads(out: &mut [f32], row: &[f32], below: &[f32]) {
    let last = out.len() - 1;
    let (row, below) = (&row[..=last], &below[..=last]);
    for i in 0..last {
        out[i] = row[i].min(row[i + 1]).min(below[i].min(below[i + 1]));
    }
    out[last] = row[last].min(below[last]).min(f32::INFINITY);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Rng;

    #[test]
    fn boxes_are_bounded_from_below_and_the_bound_is_met_nearby() {
        for (width, height) in [(1, 1), (2, 3), (67, 43), (130, 140)] {
            let mut rng = Rng::new(&[width as u32]);
            let values: Vec<f32> = (0..width * height).map(|_| rng.normal()).collect();
            let mut pyramid = NearestPyramid::default();
            pyramid.build(width, height, &values);
            let least = |[u0, v0]: [usize; 2], [u1, v1]: [usize; 2]| {
                (v0..=v1.min(height - 1))
                    .flat_map(|v| (u0..=u1.min(width - 1)).map(move |u| (u, v)))
                    .map(|(u, v)| values[v * width + u])
                    .fold(f32::INFINITY, f32::min)
            };
            for _ in 0..2000 {
                let mut at = |most: usize| (rng.uniform() * most as f32) as usize % most;
                let (low, size) = ([at(width), at(height)], [at(66), at(66)]);
                let high = [(low[0] + size[0]).min(width - 1), (low[1] + size[1]).min(height - 1)];
                let int = |at: [usize; 2]| at.map(|v| v as i32);
                let found = unsafe { pyramid.nearest(int(low), int(high)) };
                assert!(found <= least(low, high));
                let extent = (high[0] - low[0]).max(high[1] - low[1]);
                if extent > 64 {
                    assert_eq!(found, f32::NEG_INFINITY);
                    continue;
                }
                let cell = extent.max(1).next_power_of_two();
                let corner = low.map(|v| v & !(cell - 1));
                assert_eq!(found, least(corner, corner.map(|v| v + 2 * cell - 1)));
            }
        }
    }

    #[test]
    fn nothing_and_nan_are_no_trouble() {
        let mut pyramid = NearestPyramid::default();
        pyramid.build(0, 0, &[]);
        pyramid.build(2, 1, &[f32::NAN, 3.0]);
        assert_eq!(unsafe { pyramid.nearest([1, 0], [1, 0]) }, 3.0);
        pyramid.build(1, 1, &[f32::NAN]);
        assert_eq!(unsafe { pyramid.nearest([0, 0], [0, 0]) }, f32::INFINITY);
    }
}
