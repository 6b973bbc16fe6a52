//! Joint bilateral up-sampling (Kopf et al. 2007): each pixel takes shading from the four grid
//! points around it, as far as they lie on its own surface.

use super::grid::{NOTHING, ShadingGrid, kind_of};
use super::planes::Planes;
use super::smooth::{Likeness, PixelSteps, SurfaceRow};
use crate::geometry::GBuffer;
use glam::Vec3;
use rayon::prelude::*;

/// Summed weight below which the four points are taken to lie on other surfaces.
pub const MIN_WEIGHT: f32 = 1e-3;

/// Grid points on either side of one image axis, and the weight of the second.
#[derive(Clone, Copy, Debug)]
pub struct Between {
    pub first: usize,
    pub second: usize,
    pub share: f32,
}

/// For every pixel of an axis of this length, given the pixels that the grid points stand at.
pub fn between(points: &[f32], length: usize, out: &mut Vec<Between>) {
    out.clear();
    let last = points.len().saturating_sub(1);
    let mut first = 0;
    for pixel in 0..length {
        while first + 1 < last && points[first + 1] <= pixel as f32 {
            first += 1;
        }
        let second = (first + 1).min(last);
        let span = points[second] - points[first];
        let share = if span > 0.0 { (pixel as f32 - points[first]) / span } else { 0.0 };
        out.push(Between { first, second, share: share.clamp(0.0, 1.0) });
    }
}

/// Full-resolution planes from smoothed grid planes. Pixels that no changed point can reach, and
/// pixels that find no point of their own kind, get R = R' = 1 and no bounce: unchanged.
pub fn upsample(
    grid: &ShadingGrid,
    smoothed: &Planes,
    merged: &GBuffer,
    likeness: Likeness,
    axes: (&[Between], &[Between]),
    out: &mut Planes,
) {
    out.reshape(merged.size(), smoothed.count());
    let steps = PixelSteps::new(&merged.view);
    let (columns, rows) = axes;
    out.par_rows_mut().for_each(|(y, out)| {
        let Between { first, second, share } = rows[y];
        let row = Row {
            grid,
            smoothed,
            merged,
            likeness,
            steps,
            y,
            j: [first, second],
            share,
            surface: [first, second].map(|j| SurfaceRow::new(grid, merged, j)),
        };
        row.run(columns, out);
    });
}

struct Row<'a> {
    grid: &'a ShadingGrid,
    smoothed: &'a Planes,
    merged: &'a GBuffer,
    likeness: Likeness,
    steps: PixelSteps,
    y: usize,
    /// Grid rows above and below, and the weight of the lower.
    j: [usize; 2],
    share: f32,
    surface: [SurfaceRow<'a>; 2],
}

/// A pixel with its tangent plane.
struct Pixel {
    kind: f32,
    depth: f32,
    u: f32,
    normal: Vec3,
    along_x: f32,
    along_y: f32,
    along_ray: f32,
}

impl Row<'_> {
    fn run(&self, columns: &[Between], out: &mut [f32]) {
        let width = columns.len();
        out.fill(0.0);
        out[..2 * self.grid.layout.channels * width].fill(1.0);
        let active = self.j.map(|j| self.grid.widened_row(j));
        for (x, column) in columns.iter().enumerate() {
            let i = [column.first, column.second];
            if active.iter().any(|row| row[i[0]] | row[i[1]] != 0) {
                self.pixel(x, i, column.share, out);
            }
        }
    }

    #[inline(always)]
    fn pixel(&self, x: usize, i: [usize; 2], share: f32, out: &mut [f32]) {
        let Some(pixel) = self.load(x) else { return };
        let mut weights = [0.0; 4];
        for (t, weight) in weights.iter_mut().enumerate() {
            let (dx, dy) = (t % 2, t / 2);
            let spatial = [1.0 - share, share][dx] * [1.0 - self.share, self.share][dy];
            *weight = spatial * self.likeness_of(&pixel, i[dx], self.j[dy], self.surface[dy]);
        }
        let total = (weights[0] + weights[1]) + (weights[2] + weights[3]);
        let width = self.merged.size().width;
        if total > MIN_WEIGHT {
            for p in 0..self.smoothed.count() {
                let [above, below] = self.j.map(|j| self.smoothed.row(p, j));
                let sum = (weights[0] * above[i[0]] + weights[1] * above[i[1]])
                    + (weights[2] * below[i[0]] + weights[3] * below[i[1]]);
                out[p * width + x] = sum / total;
            }
        } else if let Some((i, j)) = self.nearest(&pixel, i[0], x) {
            for p in 0..self.smoothed.count() {
                out[p * width + x] = self.smoothed.at(p, i, j);
            }
        }
    }

    #[inline(always)]
    fn load(&self, x: usize) -> Option<Pixel> {
        let depth = self.merged.depth_m.row(self.y)[x];
        let kind = kind_of(self.merged.origin.row(self.y)[x], depth);
        if kind == NOTHING {
            return None;
        }
        let n = &self.merged.normals;
        let normal = Vec3::new(n.x.row(self.y)[x], n.y.row(self.y)[x], n.z.row(self.y)[x]);
        let (along_x, along_y) = (normal.dot(self.steps.x), normal.dot(self.steps.y));
        let u = x as f32;
        let along_ray = normal.dot(self.steps.z) + u * along_x + self.y as f32 * along_y;
        Some(Pixel { kind, depth, u, normal, along_x, along_y, along_ray })
    }

    #[inline(always)]
    fn likeness_of(&self, pixel: &Pixel, i: usize, j: usize, surface: SurfaceRow) -> f32 {
        if self.grid.kind.at(0, i, j) != pixel.kind {
            return 0.0;
        }
        let normal = Vec3::from(surface.normal.map(|n| n[i]));
        self.likeness.weight(self.plane_distance(pixel, i, j, surface), pixel.normal.dot(normal))
    }

    /// Distance of a grid point from the pixel's tangent plane, relative to depth.
    #[inline(always)]
    fn plane_distance(&self, pixel: &Pixel, i: usize, j: usize, surface: SurfaceRow) -> f32 {
        let depth = surface.depth[i];
        let (du, dv) = (self.grid.u[i] - pixel.u, self.grid.v[j] - self.y as f32);
        let distance = pixel.along_ray * (depth - pixel.depth)
            + depth * (du * pixel.along_x + dv * pixel.along_y);
        distance / pixel.depth
    }

    /// Of the 4 x 4 points around, the one of the pixel's kind that is nearest in space: pixels of
    /// distance count at their size there. Every point of one kind, so never across an edge
    /// between real and virtual.
    fn nearest(&self, pixel: &Pixel, first: usize, x: usize) -> Option<(usize, usize)> {
        let size = self.grid.size();
        let columns = first.saturating_sub(1)..(first + 3).min(size.width);
        let rows = self.j[0].saturating_sub(1)..(self.j[0] + 3).min(size.height);
        let pixel_m = pixel.depth * self.steps.x.length();
        let mut best = None;
        for j in rows {
            let surface = SurfaceRow::new(self.grid, self.merged, j);
            for i in columns.clone() {
                if self.grid.kind.at(0, i, j) != pixel.kind {
                    continue;
                }
                let off = self.plane_distance(pixel, i, j, surface) * pixel.depth;
                let (du, dv) = (self.grid.u[i] - x as f32, self.grid.v[j] - self.y as f32);
                let squared = off * off + (du * du + dv * dv) * pixel_m * pixel_m;
                if best.is_none_or(|(least, _)| squared < least) {
                    best = Some((squared, (i, j)));
                }
            }
        }
        best.map(|(_, point)| point)
    }
}
