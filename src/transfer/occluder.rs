//! A geometry buffer, made ready for the look-up of sample points.

use super::batch::Batch;
use super::directions::{DirectionSet, LANES};
use super::pyramid::NearestPyramid;
use crate::geometry::{GBuffer, Origin};
use crate::image::Image;
use crate::math::{View, affine_from_pose};
use glam::{Affine3A, Mat3A, Vec2};
use rayon::prelude::*;

/// Depth beyond which a sample is hidden, for every pixel of a buffer and a border around it.
///
/// A look-up takes the nearest pixel, half a pixel off at most. On a floor seen at a grazing angle
/// the depth may change by decimetres over that, and the floor would hide samples above itself. So
/// a pixel's depth is taken where the tangent plane of its surface is farthest inside the pixel:
/// a plane never hides what is in front of it, seen from however far and however flat. Pixels without
/// surface, and the border that look-ups outside the image are clamped to, hide nothing.
///
/// Most samples lie in front of everything that is seen near them. So the samples of a batch are
/// first tried together: one look-up in a pyramid of nearest depths tells for one sample of all 16
/// points whether any can be hidden. Bounds are made with the arithmetic of the samples themselves,
/// and rounding keeps the order of numbers, so nothing that is hidden is ever missed.
#[derive(Debug, Default)]
pub(super) struct Occluder {
    perspective: bool,
    view_from_main: Affine3A,
    pub world_from_view: Affine3A,
    /// Padded pixel coordinates: `u = x * scale / w + centre`, to be truncated.
    scale: Vec2,
    centre: Vec2,
    /// Number of columns and rows without the border.
    width: usize,
    height: usize,
    bias_m: f32,
    /// z-depth, bias included; infinite where nothing is hidden.
    hidden_beyond_m: Vec<f32>,
    nearest: NearestPyramid,
    /// The sample directions in view axes.
    directions: Vec<[f32; 3]>,
    /// The change of (u, v, z) a metre by slot, in a perspective view seen from the optical axis.
    slopes: Vec<[[f32; LANES]; 3]>,
}

/// Sixteen points in a view.
struct Points {
    /// In view axes, with the normals.
    x: [[f32; LANES]; 3],
    n: [[f32; LANES]; 3],
    /// Padded pixel coordinates, in a perspective view relative to `origin` and times z.
    u: [f32; LANES],
    v: [f32; LANES],
    origin: Vec2,
    /// Least and greatest (u, v, z).
    low: [f32; 3],
    high: [f32; 3],
}

/// One sample of a batch: w in view axes, the distance r, and the change of (u, v, z) over r.
struct Step {
    w: [f32; 3],
    r: f32,
    change: [f32; 3],
}

/// Where 16 samples lie in a view: padded pixel, depth, and 1 / depth (1 in an orthographic view).
struct Place {
    index: [i32; LANES],
    z: [f32; LANES],
    inverse: [f32; LANES],
}

/// What a batch knows of its samples' visibility, by direction.
pub(super) struct Found<'a> {
    /// max(0, n.w)
    pub cosine: &'a [[f32; LANES]],
    /// Largest t.w of a surface that hides a sample.
    pub best: &'a mut [[f32; LANES]],
    /// Which surface that was, as a code; filled where asked for.
    pub hit: &'a mut [[u32; LANES]],
}

/// What is done with a sample that is hidden in some lane. A trait, as closures cannot be asked to become
/// part of a kernel for particular instructions.
trait Visit {
    fn visit<const PERSPECTIVE: bool>(
        &mut self,
        occluder: &Occluder,
        points: &Points,
        direction: usize,
        step: &Step,
        place: &Place,
        limit: &[f32; LANES],
    );
}

/// Keeps the surface that fits the direction best.
struct Fit<'a, const TRACK: bool> {
    found: Found<'a>,
    first_code: u32,
}

impl<const TRACK: bool> Visit for Fit<'_, TRACK> {
    #[inline(always)]
    fn visit<const PERSPECTIVE: bool>(
        &mut self,
        occluder: &Occluder,
        points: &Points,
        direction: usize,
        step: &Step,
        place: &Place,
        limit: &[f32; LANES],
    ) {
        let Found { cosine, best, hit } = &mut self.found;
        let cosine = occluder.fit::<PERSPECTIVE>(points, step, &cosine[direction], place, limit);
        let best = &mut best[direction];
        let mut codes = if TRACK { hit[direction] } else { [0; LANES] };
        for i in 0..LANES {
            let better = cosine[i] > best[i];
            best[i] = if better { cosine[i] } else { best[i] };
            codes[i] = if better { self.first_code + place.index[i] as u32 } else { codes[i] };
        }
        if TRACK {
            hit[direction] = codes;
        }
    }
}

/// Marks directions in which anything is hidden.
struct Mark<'a> {
    marks: &'a mut [bool],
}

impl Visit for Mark<'_> {
    #[inline(always)]
    fn visit<const PERSPECTIVE: bool>(
        &mut self,
        _: &Occluder,
        _: &Points,
        direction: usize,
        _: &Step,
        _: &Place,
        _: &[f32; LANES],
    ) {
        self.marks[direction] = true;
    }
}

/// Cosine of a sample that no surface hides.
pub(super) const NOT_HIDDEN: f32 = -2.0;

impl Occluder {
    pub fn prepare(&mut self, buffer: &GBuffer, main: &View, set: &DirectionSet, bias_m: f32) {
        let view = &buffer.view;
        let size = buffer.size();
        (self.width, self.height) = (size.width, size.height);
        self.perspective = view.is_perspective();
        self.view_from_main =
            affine_from_pose(&(view.world_from_view.inverse() * main.world_from_view));
        self.world_from_view = view.world_from_view_f32();
        let (scale, centre) = view.scale_and_centre();
        // One pixel of border, and a half for rounding by truncation.
        (self.scale, self.centre) = (scale, centre + 1.5);
        self.bias_m = bias_m;
        let view_from_world = view.view_from_world_f32().matrix3;
        self.directions.clear();
        self.directions.extend(set.directions.iter().map(|&w| (view_from_world * w).to_array()));
        self.find_slopes(set);
        let stride = self.width + 2;
        self.hidden_beyond_m.resize(stride * (self.height + 2), f32::INFINITY);
        let (width, height) = (self.width, self.height);
        self.hidden_beyond_m.par_chunks_mut(stride).enumerate().for_each(|(row, out)| {
            out.fill(f32::INFINITY);
            if (1..=height).contains(&row) && width > 0 {
                let row = row - 1;
                farthest_row(&mut out[1..=width], buffer, row, &view_from_world, bias_m);
            }
        });
        self.nearest.build(stride, self.height + 2, &self.hidden_beyond_m);
    }

    fn find_slopes(&mut self, set: &DirectionSet) {
        self.slopes.resize(set.chunks(), Default::default());
        for (direction, w) in self.directions.iter().enumerate() {
            let slope = [w[0] * self.scale.x, w[1] * self.scale.y, w[2]];
            for slot in set.slots(direction) {
                for (to, from) in self.slopes[slot / LANES].iter_mut().zip(slope) {
                    to[slot % LANES] = from;
                }
            }
        }
    }

    /// Becomes `merged` where that shows virtual surfaces, and hides nothing elsewhere. With `real`, what
    /// the view showed before is kept where that is nearer. A sample that is hidden here may have another
    /// visibility than before; all others have the same. False where there is no virtual pixel.
    pub fn prepare_changed(
        &mut self,
        merged: &Occluder,
        real: Option<&Occluder>,
        origin: &Image<Origin>,
    ) -> bool {
        if !origin.as_slice().contains(&Origin::Virtual) {
            return false;
        }
        self.place_as(merged);
        let stride = self.width + 2;
        for (row, out) in self.hidden_beyond_m.chunks_exact_mut(stride).enumerate() {
            out.fill(f32::INFINITY);
            if !(1..=merged.height).contains(&row) {
                continue;
            }
            let origins = origin.row(row - 1);
            let before = real.map(|real| &real.hidden_beyond_m[row * stride + 1..]);
            let after = &merged.hidden_beyond_m[row * stride + 1..];
            for (i, limit) in out[1..=merged.width].iter_mut().enumerate() {
                if origins[i] == Origin::Virtual {
                    *limit = after[i].min(before.map_or(f32::INFINITY, |before| before[i]));
                }
            }
        }
        self.nearest.build(stride, self.height + 2, &self.hidden_beyond_m);
        true
    }

    fn place_as(&mut self, other: &Occluder) {
        self.perspective = other.perspective;
        self.view_from_main = other.view_from_main;
        self.world_from_view = other.world_from_view;
        (self.scale, self.centre) = (other.scale, other.centre);
        (self.width, self.height) = (other.width, other.height);
        self.bias_m = other.bias_m;
        self.hidden_beyond_m.resize(other.hidden_beyond_m.len(), f32::INFINITY);
        self.directions.clone_from(&other.directions);
        self.slopes.clone_from(&other.slopes);
    }

    /// Which pixel of the buffer a padded index stands for.
    pub fn pixel(&self, padded: usize) -> (usize, usize) {
        let stride = self.width + 2;
        (padded % stride - 1, padded / stride - 1)
    }

    /// Number of padded pixels.
    pub fn padded_len(&self) -> usize {
        self.hidden_beyond_m.len()
    }

    /// Tries the samples in the slots of `wanted`, a bit a slot. Where a surface that hides one fits its
    /// direction better than the best so far, it becomes the best; `hit` then takes `first_code` plus the
    /// padded pixel index.
    #[inline(always)]
    pub fn cast<const TRACK: bool>(
        &self,
        batch: &Batch,
        set: &DirectionSet,
        wanted: &[u16],
        found: Found,
        first_code: u32,
    ) {
        self.each_hidden(batch, set, wanted, &mut Fit::<TRACK> { found, first_code });
    }

    /// Marks the directions in which any sample is hidden.
    #[inline(always)]
    pub fn mark_hidden(
        &self,
        batch: &Batch,
        set: &DirectionSet,
        wanted: &[u16],
        marks: &mut [bool],
    ) {
        self.each_hidden(batch, set, wanted, &mut Mark { marks });
    }

    #[inline(always)]
    fn each_hidden(
        &self,
        batch: &Batch,
        set: &DirectionSet,
        wanted: &[u16],
        visitor: &mut impl Visit,
    ) {
        if self.perspective {
            self.each_hidden_as::<true>(batch, set, wanted, visitor);
        } else {
            self.each_hidden_as::<false>(batch, set, wanted, visitor);
        }
    }

    /// Shows the visitor each wanted sample that is hidden in any lane.
    #[inline(always)]
    fn each_hidden_as<const PERSPECTIVE: bool>(
        &self,
        batch: &Batch,
        set: &DirectionSet,
        wanted: &[u16],
        visitor: &mut impl Visit,
    ) {
        assert_eq!(self.hidden_beyond_m.len(), (self.width + 2) * (self.height + 2));
        let points = self.points::<PERSPECTIVE>(batch);
        let distances = set.distances(batch.cell.0, batch.cell.1);
        for (c, (&wanted, r)) in wanted.iter().zip(distances).enumerate() {
            if wanted == 0 {
                continue;
            }
            let change = self.change::<PERSPECTIVE>(&points, &self.slopes[c], r);
            let mut left = wanted & self.candidates::<PERSPECTIVE>(&points, &change);
            while left != 0 {
                let s = left.trailing_zeros() as usize;
                left &= left - 1;
                let direction = set.direction_of(c * LANES + s);
                let change = [change[0][s], change[1][s], change[2][s]];
                let step = Step { w: self.directions[direction], r: r[s], change };
                let place = self.locate::<PERSPECTIVE>(&points, &step);
                let mut limit = [0f32; LANES];
                let mut any = 0;
                for i in 0..LANES {
                    // SAFETY: `locate` stays inside the padded image, whose size is asserted above
                    limit[i] =
                        unsafe { *self.hidden_beyond_m.get_unchecked(place.index[i] as usize) };
                    any |= u32::from(place.z[i] > limit[i]);
                }
                if any != 0 {
                    visitor.visit::<PERSPECTIVE>(self, &points, direction, &step, &place, &limit);
                }
            }
        }
    }

    /// What the samples of a chunk of slots add to the points' (u, v, z).
    #[inline(always)]
    fn change<const PERSPECTIVE: bool>(
        &self,
        points: &Points,
        slopes: &[[f32; LANES]; 3],
        r: &[f32; LANES],
    ) -> [[f32; LANES]; 3] {
        let offset = points.origin - self.centre;
        let mut change = [[0f32; LANES]; 3];
        for i in 0..LANES {
            let z = slopes[2][i] * r[i];
            let (u, v) = (slopes[0][i] * r[i], slopes[1][i] * r[i]);
            change[0][i] = if PERSPECTIVE { u - offset.x * z } else { u };
            change[1][i] = if PERSPECTIVE { v - offset.y * z } else { v };
            change[2][i] = z;
        }
        change
    }

    #[inline(always)]
    fn points<const PERSPECTIVE: bool>(&self, batch: &Batch) -> Points {
        let x = transformed(&self.view_from_main, &batch.x);
        let turn = Affine3A::from_mat3(self.view_from_main.matrix3.into());
        let n = transformed(&turn, &batch.n_in_main);
        // The first point's pixel: around it, what depends on z alone is small, and bounds are tight.
        let first = self.scale * Vec2::new(x[0][0], x[1][0]) / x[2][0];
        let offset = if PERSPECTIVE && first.is_finite() { first } else { Vec2::ZERO };
        let centre = if PERSPECTIVE { -offset } else { self.centre };
        let origin = if PERSPECTIVE { self.centre + offset } else { Vec2::ZERO };
        let (mut u, mut v) = ([0f32; LANES], [0f32; LANES]);
        for i in 0..LANES {
            let w = if PERSPECTIVE { x[2][i] } else { 1.0 };
            u[i] = x[0][i] * self.scale.x + w * centre.x;
            v[i] = x[1][i] * self.scale.y + w * centre.y;
        }
        let low = [least(u), least(v), least(x[2])];
        let high = [greatest(u), greatest(v), greatest(x[2])];
        Points { x, n, u, v, origin, low, high }
    }

    /// The slots, as bits, whose sample may be hidden in some lane.
    #[inline(always)]
    fn candidates<const PERSPECTIVE: bool>(
        &self,
        points: &Points,
        change: &[[f32; LANES]; 3],
    ) -> u16 {
        let (u_max, v_max) = self.most();
        let Points { low, high, origin, .. } = points;
        let mut maybe = [0u16; LANES];
        for i in 0..LANES {
            let (mut u0, mut u1) = (low[0] + change[0][i], high[0] + change[0][i]);
            let (mut v0, mut v1) = (low[1] + change[1][i], high[1] + change[1][i]);
            let (z0, z1) = (low[2] + change[2][i], high[2] + change[2][i]);
            // Bounds of a quotient hold before the camera alone.
            let bounded = !PERSPECTIVE | (z0 > 1e-3);
            if PERSPECTIVE {
                // A product with a positive factor is greatest at one end of the factor's range.
                let (near, far) = (1.0 / z0, 1.0 / z1);
                u0 = smaller(u0 * near, u0 * far) + origin.x;
                u1 = larger(u1 * near, u1 * far) + origin.x;
                v0 = smaller(v0 * near, v0 * far) + origin.y;
                v1 = larger(v1 * near, v1 * far) + origin.y;
            }
            // SAFETY: as in `locate`
            let (first, last) = unsafe {
                (
                    [clamped(u0, u_max).to_int_unchecked(), clamped(v0, v_max).to_int_unchecked()],
                    [clamped(u1, u_max).to_int_unchecked(), clamped(v1, v_max).to_int_unchecked()],
                )
            };
            // SAFETY: both are pixels of the padded image. Behind the camera their order may be wrong, but
            // only the first is looked up.
            let nearest = unsafe { self.nearest.nearest(first, last) };
            maybe[i] = u16::from(!bounded | (z1 > nearest)) << i;
        }
        maybe.iter().fold(0, |all, bit| all | bit)
    }

    /// Clamped below these, truncated padded coordinates are those of a pixel.
    #[inline(always)]
    fn most(&self) -> (f32, f32) {
        (self.width as f32 + 1.5, self.height as f32 + 1.5)
    }

    /// Projects the samples y = x + r w.
    #[inline(always)]
    fn locate<const PERSPECTIVE: bool>(&self, points: &Points, step: &Step) -> Place {
        let stride = (self.width + 2) as i32;
        let (u_max, v_max) = self.most();
        let mut place = Place { index: [0; LANES], z: [0.0; LANES], inverse: [1.0; LANES] };
        for i in 0..LANES {
            let z = points.x[2][i] + step.change[2];
            // At or behind the camera: never beyond a depth, wherever this projects to.
            let inverse = if PERSPECTIVE { 1.0 / z } else { 1.0 };
            let (mut u, mut v) = (points.u[i] + step.change[0], points.v[i] + step.change[1]);
            if PERSPECTIVE {
                (u, v) = (u * inverse + points.origin.x, v * inverse + points.origin.y);
            }
            let (u, v) = (clamped(u, u_max), clamped(v, v_max));
            // SAFETY: both are finite, in [0, width + 1.5] and [0, height + 1.5], so that the index
            // is at most (height + 1) * (width + 2) + width + 1
            let (u, v) = unsafe { (u.to_int_unchecked::<i32>(), v.to_int_unchecked::<i32>()) };
            place.index[i] = v * stride + u;
            place.z[i] = z;
            place.inverse[i] = inverse;
        }
        place
    }

    /// t of Eq. 7 and its cosine with w, where the sample is hidden. `above` are n.w.
    #[inline(always)]
    fn fit<const PERSPECTIVE: bool>(
        &self,
        points: &Points,
        Step { w, r, change }: &Step,
        above: &[f32; LANES],
        place: &Place,
        limit: &[f32; LANES],
    ) -> [f32; LANES] {
        let Points { x, n, .. } = points;
        let across = w[0] * w[0] + w[1] * w[1];
        let mut fit = [NOT_HIDDEN; LANES];
        for i in 0..LANES {
            let depth = limit[i] - self.bias_m;
            let tz = depth - x[2][i];
            let (along, squared, height) = if PERSPECTIVE {
                let f = depth * place.inverse[i];
                let tx = (x[0][i] + r * w[0]) * f - x[0][i];
                let ty = (x[1][i] + r * w[1]) * f - x[1][i];
                let height = tx * n[0][i] + ty * n[1][i] + tz * n[2][i];
                (tx * w[0] + ty * w[1] + tz * w[2], tx * tx + ty * ty + tz * tz, height)
            } else {
                // t = r w but for its z.
                let height = r * above[i] + (tz - change[2]) * n[2][i];
                (r * across + tz * w[2], r * r * across + tz * tz, height)
            };
            let length = squared.sqrt();
            // A surface at x itself has no direction and hides nothing: 0 / 1e-20.
            let length = if length > 1e-20 { length } else { 1e-20 };
            // What lies below the horizon of x cannot hide anything above it.
            let hides = (place.z[i] > limit[i]) & (height > 0.0);
            fit[i] = if hides { along / length } else { NOT_HIDDEN };
        }
        fit
    }
}

#[inline(always)]
fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline(always)]
fn least(mut v: [f32; LANES]) -> f32 {
    for half in [8, 4, 2, 1] {
        for i in 0..half {
            v[i] = smaller(v[i], v[i + half]);
        }
    }
    v[0]
}

#[inline(always)]
fn greatest(mut v: [f32; LANES]) -> f32 {
    for half in [8, 4, 2, 1] {
        for i in 0..half {
            v[i] = larger(v[i], v[i + half]);
        }
    }
    v[0]
}

/// To [0, max]; NaN becomes 0.
#[inline(always)]
fn clamped(v: f32, max: f32) -> f32 {
    let v = if v > 0.0 { v } else { 0.0 };
    if v < max { v } else { max }
}

#[inline(always)]
pub(super) fn transformed(a: &Affine3A, x: &[[f32; LANES]; 3]) -> [[f32; LANES]; 3] {
    let m = a.matrix3.to_cols_array_2d();
    let t = a.translation.to_array();
    std::array::from_fn(|k| {
        std::array::from_fn(|i| m[0][k] * x[0][i] + m[1][k] * x[1][i] + m[2][k] * x[2][i] + t[k])
    })
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn farthest_row(
    out: &mut [f32],
    buffer: &GBuffer,
    row: usize,
    view_from_world: &Mat3A,
    bias_m: f32,
) {
    let depth = &buffer.depth_m.row(row)[..out.len()];
    let nx = &buffer.normals.x.row(row)[..out.len()];
    let ny = &buffer.normals.y.row(row)[..out.len()];
    let nz = &buffer.normals.z.row(row)[..out.len()];
    let m = view_from_world.to_cols_array_2d();
    let (scale, centre) = buffer.view.scale_and_centre();
    let half_pixel = 0.5 / scale;
    let perspective = buffer.view.is_perspective();
    let ray_y = (row as f32 - centre.y) / scale.y;
    for i in 0..out.len() {
        let n: [f32; 3] =
            std::array::from_fn(|k| m[0][k] * nx[i] + m[1][k] * ny[i] + m[2][k] * nz[i]);
        let ray_x = (i as f32 - centre.x) / scale.x;
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
