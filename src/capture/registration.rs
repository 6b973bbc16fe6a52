//! Depth from one camera as another camera sees it.
//!
//! The depth picture is taken as a surface: four neighbouring pixels without a step between them
//! span a patch, patches are rasterised into the colour camera with a z-buffer. So slanted surfaces
//! stretched by the change of view have no holes, depth between samples is interpolated, and steps
//! are not bridged. Pixels beside a step or a hole keep their own square. What the depth camera
//! cannot see stays missing.

use super::calibration::CameraModel;
use super::rectify::largest_step_m;
use crate::image::{Image, Size};
use crate::math::{Pinhole, Pose};
use rayon::prelude::*;

/// Nearer than this to the colour camera's plane nothing is projected.
const NEAR_M: f32 = 0.05;

/// Rows of the colour picture that one task fills.
const BAND: usize = 48;

/// Registers depth pictures of one camera pair; keeps its tables and buffers from frame to frame.
#[derive(Debug)]
pub struct Registration {
    depth_size: Size,
    camera: Pinhole,
    /// For each depth pixel q = R K^-1 (x, y, 1), with the colour camera's matrix applied: the colour
    /// pixel is `(z a + shift[0], z b + shift[1]) / (z c + shift[2])`.
    rays: [Vec<f32>; 3],
    shift: [f32; 3],
    /// Colour pixels per depth pixel at equal distance.
    scale: [f32; 2],
    /// Patches that grow beyond this many pixels are not drawn.
    max_span: f32,
    projected: Projected,
}

/// Depth pixels in the colour picture: place, and inverse depth there (0.0 where missing).
#[derive(Debug, Default)]
struct Projected {
    u: Vec<f32>,
    v: Vec<f32>,
    inverse_z: Vec<f32>,
    /// The pixel, its right, lower and lower right neighbour span a patch.
    patch: Vec<bool>,
    /// Lowest and highest `v` of each row.
    rows: Vec<(f32, f32)>,
}

impl Registration {
    /// From the depth camera, which may be distorted, into a rectified camera.
    pub fn new(depth: &CameraModel, camera: Pinhole, color_from_depth: &Pose) -> Self {
        let size = depth.size();
        let r = color_from_depth.rotation.to_rotation_matrix();
        let t = color_from_depth.translation.vector;
        let (fx, fy) = (f64::from(camera.fx), f64::from(camera.fy));
        let (cx, cy) = (f64::from(camera.cx), f64::from(camera.cy));
        let onto_picture = |p: nalgebra::Vector3<f64>| {
            [fx * p.x + cx * p.z, fy * p.y + cy * p.z, p.z].map(|v| v as f32)
        };
        let table: Vec<[f32; 3]> = (0..size.pixels())
            .into_par_iter()
            .map(|i| {
                let x = ((i % size.width) as f64 - depth.cx) / depth.fx;
                let y = ((i / size.width) as f64 - depth.cy) / depth.fy;
                // NaN where the lens model has no answer: such pixels never pass a comparison.
                let (x, y) = depth.distortion.undistort(x, y).unwrap_or((f64::NAN, f64::NAN));
                onto_picture(r * nalgebra::Vector3::new(x, y, 1.0))
            })
            .collect();
        let scale = [(fx / depth.fx) as f32, (fy / depth.fy) as f32];
        let n = size.pixels();
        Self {
            depth_size: size,
            camera,
            rays: std::array::from_fn(|k| table.iter().map(|q| q[k]).collect()),
            shift: onto_picture(t),
            scale,
            max_span: 8.0 + 4.0 * scale[0].max(scale[1]),
            projected: Projected {
                u: vec![0.0; n],
                v: vec![0.0; n],
                inverse_z: vec![0.0; n],
                patch: vec![false; n],
                rows: vec![(0.0, 0.0); size.height],
            },
        }
    }

    /// Writes the depth that the colour camera sees. `depth_m` must have the depth camera's size.
    pub fn register(&mut self, depth_m: &Image<f32>, out: &mut Image<f32>) {
        assert_eq!(depth_m.size(), self.depth_size, "depth picture of another camera");
        out.reshape(self.camera.size(), 0.0);
        if self.depth_size.pixels() == 0 || self.camera.size().pixels() == 0 {
            return;
        }
        self.project(depth_m);
        self.find_patches(depth_m);
        self.draw(depth_m, out);
    }

    fn project(&mut self, depth_m: &Image<f32>) {
        let width = self.depth_size.width;
        let (rays, shift) = (&self.rays, self.shift);
        let Projected { u, v, inverse_z: z, rows, .. } = &mut self.projected;
        (
            u.par_chunks_mut(width),
            v.par_chunks_mut(width),
            z.par_chunks_mut(width),
            rows.par_iter_mut(),
        )
            .into_par_iter()
            .enumerate()
            .for_each(|(y, (u, v, z, range))| {
                let at = y * width..(y + 1) * width;
                let [a, b, c] = [0, 1, 2].map(|k| &rays[k][at.clone()]);
                project_row([a, b, c], shift, depth_m.row(y), u, v, z);
                *range = z
                    .iter()
                    .zip(&*v)
                    .filter(|(z, _)| **z > 0.0)
                    .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), (_, &v)| {
                        (low.min(v), high.max(v))
                    });
            });
    }

    fn find_patches(&mut self, depth_m: &Image<f32>) {
        let Size { width, height } = self.depth_size;
        let Projected { u, v, inverse_z, patch, .. } = &mut self.projected;
        let span = self.max_span;
        patch.par_chunks_mut(width).enumerate().for_each(|(y, patch)| {
            patch.fill(false);
            if y + 1 == height {
                return;
            }
            let near = |data: &[f32], x: usize| {
                let (i, j) = (y * width + x, (y + 1) * width + x);
                [data[i], data[i + 1], data[j], data[j + 1]]
            };
            for x in 0..width - 1 {
                let (low, high) = extent(near(depth_m.as_slice(), x));
                let seen = extent(near(inverse_z, x)).0 > 0.0;
                let (left, right) = extent(near(u, x));
                let (top, bottom) = extent(near(v, x));
                let small = (right - left).max(bottom - top) < span;
                patch[x] = seen & small & (high - low <= largest_step_m(low));
            }
        });
    }

    /// Every task owns a band of the colour picture and draws all that falls into it: no task waits for
    /// another, and the result is that of a serial loop.
    fn draw(&self, depth_m: &Image<f32>, out: &mut Image<f32>) {
        let width = self.camera.width;
        let rows = &self.projected.rows;
        out.as_mut_slice().par_chunks_mut(width * BAND).enumerate().for_each(|(band, pixels)| {
            pixels.fill(f32::INFINITY);
            let top = band * BAND;
            let mut target = Target { width, top, height: pixels.len() / width, pixels };
            let (first, last) = (top as f32, (top + target.height) as f32);
            for y in 0..self.depth_size.height {
                // Patches reach down to the next row, squares half a span further.
                let (low, high) = rows[y];
                let (low_below, high_below) = *rows.get(y + 1).unwrap_or(&rows[y]);
                let reach = 0.5 * self.max_span;
                let low = (low - reach).min(low_below);
                let high = (high + reach).max(high_below);
                if low <= last && high >= first {
                    draw_row(&self.row(y, depth_m), &mut target);
                }
            }
            for z in target.pixels {
                *z = if *z < f32::INFINITY { *z } else { 0.0 };
            }
        });
    }

    /// A row of patches, with the pixels above and below it. The last row has no patches, and stands in
    /// for the row below it.
    fn row<'a>(&'a self, y: usize, depth_m: &'a Image<f32>) -> Row<'a> {
        let width = self.depth_size.width;
        let at = |y: usize| y * width..(y + 1) * width;
        let below = at((y + 1).min(self.depth_size.height - 1));
        let p = &self.projected;
        let pair = |data: &'a [f32]| [&data[at(y)], &data[below.clone()]];
        Row {
            u: pair(&p.u),
            v: pair(&p.v),
            inverse_z: pair(&p.inverse_z),
            depth_m: depth_m.row(y),
            patch: [&p.patch[at(y.saturating_sub(1))], &p.patch[at(y)]],
            first: y == 0,
            half_scale: self.scale.map(|s| 0.5 * s),
            max_half: 0.5 * self.max_span,
        }
    }
}

struct Row<'a> {
    /// Of this row and the one below.
    u: [&'a [f32]; 2],
    v: [&'a [f32]; 2],
    inverse_z: [&'a [f32]; 2],
    depth_m: &'a [f32],
    /// Of the row above and this one.
    patch: [&'a [bool]; 2],
    first: bool,
    half_scale: [f32; 2],
    max_half: f32,
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn draw_row(row: &Row, target: &mut Target) {
    let n = row.depth_m.len();
    let [u, v, inverse_z] = [row.u, row.v, row.inverse_z].map(|two| two.map(|r| &r[..n]));
    let [above, here] = row.patch.map(|r| &r[..n]);
    // Whether the patches to the left of this pixel were drawn.
    let (mut left_above, mut left) = (false, false);
    for x in 0..n {
        let inverse = inverse_z[0][x];
        let up = above[x] & !row.first;
        if here[x] && x + 1 < n {
            let corner = |x: usize, y: usize| [u[y][x], v[y][x], inverse_z[y][x]];
            target.patch([corner(x, 0), corner(x + 1, 0), corner(x, 1), corner(x + 1, 1)]);
        }
        if inverse > 0.0 && !(here[x] & left & up & left_above) {
            // The pixel's own square, as large as the colour camera sees it.
            let grow = row.depth_m[x] * inverse;
            let half = row.half_scale.map(|s| (s * grow).min(row.max_half));
            target.square([u[0][x], v[0][x]], half, 1.0 / inverse);
        }
        (left, left_above) = (here[x], up);
    }
}

/// Colour pixels of one depth row. Vectorises: no branch, missing depth ends as 1/z = 0.
#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn project_row(
    rays: [&[f32]; 3],
    shift: [f32; 3],
    depth_m: &[f32],
    u: &mut [f32],
    v: &mut [f32],
    inverse_z: &mut [f32],
) {
    let n = depth_m.len();
    let [a, b, c] = rays.map(|r| &r[..n]);
    let (u, v, inverse_z) = (&mut u[..n], &mut v[..n], &mut inverse_z[..n]);
    for i in 0..n {
        let d = depth_m[i];
        let w = d * c[i] + shift[2];
        let seen = (d > 0.0) & (w > NEAR_M) & (w < f32::MAX);
        let inverse = 1.0 / if seen { w } else { 1.0 };
        u[i] = (d * a[i] + shift[0]) * inverse;
        v[i] = (d * b[i] + shift[1]) * inverse;
        inverse_z[i] = if seen { inverse } else { 0.0 };
    }
}

#[inline(always)]
fn extent([a, b, c, d]: [f32; 4]) -> (f32, f32) {
    (a.min(b).min(c.min(d)), a.max(b).max(c.max(d)))
}

/// A band of the z-buffer.
struct Target<'a> {
    width: usize,
    top: usize,
    height: usize,
    pixels: &'a mut [f32],
}

impl Target<'_> {
    /// Integer range of pixel centres in `[low, high]`, cut to `[first, first + count)`.
    #[inline(always)]
    fn centres(low: f32, high: f32, first: usize, count: usize) -> std::ops::Range<usize> {
        // Saturating casts: what lies left of the picture becomes 0, NaN an empty range.
        let start = (low.ceil().max(first as f32)) as usize;
        let end = ((high.floor() + 1.0).max(0.0) as usize).min(first + count);
        start..end
    }

    #[inline(always)]
    fn nearest(&mut self, x: usize, y: usize, z: f32) {
        let slot = &mut self.pixels[(y - self.top) * self.width + x];
        *slot = slot.min(z);
    }

    #[inline(always)]
    fn square(&mut self, [u, v]: [f32; 2], half: [f32; 2], z: f32) {
        for y in Self::centres(v - half[1], v + half[1], self.top, self.height) {
            for x in Self::centres(u - half[0], u + half[0], 0, self.width) {
                self.nearest(x, y, z);
            }
        }
    }

    /// Corners (u, v, 1/z): upper left, upper right, lower left, lower right. Two triangles; 1/z is linear
    /// in the picture.
    #[inline(always)]
    fn patch(&mut self, [a, b, c, d]: [[f32; 3]; 4]) {
        let (left, right) = extent([a[0], b[0], c[0], d[0]]);
        let (top, bottom) = extent([a[1], b[1], c[1], d[1]]);
        for y in Self::centres(top, bottom, self.top, self.height) {
            for x in Self::centres(left, right, 0, self.width) {
                let at = [x as f32, y as f32];
                if let Some(inverse) = inside(at, a, b, c).or_else(|| inside(at, d, c, b)) {
                    self.nearest(x, y, 1.0 / inverse);
                }
            }
        }
    }
}

/// The third coordinate of a triangle, linear in the first two; `None` outside of it, and for a triangle
/// that is seen from behind.
#[inline(always)]
fn inside(at: [f32; 2], a: [f32; 3], b: [f32; 3], c: [f32; 3]) -> Option<f32> {
    // Shared edges may belong to both sides, never to none: a thousandth of a patch of slack.
    const SLACK: f32 = 1e-3;
    let (bx, by) = (b[0] - a[0], b[1] - a[1]);
    let (cx, cy) = (c[0] - a[0], c[1] - a[1]);
    let (px, py) = (at[0] - a[0], at[1] - a[1]);
    let area = bx * cy - by * cx;
    let to_b = px * cy - py * cx;
    let to_c = bx * py - by * px;
    let low = -SLACK * area;
    let within = (area > 1e-6) & (to_b >= low) & (to_c >= low) & (to_b + to_c <= area - low);
    within.then(|| a[2] + (to_b * (b[2] - a[2]) + to_c * (c[2] - a[2])) / area)
}

#[cfg(test)]
mod tests;
