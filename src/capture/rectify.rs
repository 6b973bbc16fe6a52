//! Undistortion of pictures at the door.

use super::calibration::{CameraModel, Distortion};
use crate::image::{Image, Size};
use kornia_image::ImageSize;
use kornia_imgproc::interpolation::{InterpolationMode, remap_u8};
use rayon::prelude::*;

/// For every pixel of the rectified picture, where it is in the recorded one.
pub(super) struct Rectifier {
    size: Size,
    map_x: KorniaMap,
    map_y: KorniaMap,
}

type KorniaMap = kornia_image::Image<f32, 1>;
type KorniaColor = kornia_image::Image<u8, 3>;

/// Map entry of a pixel that the recorded picture does not show.
const OUTSIDE: f32 = -1e6;

impl std::fmt::Debug for Rectifier {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Rectifier").field("size", &self.size).finish_non_exhaustive()
    }
}

impl Rectifier {
    /// `None` for a camera without distortion. The rectified picture of a fish-eye keeps its scale on
    /// the axis, and so shows only the middle of what the lens sees.
    pub fn new(camera: &CameraModel) -> Result<Option<Self>, String> {
        let lens = camera.distortion;
        if lens.is_none() {
            return Ok(None);
        }
        let size = camera.size();
        let limit = fold_radius(&lens);
        let map: Vec<(f32, f32)> = (0..size.pixels())
            .into_par_iter()
            .map(|i| {
                let x = ((i % size.width) as f64 - camera.cx) / camera.fx;
                let y = ((i / size.width) as f64 - camera.cy) / camera.fy;
                let seen = x.hypot(y) < limit;
                let (xd, yd) = lens.distort(x, y);
                let (u, v) =
                    ((xd * camera.fx + camera.cx) as f32, (yd * camera.fy + camera.cy) as f32);
                let seen = seen && u.abs().max(v.abs()) < -OUTSIDE;
                if seen { (u, v) } else { (OUTSIDE, OUTSIDE) }
            })
            .collect();
        let (map_x, map_y) = map.into_iter().unzip();
        let kornia = |data| {
            KorniaMap::new(ImageSize { width: size.width, height: size.height }, data)
                .map_err(|e| e.to_string())
        };
        Ok(Some(Self { size, map_x: kornia(map_x)?, map_y: kornia(map_y)? }))
    }

    /// Bilinear; black where the recorded picture shows nothing. `recorded` has the camera's size.
    pub fn color(&self, recorded: Image<[u8; 3]>) -> Result<Image<[u8; 3]>, String> {
        let size = ImageSize { width: self.size.width, height: self.size.height };
        let source = KorniaColor::new(size, recorded.into_vec().into_flattened());
        let source = source.map_err(|e| e.to_string())?;
        let mut out = KorniaColor::from_size_val(size, 0).map_err(|e| e.to_string())?;
        remap_u8(&source, &mut out, &self.map_x, &self.map_y, InterpolationMode::Bilinear)
            .map_err(|e| e.to_string())?;
        Ok(Image::from_vec(self.size, out.as_slice().as_chunks::<3>().0.to_vec()))
    }

    /// Depth that is registered to the distorted colour picture. Bilinear on a surface; the nearest
    /// pixel beside a step or a hole, so that no depth appears between two surfaces.
    pub fn depth(&self, recorded: &Image<f32>) -> Image<f32> {
        let mut out = Image::new(self.size, 0.0);
        let (map_x, map_y, width) = (self.map_x.as_slice(), self.map_y.as_slice(), self.size.width);
        out.par_rows_mut().for_each(|(y, row)| {
            let at = y * width..(y + 1) * width;
            sample_row(recorded, &map_x[at.clone()], &map_y[at], row);
        });
        out
    }
}

/// Largest depth step between neighbouring pixels of one surface, in metres: a plane at 85 degrees
/// seen with f = 580 pixels, and two quantisation steps of a Kinect v1.
pub(super) fn largest_step_m(depth_m: f32) -> f32 {
    0.02 * depth_m + 0.006 * depth_m * depth_m
}

/// Dispatched for the sake of `floor`, which is a call on the baseline.
#[multiversion::multiversion(targets("x86_64+avx2+fma+bmi2"))]
fn sample_row(image: &Image<f32>, map_x: &[f32], map_y: &[f32], out: &mut [f32]) {
    for ((out, &u), &v) in out.iter_mut().zip(map_x).zip(map_y) {
        *out = sample_depth(image, u, v);
    }
}

#[inline(always)]
fn sample_depth(image: &Image<f32>, u: f32, v: f32) -> f32 {
    let (width, height) = (image.width() as f32, image.height() as f32);
    // The negation is true for NaN as well.
    if !(u >= -0.5 && v >= -0.5 && u < width - 0.5 && v < height - 0.5) {
        return 0.0;
    }
    let (u0, v0) = (u.floor(), v.floor());
    let (x, y) = (u0 as isize, v0 as isize);
    let [a, b, c, d] =
        [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)].map(|(x, y)| image.clamped(x, y));
    let low = a.min(b).min(c).min(d);
    let high = a.max(b).max(c).max(d);
    if low > 0.0 && high - low <= largest_step_m(low) {
        let (s, t) = (u - u0, v - v0);
        let (top, bottom) = (a + (b - a) * s, c + (d - c) * s);
        return top + (bottom - top) * t;
    }
    image.clamped((u + 0.5).floor() as isize, (v + 0.5).floor() as isize)
}

/// Distance from the axis, at z = 1, from which on the radial polynomial maps outer points inwards
/// again; what lies beyond would show as a second copy of the picture.
fn fold_radius(lens: &Distortion) -> f64 {
    const STEP: f64 = 1e-3;
    let mut last = 0.0;
    for i in 1..20_000 {
        let next = lens.radial(f64::from(i) * STEP);
        if next.is_nan() || next <= last {
            return f64::from(i - 1) * STEP;
        }
        last = next;
    }
    f64::INFINITY
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::calibration::built_in;

    fn camera() -> CameraModel {
        built_in("tum_freiburg1").unwrap().color
    }

    #[test]
    fn color_comes_from_where_the_lens_put_it() {
        // A smooth picture, so that bilinear interpolation has a known error.
        let camera = camera();
        let value = |u: f64, v: f64| 128.0 + 60.0 * (u * 0.05).sin() + 60.0 * (v * 0.04).cos();
        let mut recorded = Image::new(camera.size(), [0u8; 3]);
        for y in 0..480 {
            for x in 0..640 {
                let v = value(x as f64, y as f64).round() as u8;
                recorded[(x, y)] = [v, 255 - v, v];
            }
        }
        let out = Rectifier::new(&camera).unwrap().unwrap().color(recorded).unwrap();
        let mut compared = 0;
        for y in (0..480).step_by(7) {
            for x in (0..640).step_by(7) {
                let ideal =
                    ((x as f64 - camera.cx) / camera.fx, (y as f64 - camera.cy) / camera.fy);
                let (xd, yd) = camera.distortion.distort(ideal.0, ideal.1);
                let (u, v) = (xd * camera.fx + camera.cx, yd * camera.fy + camera.cy);
                if u > 0.0 && v > 0.0 && u < 639.0 && v < 479.0 {
                    // 0.5 rounding of the source, 0.5 of the result, 0.06 curvature, 0.2 kornia's
                    // weights of 10 bits
                    let found = f64::from(out[(x, y)][0]);
                    assert!((found - value(u, v)).abs() < 1.3, "{x} {y}: {found} {}", value(u, v));
                    assert!((f64::from(out[(x, y)][1]) - (255.0 - value(u, v))).abs() < 1.3);
                    compared += 1;
                }
            }
        }
        assert!(compared > 5000, "{compared}");
    }

    #[test]
    fn depth_is_smooth_on_a_plane_and_never_between_two_surfaces() {
        let camera = camera();
        let plane = |u: f64| 1.0 + u * 1e-3;
        let mut recorded = Image::new(camera.size(), 0.0f32);
        for y in 0..480 {
            for x in 0..640 {
                recorded[(x, y)] = if y < 240 { plane(x as f64) as f32 } else { 3.0 };
            }
        }
        let out = Rectifier::new(&camera).unwrap().unwrap().depth(&recorded);
        for y in 0..480 {
            for x in 0..640 {
                let ideal =
                    ((x as f64 - camera.cx) / camera.fx, (y as f64 - camera.cy) / camera.fy);
                let (xd, yd) = camera.distortion.distort(ideal.0, ideal.1);
                let (u, v) = (xd * camera.fx + camera.cx, yd * camera.fy + camera.cy);
                let found = f64::from(out[(x, y)]);
                if u > 0.0 && u < 639.0 && v > 0.0 && v < 238.9 {
                    // f32 coordinates of 640 give 3e-5 px, so 1e-7 m; f32 depth 1e-7
                    assert!((found - plane(u)).abs() < 1e-6, "{x} {y}");
                }
                let on_one_surface = found == 0.0 || found == 3.0 || found < 1.65;
                assert!(on_one_surface, "{x} {y}: {found}");
            }
        }
    }

    #[test]
    fn a_fisheye_picture_becomes_a_pinhole_one() {
        let mut camera = camera();
        (camera.fx, camera.fy) = (220.0, 221.0);
        camera.distortion = Distortion::KannalaBrandt { k1: 0.02, k2: -0.01, k3: 3e-3, k4: -1e-3 };
        // A slanted plane's depth by what a fish-eye pixel sees: linear in the rectified picture.
        let plane = |u: f64, v: f64| 2.0 + 4e-4 * u + 3e-4 * v;
        let mut recorded = Image::new(camera.size(), 0.0);
        for (x, y) in (0..480).flat_map(|y| (0..640).map(move |x| (x, y))) {
            let (xd, yd) = ((x as f64 - camera.cx) / camera.fx, (y as f64 - camera.cy) / camera.fy);
            let Some((xu, yu)) = camera.distortion.undistort(xd, yd) else { continue };
            recorded.row_mut(y)[x] =
                plane(xu * camera.fx + camera.cx, yu * camera.fy + camera.cy) as f32;
        }
        let out = Rectifier::new(&camera).unwrap().unwrap().depth(&recorded);
        for (x, y) in (0..480).flat_map(|y| (0..640).map(move |x| (x, y))) {
            let error = f64::from(out[(x, y)]) - plane(x as f64, y as f64);
            // Bilinear in a picture that shrinks: a pixel's second difference at the border, / 8.
            assert!(error.abs() < 1e-4, "{x} {y}: {error}");
        }
    }

    #[test]
    fn a_fold_ends_the_picture() {
        let mut camera = camera();
        camera.distortion = Distortion::Brown { k1: -1.0, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0 };
        // r - r^3 turns at 1/sqrt(3) = 0.577
        assert!((fold_radius(&camera.distortion) - 0.577).abs() < 2e-3);
        let out = Rectifier::new(&camera).unwrap().unwrap().depth(&Image::new(camera.size(), 1.0));
        assert_eq!((out[(0, 0)], out[(320, 255)]), (0.0, 1.0));
    }
}
