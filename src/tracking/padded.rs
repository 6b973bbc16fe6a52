//! Depth rows in whole SIMD lanes, with a margin of missing depth so that filters need no border case.

use super::LANES;
use crate::image::Size;
use rayon::prelude::*;

/// Depth in metres, missing = 0.0. Around the image lie `margin` pixels of missing depth; each row
/// is filled up to a multiple of [`LANES`] with missing depth.
#[derive(Clone, Debug)]
pub(crate) struct PaddedDepth {
    size: Size,
    margin: usize,
    stride: usize,
    data: Vec<f32>,
}

impl PaddedDepth {
    pub fn new(size: Size, margin: usize) -> Self {
        let stride = lane_stride(size.width) + 2 * margin;
        Self { size, margin, stride, data: vec![0.0; stride * (size.height + 2 * margin)] }
    }

    pub fn size(&self) -> Size {
        self.size
    }

    /// Row `y` in whole lanes, from column 0.
    pub fn row(&self, y: usize) -> &[f32] {
        let start = (y + self.margin) * self.stride + self.margin;
        &self.data[start..start + lane_stride(self.size.width)]
    }

    /// Row `y - margin + line` in whole lanes, with the margin on both sides: element 0 is column
    /// `-margin`. `line` runs from 0 to `2 * margin`.
    pub fn row_with_margin(&self, y: usize, line: usize) -> &[f32] {
        let start = (y + line) * self.stride;
        &self.data[start..start + self.stride]
    }

    /// Rows in whole lanes with their index, in parallel. Columns beyond the width must stay 0.0.
    pub fn par_rows_mut(&mut self) -> impl IndexedParallelIterator<Item = (usize, &mut [f32])> {
        let (margin, lanes) = (self.margin, lane_stride(self.size.width));
        let rows = margin * self.stride..(margin + self.size.height) * self.stride;
        self.data[rows]
            .par_chunks_mut(self.stride.max(1))
            .map(move |row| &mut row[margin..margin + lanes])
            .enumerate()
    }
}

/// Length of a row in whole lanes.
pub(super) fn lane_stride(width: usize) -> usize {
    width.next_multiple_of(LANES)
}
