//! Where the samples of a batch lie in a view.

#![allow(unsafe_code, reason = "look-ups of inner loops, whose bounds are said beside each")]

use super::batch::Batch;
use super::directions::{DirectionSet, LANES};
use crate::math::{View, affine_from_pose};
use glam::{Affine3A, Vec2};

/// Cosine of a sample that no surface hides.
pub(super) const NOT_HIDDEN: f32 = -2.0;

/// A view, and the sample directions as seen in it.
#[derive(Debug, Default)]
pub(super) struct SampleView {
    /// Whose samples these are, and who sees them.
    views: Option<(View, View)>,
    pub perspective: bool,
    view_from_main: Affine3A,
    pub world_from_view: Affine3A,
    /// Padded pixel coordinates: `u = x * scale / w + centre`, to be truncated.
    scale: Vec2,
    centre: Vec2,
    /// Number of columns and rows without the border.
    pub width: usize,
    pub height: usize,
    bias_m: f32,
    /// The sample directions in view axes.
    pub directions: Vec<[f32; 3]>,
    /// The change of (u, v, z) a metre by slot, in a perspective view seen from the optical axis.
    pub slopes: Vec<[[f32; LANES]; 3]>,
}

/// Sixteen points in a view.
pub(super) struct Points {
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
pub(super) struct Step {
    pub w: [f32; 3],
    pub r: f32,
    pub change: [f32; 3],
}

/// Where 16 samples lie in a view: padded pixel, depth, and 1 / depth (1 in an orthographic view).
pub(super) struct Place {
    pub u: [i32; LANES],
    pub v: [i32; LANES],
    pub index: [i32; LANES],
    pub z: [f32; LANES],
    inverse: [f32; LANES],
}

impl SampleView {
    pub fn prepare(&mut self, view: &View, main: &View, set: &DirectionSet, bias_m: f32) {
        self.views = Some((*main, *view));
        let size = view.size();
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
    }

    pub fn shows(&self, view: &View, main: &View) -> bool {
        self.views == Some((*main, *view))
    }

    /// Number of columns with the border.
    pub fn stride(&self) -> usize {
        self.width + 2
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

    /// What the samples of a chunk of slots add to the points' (u, v, z).
    #[inline(always)]
    pub fn change<const PERSPECTIVE: bool>(
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
    pub fn points<const PERSPECTIVE: bool>(&self, batch: &Batch) -> Points {
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

    /// Bounds of (u, v, z) of all samples within a radius of the points, a pixel wider than they are;
    /// `None` where they may lie behind the camera.
    #[inline(always)]
    pub fn reach<const PERSPECTIVE: bool>(
        &self,
        points: &Points,
        radius_m: f32,
    ) -> Option<([f32; 3], [f32; 3])> {
        let (mut low, mut high) = (points.low, points.high);
        let origin = points.origin.to_array();
        let (scale, centre) = (self.scale.to_array(), self.centre.to_array());
        low[2] -= radius_m;
        high[2] += radius_m;
        if PERSPECTIVE && low[2] <= 1e-3 {
            return None;
        }
        for axis in 0..2 {
            // The longest that a step's change in `change` can be.
            let offset = if PERSPECTIVE { origin[axis] - centre[axis] } else { 0.0 };
            let most = radius_m * (scale[axis] * scale[axis] + offset * offset).sqrt();
            (low[axis], high[axis]) = (low[axis] - most, high[axis] + most);
            if PERSPECTIVE {
                let (near, far) = (1.0 / low[2], 1.0 / high[2]);
                low[axis] = smaller(low[axis] * near, low[axis] * far) + origin[axis];
                high[axis] = larger(high[axis] * near, high[axis] * far) + origin[axis];
            }
            (low[axis], high[axis]) = (low[axis] - 1.0, high[axis] + 1.0);
        }
        Some((low, high))
    }

    /// The slots, as bits, whose sample may be hidden in some lane.
    #[inline(always)]
    pub fn candidates<const PERSPECTIVE: bool>(
        &self,
        points: &Points,
        change: &[[f32; LANES]; 3],
        nearest: &impl Nearest,
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
            let nearest = unsafe { nearest.nearest(first, last) };
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
    pub fn locate<const PERSPECTIVE: bool>(&self, points: &Points, step: &Step) -> Place {
        let stride = (self.width + 2) as i32;
        let (u_max, v_max) = self.most();
        let mut place = Place {
            u: [0; LANES],
            v: [0; LANES],
            index: [0; LANES],
            z: [0.0; LANES],
            inverse: [1.0; LANES],
        };
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
            (place.u[i], place.v[i]) = (u, v);
            place.index[i] = v * stride + u;
            place.z[i] = z;
            place.inverse[i] = inverse;
        }
        place
    }

    /// t of Eq. 7 and its cosine with w, where the sample is hidden. `above` are n.w.
    #[inline(always)]
    pub fn fit<const PERSPECTIVE: bool>(
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

/// Bounds depths from below.
pub(super) trait Nearest {
    /// At most the least depth beyond which samples in these padded pixels are hidden, both inclusive.
    ///
    /// # Safety
    /// Both must lie within the padded picture, and the first's coordinates not exceed the last's, or only
    /// the first is looked at.
    unsafe fn nearest(&self, first: [i32; 2], last: [i32; 2]) -> f32;
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
