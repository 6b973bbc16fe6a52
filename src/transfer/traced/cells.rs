//! Adaptive refinement: between coarse points that lie on one smooth surface transfer is
//! interpolated; across edges of depth or normals every pixel gets rays of its own.

use super::super::batch::{Grid, grid_pixel};
use super::super::{TransferMap, TransferParams};
use super::points::{Surface, Surfaces};
use rayon::prelude::*;

/// How far two points of one smooth surface may differ.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Smooth {
    /// Distance of either from the other's tangent plane, metres.
    pub depth_m: f32,
    /// Least cosine between the normals.
    pub cosine: f32,
}

impl Smooth {
    pub fn new(params: &TransferParams) -> Self {
        let cosine = params.refine_angle_deg.to_radians().cos();
        Self { depth_m: params.refine_depth_m, cosine }
    }

    /// Tangent planes rather than depths: on a floor seen at a slant depth changes without an edge.
    #[inline(always)]
    fn joins(&self, a: &Surface, b: &Surface) -> bool {
        let between = b.position - a.position;
        between.dot(a.normal).abs() <= self.depth_m
            && between.dot(b.normal).abs() <= self.depth_m
            && a.normal.dot(b.normal) >= self.cosine
    }
}

/// Where a pixel lies along an axis: the coarse points before and after it, and the share of the
/// second.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Between {
    pub first: u32,
    pub second: u32,
    pub share: f32,
}

/// Cells between four coarse points each; cell (i, j) starts at coarse point (i, j).
#[derive(Debug, Default)]
pub(super) struct Cells {
    width: usize,
    columns: Vec<Between>,
    rows: Vec<Between>,
    points: Vec<Option<Surface>>,
    smooth: Vec<bool>,
}

impl Cells {
    pub fn prepare(&mut self, surfaces: &Surfaces, grid: &Grid, smooth: Smooth) {
        let size = surfaces.buffer.size();
        let width = grid.width;
        self.width = width;
        place(&mut self.columns, grid.step, size.width);
        place(&mut self.rows, grid.step, size.height);
        self.points.resize(grid.width * grid.height, None);
        self.smooth.resize(grid.width * grid.height, false);
        if self.points.is_empty() {
            return;
        }
        self.points.par_chunks_mut(width).enumerate().for_each(|(j, row)| {
            let y = grid.pixel(j, size.height);
            for (i, point) in row.iter_mut().enumerate() {
                *point = surfaces.at(grid.pixel(i, size.width), y);
            }
        });
        let points = &self.points;
        self.smooth.par_chunks_mut(width).enumerate().for_each(|(j, row)| {
            let below = (j + 1).min(grid.height - 1) * width;
            for (i, out) in row.iter_mut().enumerate() {
                let right = (i + 1).min(width - 1);
                let corners =
                    [j * width + i, j * width + right, below + i, below + right].map(|k| points[k]);
                *out = all_join(corners, smooth);
            }
        });
    }

    /// Whether the pixel lies on the smooth surface that the corners of its cell share.
    pub fn interpolates(&self, x: usize, y: usize, surface: &Surface, smooth: Smooth) -> bool {
        let [a, b, c, d] = self.corners(x, y);
        let (right, below) = (self.columns[x].share >= 0.5, self.rows[y].share >= 0.5);
        let nearest = match (right, below) {
            (false, false) => a,
            (true, false) => b,
            (false, true) => c,
            (true, true) => d,
        };
        self.smooth[a] && self.points[nearest].is_some_and(|point| smooth.joins(&point, surface))
    }

    /// Indices of the coarse points around a pixel, row by row.
    pub fn corners(&self, x: usize, y: usize) -> [usize; 4] {
        let (column, row) = (self.columns[x], self.rows[y]);
        let at = |j: u32, i: u32| j as usize * self.width + i as usize;
        [
            at(row.first, column.first),
            at(row.first, column.second),
            at(row.second, column.first),
            at(row.second, column.second),
        ]
    }

    /// Bilinear interpolation of the coarse map.
    #[inline(always)]
    pub fn interpolate(&self, coarse: &TransferMap, x: usize, y: usize, out: &mut [f32]) {
        let n = out.len();
        let (u, v) = (self.columns[x].share, self.rows[y].share);
        let [a, b, c, d] = self.corners(x, y).map(|k| &coarse.coefficients[k * n..][..n]);
        for k in 0..n {
            let above = a[k] + (b[k] - a[k]) * u;
            let below = c[k] + (d[k] - c[k]) * u;
            out[k] = above + (below - above) * v;
        }
    }
}

fn all_join(corners: [Option<Surface>; 4], smooth: Smooth) -> bool {
    let [Some(a), Some(b), Some(c), Some(d)] = corners else { return false };
    [(a, b), (a, c), (a, d), (b, c), (b, d), (c, d)].iter().all(|(p, q)| smooth.joins(p, q))
}

/// Every pixel of an axis between coarse points on each `step`-th. Beyond the outermost coarse points
/// their own values are taken.
pub(crate) fn place(out: &mut Vec<Between>, step: usize, length: usize) {
    let count = length.div_ceil(step);
    out.clear();
    out.extend((0..length).map(|pixel| {
        let first = (pixel.saturating_sub(step / 2) / step).min(count - 1);
        let second = (first + 1).min(count - 1);
        let (a, b) = (grid_pixel(step, first, length), grid_pixel(step, second, length));
        let share = if b > a { (pixel as f32 - a as f32) / (b - a) as f32 } else { 0.0 };
        Between { first: first as u32, second: second as u32, share: share.clamp(0.0, 1.0) }
    }));
}
