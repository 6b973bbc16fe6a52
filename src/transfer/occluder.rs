//! A geometry buffer, made ready for the look-up of sample points.

use super::directions::{DirectionSet, LANES};
use crate::geometry::GBuffer;
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
#[derive(Debug, Default)]
pub(super) struct Occluder {
    pub perspective: bool,
    pub view_from_main: Affine3A,
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
    /// The sample directions in view axes.
    directions: Vec<[f32; 3]>,
}

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
    }

    /// Which pixel of the buffer a padded index stands for.
    pub fn pixel(&self, padded: usize) -> (usize, usize) {
        let stride = self.width + 2;
        (padded % stride - 1, padded / stride - 1)
    }

    /// Cosine between each sample's direction and the surface that hides it, where that is larger
    /// than what `best` holds; `hit` then takes `first_code` plus the padded pixel index.
    ///
    /// `x` are 16 points in main-view axes.
    #[inline(always)]
    pub fn cast<const TRACK: bool>(
        &self,
        samples: &Samples,
        best: &mut [[f32; LANES]],
        hit: &mut [[u32; LANES]],
        first_code: u32,
    ) {
        let x = transformed(&self.view_from_main, &samples.x);
        let turn = Affine3A::from_mat3(self.view_from_main.matrix3.into());
        let n = transformed(&turn, &samples.n);
        if self.perspective {
            self.cast_as::<true, TRACK>(&x, &n, samples, best, hit, first_code);
        } else {
            self.cast_as::<false, TRACK>(&x, &n, samples, best, hit, first_code);
        }
    }

    #[inline(always)]
    fn cast_as<const PERSPECTIVE: bool, const TRACK: bool>(
        &self,
        x: &[[f32; LANES]; 3],
        n: &[[f32; LANES]; 3],
        samples: &Samples,
        best: &mut [[f32; LANES]],
        hit: &mut [[u32; LANES]],
        first_code: u32,
    ) {
        assert_eq!(self.hidden_beyond_m.len(), (self.width + 2) * (self.height + 2));
        assert!(best.len() >= samples.active.len());
        assert!(!TRACK || hit.len() >= samples.active.len());
        for (k, &direction) in samples.active.iter().enumerate() {
            let w = &self.directions[direction as usize];
            for sample in 0..samples.set.samples {
                let r = samples.set.distances(direction as usize, sample, samples.i, samples.j);
                let place = self.locate::<PERSPECTIVE>(x, w, r);
                let mut limit = [0f32; LANES];
                let mut any = 0;
                for i in 0..LANES {
                    // SAFETY: `locate` stays inside the padded image, whose size is asserted above
                    limit[i] =
                        unsafe { *self.hidden_beyond_m.get_unchecked(place.index[i] as usize) };
                    any |= u32::from(place.z[i] > limit[i]);
                }
                if any == 0 {
                    continue;
                }
                let cosine = self.fit::<PERSPECTIVE>(x, n, w, r, &place, &limit);
                let mut codes = if TRACK { hit[k] } else { [0; LANES] };
                for i in 0..LANES {
                    let better = cosine[i] > best[k][i];
                    best[k][i] = if better { cosine[i] } else { best[k][i] };
                    codes[i] = if better { first_code + place.index[i] as u32 } else { codes[i] };
                }
                if TRACK {
                    hit[k] = codes;
                }
            }
        }
    }

    /// Projects the samples y = x + r w.
    #[inline(always)]
    fn locate<const PERSPECTIVE: bool>(
        &self,
        x: &[[f32; LANES]; 3],
        w: &[f32; 3],
        r: &[f32; LANES],
    ) -> Place {
        let stride = (self.width + 2) as i32;
        let (u_max, v_max) = (self.width as f32 + 1.5, self.height as f32 + 1.5);
        let mut place = Place { index: [0; LANES], z: [0.0; LANES], inverse: [1.0; LANES] };
        for i in 0..LANES {
            let (yx, yy) = (x[0][i] + r[i] * w[0], x[1][i] + r[i] * w[1]);
            let z = x[2][i] + r[i] * w[2];
            // At or behind the camera: never beyond a depth, wherever this projects to.
            let inverse = if PERSPECTIVE { 1.0 / z } else { 1.0 };
            let u = clamped(yx * inverse * self.scale.x + self.centre.x, u_max);
            let v = clamped(yy * inverse * self.scale.y + self.centre.y, v_max);
            // SAFETY: both are finite, in [0, width + 1.5] and [0, height + 1.5], so that the index
            // is at most (height + 1) * (width + 2) + width + 1
            let (u, v) = unsafe { (u.to_int_unchecked::<i32>(), v.to_int_unchecked::<i32>()) };
            place.index[i] = v * stride + u;
            place.z[i] = z;
            place.inverse[i] = inverse;
        }
        place
    }

    /// t of Eq. 7 and its cosine with w, where the sample is hidden.
    #[inline(always)]
    fn fit<const PERSPECTIVE: bool>(
        &self,
        x: &[[f32; LANES]; 3],
        n: &[[f32; LANES]; 3],
        w: &[f32; 3],
        r: &[f32; LANES],
        place: &Place,
        limit: &[f32; LANES],
    ) -> [f32; LANES] {
        let mut fit = [NOT_HIDDEN; LANES];
        for i in 0..LANES {
            let depth = limit[i] - self.bias_m;
            let f = if PERSPECTIVE { depth * place.inverse[i] } else { 1.0 };
            let tx = (x[0][i] + r[i] * w[0]) * f - x[0][i];
            let ty = (x[1][i] + r[i] * w[1]) * f - x[1][i];
            let tz = depth - x[2][i];
            let length = (tx * tx + ty * ty + tz * tz).sqrt();
            // A surface at x itself has no direction and hides nothing: 0 / 1e-20.
            let length = if length > 1e-20 { length } else { 1e-20 };
            let cosine = (tx * w[0] + ty * w[1] + tz * w[2]) / length;
            // What lies below the horizon of x cannot hide anything above it.
            let above = tx * n[0][i] + ty * n[1][i] + tz * n[2][i] > 0.0;
            fit[i] = if (place.z[i] > limit[i]) & above { cosine } else { NOT_HIDDEN };
        }
        fit
    }

    /// Number of padded pixels.
    pub fn padded_len(&self) -> usize {
        self.hidden_beyond_m.len()
    }
}

/// Cosine of a sample that no surface hides.
pub(super) const NOT_HIDDEN: f32 = -2.0;

/// Where 16 samples lie in a view: padded pixel, depth, and 1 / depth (1 in an orthographic view).
struct Place {
    index: [i32; LANES],
    z: [f32; LANES],
    inverse: [f32; LANES],
}

/// 16 surface points and the directions to look along.
pub(super) struct Samples<'a> {
    pub set: &'a DirectionSet,
    /// Points in main-view axes, lifted off their surface, and the surface's normals.
    pub x: [[f32; LANES]; 3],
    pub n: [[f32; LANES]; 3],
    /// The first point's place in the grid, which the jitter depends on.
    pub i: usize,
    pub j: usize,
    pub active: &'a [u32],
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
