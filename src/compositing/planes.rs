//! Several f32 images of one size, interleaved by rows: one row of all planes is contiguous, so
//! that rows can be written in parallel.

use crate::image::Size;
use rayon::prelude::*;

#[derive(Clone, Debug, Default)]
pub struct Planes {
    size: Size,
    count: usize,
    data: Vec<f32>,
}

impl Planes {
    /// Contents are unspecified after a change of shape.
    pub fn reshape(&mut self, size: Size, count: usize) {
        (self.size, self.count) = (size, count);
        self.data.resize(size.pixels() * count, 0.0);
    }

    pub fn size(&self) -> Size {
        self.size
    }

    pub fn count(&self) -> usize {
        self.count
    }

    /// Row y of one plane.
    #[inline(always)]
    pub fn row(&self, plane: usize, y: usize) -> &[f32] {
        let start = (y * self.count + plane) * self.size.width;
        &self.data[start..start + self.size.width]
    }

    #[inline(always)]
    pub fn at(&self, plane: usize, x: usize, y: usize) -> f32 {
        self.row(plane, y)[x]
    }

    /// Rows in parallel: all planes of row y, one after the other.
    pub fn par_rows_mut(&mut self) -> impl IndexedParallelIterator<Item = (usize, &mut [f32])> {
        let length = (self.size.width * self.count).max(1);
        self.data.par_chunks_mut(length).enumerate()
    }
}

/// Lanes of the kernels.
pub const LANES: usize = 16;

/// 16 values from column `x0` on; columns outside repeat the border.
#[inline(always)]
pub fn lanes(row: &[f32], x0: isize) -> [f32; LANES] {
    match usize::try_from(x0).ok().and_then(|x| row.get(x..x + LANES)) {
        Some(inside) => inside.try_into().expect("slice of this length"),
        None => {
            let last = row.len() as isize - 1;
            std::array::from_fn(|k| row[(x0 + k as isize).clamp(0, last) as usize])
        }
    }
}
