//! Depth beyond which samples are hidden, pixel by pixel.

#![allow(unsafe_code, reason = "look-ups of inner loops, whose bounds are said beside each")]

use super::directions::LANES;
use super::pyramid::NearestPyramid;
use super::samples::{Nearest, Place};
use crate::geometry::{GBuffer, Origin};
use glam::Mat3A;
use rayon::prelude::*;

/// Depth beyond which a sample is hidden, for every pixel of a buffer and a border around it.
///
/// A look-up takes the nearest pixel, half a pixel off at most. On a floor seen at a grazing angle
/// the depth may change by decimetres over that, and the floor would hide samples above itself. So
/// a pixel's depth is taken where the tangent plane of its surface is farthest inside the pixel:
/// a plane never hides what is in front of it, seen from however far and however flat. Pixels without
/// surface, and the border that look-ups outside the image are clamped to, hide nothing.
#[derive(Debug, Default)]
pub(super) struct DepthLimits {
    /// z-depth, bias included; infinite where nothing is hidden.
    pub hidden_beyond_m: Vec<f32>,
    nearest: NearestPyramid,
}

impl DepthLimits {
    pub fn prepare(&mut self, buffer: &GBuffer, bias_m: f32) {
        let (width, height) = (buffer.size().width, buffer.size().height);
        let stride = width + 2;
        self.hidden_beyond_m.resize(stride * (height + 2), f32::INFINITY);
        let view_from_world = buffer.view.view_from_world_f32().matrix3;
        self.hidden_beyond_m.par_chunks_mut(stride).enumerate().for_each(|(row, out)| {
            out.fill(f32::INFINITY);
            if (1..=height).contains(&row) && width > 0 {
                farthest_row(&mut out[1..=width], buffer, (0, row - 1), &view_from_world, bias_m);
            }
        });
        self.nearest.build(stride, height + 2, &self.hidden_beyond_m);
    }
}

impl Nearest for DepthLimits {
    #[inline(always)]
    unsafe fn nearest(&self, first: [i32; 2], last: [i32; 2]) -> f32 {
        // SAFETY: the pyramid has the size of the padded picture
        unsafe { self.nearest.nearest(first, last) }
    }
}

/// What virtual surfaces change in a view: limits with them, and where visibility may differ.
///
/// Only the rectangle of virtual pixels is worked on, and a border of one pixel.
#[derive(Debug, Default)]
pub(super) struct Insertion {
    /// The limits of the whole view with virtual surfaces.
    pub merged_m: Vec<f32>,
    /// First and last padded pixel of the window.
    first: [i32; 2],
    last: [i32; 2],
    /// In the window: at virtual pixels the nearer of the limits with and without them, else infinite.
    changed_m: Vec<f32>,
    nearest: NearestPyramid,
    /// The least of `changed_m`.
    least_m: f32,
}

impl Insertion {
    /// False where `merged` has no virtual pixels; then nothing else is known.
    pub fn prepare(&mut self, real: &DepthLimits, merged: &GBuffer, bias_m: f32) -> bool {
        let Some(([left, top], [right, bottom])) = virtual_rectangle(merged) else { return false };
        let stride = merged.size().width + 2;
        self.merged_m.clone_from(&real.hidden_beyond_m);
        let view_from_world = merged.view.view_from_world_f32().matrix3;
        // Padded, the rectangle is one to the right and one down; the window has a border around that.
        (self.first, self.last) =
            ([left, top].map(|v| v as i32), [right, bottom].map(|v| v as i32 + 2));
        let (columns, width) = (right - left + 1, right - left + 3);
        self.changed_m.clear();
        self.changed_m.resize(width * (bottom - top + 3), f32::INFINITY);
        for row in top..=bottom {
            let at = (row + 1) * stride + left + 1;
            let after = &mut self.merged_m[at..at + columns];
            farthest_row(after, merged, (left, row), &view_from_world, bias_m);
            let before = &real.hidden_beyond_m[at..at + columns];
            let origins = &merged.origin.row(row)[left..=right];
            let changed = &mut self.changed_m[(row - top + 1) * width + 1..][..columns];
            for i in 0..columns {
                let nearer = if after[i] < before[i] { after[i] } else { before[i] };
                changed[i] = if origins[i] == Origin::Virtual { nearer } else { f32::INFINITY };
            }
        }
        self.least_m = self.changed_m.iter().copied().fold(f32::INFINITY, f32::min);
        self.nearest.build(width, bottom - top + 3, &self.changed_m);
        true
    }

    /// Whether samples between these (u, v, z) may be hidden by what has changed.
    #[inline(always)]
    pub fn meets(&self, low: &[f32; 3], high: &[f32; 3]) -> bool {
        let overlaps =
            |k: usize| high[k] >= self.first[k] as f32 && low[k] <= self.last[k] as f32 + 1.0;
        overlaps(0) && overlaps(1) && high[2] > self.least_m
    }

    /// Whether any of the 16 samples is hidden by what has changed.
    #[inline(always)]
    pub fn hides_any(&self, place: &Place) -> bool {
        let width = self.last[0] - self.first[0] + 1;
        let mut any = 0;
        for i in 0..LANES {
            let [u, v] = self.within([place.u[i], place.v[i]]);
            // SAFETY: both lie in the window
            let limit = unsafe { *self.changed_m.get_unchecked((v * width + u) as usize) };
            any |= u32::from(place.z[i] > limit);
        }
        any != 0
    }

    /// The pixel of the window that is nearest to a padded pixel, from the window's corner.
    #[inline(always)]
    fn within(&self, at: [i32; 2]) -> [i32; 2] {
        let (u, v) = (at[0].min(self.last[0]), at[1].min(self.last[1]));
        [u.max(self.first[0]) - self.first[0], v.max(self.first[1]) - self.first[1]]
    }
}

impl Nearest for Insertion {
    #[inline(always)]
    unsafe fn nearest(&self, first: [i32; 2], last: [i32; 2]) -> f32 {
        // SAFETY: both lie in the window, in the same order as before
        unsafe { self.nearest.nearest(self.within(first), self.within(last)) }
    }
}

/// First and last column and row of the virtual pixels.
fn virtual_rectangle(buffer: &GBuffer) -> Option<([usize; 2], [usize; 2])> {
    let mut found: Option<([usize; 2], [usize; 2])> = None;
    for row in 0..buffer.size().height {
        let origins = buffer.origin.row(row);
        let is_virtual = |o: &Origin| *o == Origin::Virtual;
        let Some(left) = origins.iter().position(is_virtual) else { continue };
        let right = origins.iter().rposition(is_virtual).unwrap_or(left);
        let (first, last) = found.get_or_insert(([left, row], [right, row]));
        *first = [first[0].min(left), first[1]];
        *last = [last[0].max(right), row];
    }
    found
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn farthest_row(
    out: &mut [f32],
    buffer: &GBuffer,
    (left, row): (usize, usize),
    view_from_world: &Mat3A,
    bias_m: f32,
) {
    let depth = &buffer.depth_m.row(row)[left..left + out.len()];
    let nx = &buffer.normals.x.row(row)[left..left + out.len()];
    let ny = &buffer.normals.y.row(row)[left..left + out.len()];
    let nz = &buffer.normals.z.row(row)[left..left + out.len()];
    let m = view_from_world.to_cols_array_2d();
    let (scale, centre) = buffer.view.scale_and_centre();
    let half_pixel = 0.5 / scale;
    let perspective = buffer.view.is_perspective();
    let ray_y = (row as f32 - centre.y) / scale.y;
    for i in 0..out.len() {
        let n: [f32; 3] =
            std::array::from_fn(|k| m[0][k] * nx[i] + m[1][k] * ny[i] + m[2][k] * nz[i]);
        let ray_x = ((left + i) as f32 - centre.x) / scale.x;
        let across = n[0].abs() * half_pixel.x + n[1].abs() * half_pixel.y;
        let z = depth[i];
        // Plane n.p = const: inverse depth is linear in the pixel in a perspective view, depth itself
        // in an orthographic one. Seen edge on within the pixel (or NaN), it hides nothing.
        let (along, shown) = if perspective {
            let along = (n[0] * ray_x + n[1] * ray_y + n[2]).abs();
            (along, along > across)
        } else {
            (n[2].abs(), n[2].abs() > 0.0)
        };
        let far = if perspective { z * along / (along - across) } else { z + across / along };
        let far = if shown { far } else { f32::INFINITY };
        // Without a normal there is no plane to extend.
        let no_normal = (n[0] == 0.0) & (n[1] == 0.0) & (n[2] == 0.0);
        let far = if no_normal { z } else { far };
        let present = (z > 0.0) & (z < f32::INFINITY);
        out[i] = if present { far + bias_m } else { f32::INFINITY };
    }
}

/// The limit of one pixel.
#[cfg(test)]
pub(super) fn limit_m(buffer: &GBuffer, (x, y): (usize, usize), bias_m: f32) -> f32 {
    let mut out = [0.0];
    let view_from_world = buffer.view.view_from_world_f32().matrix3;
    farthest_row(&mut out, buffer, (x, y), &view_from_world, bias_m);
    out[0]
}
