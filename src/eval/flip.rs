//! FLIP: the difference that is seen when two pictures are flipped back and forth, pixel by pixel
//! (Andersson et al., "FLIP: A Difference Evaluator for Alternating Images", 2020; low dynamic
//! range).
//!
//! ```text
//! YCxCz -> contrast sensitivity filters -> Hunt-adjusted L*a*b* -> HyAB -> redistributed --.
//!   '-> luminance -> edges, points -> largest difference --------------------- exponent --'-> map
//! ```

use super::{EvalError, picture};
use crate::image::{Image, Size};
use crate::math::color::LINEAR_FROM_SRGB8;
use rayon::prelude::*;
use separable::{Kernel, filter};
use std::f64::consts::PI;

mod separable;
#[cfg(test)]
mod tests;

/// A screen of 0.7 m with 3840 pixels, seen from 0.7 m: about 67.
pub const PIXELS_PER_DEGREE: f64 = 3840.0 * PI / 180.0;

/// Contrast sensitivity of the three channels of YCxCz: amplitudes and widths, in squared degrees, of
/// two Gaussians each (their Table 1).
const SENSITIVITY: [[(f64, f64); 2]; 3] =
    [[(1.0, 0.0047), (0.0, 1e-5)], [(1.0, 0.0053), (0.0, 1e-5)], [(34.1, 0.04), (13.5, 0.025)]];
const WIDEST: f64 = 0.04;

/// Exponent of the colour difference; the share of the largest one that is spread over most of the
/// range, and that range (their Sec. 4.1.3).
const COLOR_EXPONENT: f32 = 0.7;
const COMMON_SHARE: f32 = 0.4;
const COMMON_RANGE: f32 = 0.95;

/// Width of a feature, degrees, and the exponent of its difference (their Sec. 4.2).
const FEATURE_WIDTH_DEG: f64 = 0.082;
const FEATURE_EXPONENT: f32 = 0.5;

/// sRGB primaries and white D65.
const XYZ_FROM_RGB: [[f64; 3]; 3] = [
    [10_135_552.0 / 24_577_794.0, 8_788_810.0 / 24_577_794.0, 4_435_075.0 / 24_577_794.0],
    [2_613_072.0 / 12_288_897.0, 8_788_810.0 / 12_288_897.0, 887_015.0 / 12_288_897.0],
    [1_425_312.0 / 73_733_382.0, 8_788_810.0 / 73_733_382.0, 70_074_185.0 / 73_733_382.0],
];

type Planes = [Image<f32>; 3];

/// Mean of [`flip_map`] at [`PIXELS_PER_DEGREE`].
///
/// # Errors
/// Pictures of different size, or empty ones.
pub fn flip(reference: &Image<[u8; 3]>, test: &Image<[u8; 3]>) -> Result<f64, EvalError> {
    let map = flip_map(reference, test, PIXELS_PER_DEGREE)?;
    let sum: f64 = map.as_slice().iter().map(|&v| f64::from(v)).sum();
    Ok(sum / map.size().pixels() as f64)
}

/// Difference of each pixel, 0 (equal) to 1, for 8-bit sRGB pictures.
///
/// # Errors
/// Pictures of different size, or empty ones; a resolution outside 1 to 1000.
pub fn flip_map(
    reference: &Image<[u8; 3]>,
    test: &Image<[u8; 3]>,
    pixels_per_degree: f64,
) -> Result<Image<f32>, EvalError> {
    picture::same_size(reference.size(), test.size(), 1)?;
    // A pixel wider than a degree leaves nothing of the filters, NaN included.
    if !(1.0..=1000.0).contains(&pixels_per_degree) {
        let why = format!("FLIP at {pixels_per_degree} pixels a degree: it must be 1 to 1000");
        return Err(EvalError::Undefined(why));
    }
    let colors = Colors::new();
    let (reference, test) = (colors.opponent(reference), colors.opponent(test));
    let mut map = colors
        .difference(&filtered(&reference, pixels_per_degree), &filtered(&test, pixels_per_degree));
    let features = FeatureKernels::new(pixels_per_degree);
    let (seen, shown) = (features.detect(&reference[0]), features.detect(&test[0]));
    map.as_mut_slice().par_iter_mut().enumerate().for_each(|(i, color)| {
        let differs = |k: usize| (seen[k].as_slice()[i] - shown[k].as_slice()[i]).abs();
        let feature = differs(0).max(differs(1)) * std::f32::consts::FRAC_1_SQRT_2;
        *color = color.powf(1.0 - feature.powf(FEATURE_EXPONENT).min(1.0));
    });
    Ok(map)
}

/// What the eye resolves of each channel.
fn filtered(opponent: &Planes, pixels_per_degree: f64) -> Planes {
    // three standard deviations of the widest Gaussian
    let radius = (3.0 * (WIDEST / (2.0 * PI * PI)).sqrt() * pixels_per_degree).ceil() as usize;
    std::array::from_fn(|channel| {
        // A sum of two Gaussians is no product of a row and a column, but each of them is.
        let gaussian = |(amplitude, width): (f64, f64)| {
            let at = |x: f64| (-(PI * x / pixels_per_degree).powi(2) / width).exp();
            let (kernel, sum) = Kernel::normalised(radius, at);
            (kernel, amplitude * (PI / width).sqrt() * sum * sum)
        };
        let [(narrow, a), (wide, b)] = SENSITIVITY[channel].map(gaussian);
        let mut out = filter(&opponent[channel], &narrow, &narrow);
        if b > 0.0 {
            let second = filter(&opponent[channel], &wide, &wide);
            let (a, b) = ((a / (a + b)) as f32, (b / (a + b)) as f32);
            let sums = out.as_mut_slice().par_iter_mut().zip(second.as_slice());
            sums.for_each(|(v, w)| *v = a * *v + b * w);
        }
        out
    })
}

/// Colour spaces as matrices in f32.
struct Colors {
    xyz_from_rgb: glam::Mat3,
    rgb_from_xyz: glam::Mat3,
    white: glam::Vec3,
    /// Largest colour difference on a display: from green to blue.
    largest: f32,
}

impl Colors {
    fn new() -> Self {
        let xyz_from_rgb = glam::DMat3::from_cols_array_2d(&XYZ_FROM_RGB).transpose();
        let mut colors = Self {
            xyz_from_rgb: xyz_from_rgb.as_mat3(),
            rgb_from_xyz: xyz_from_rgb.inverse().as_mat3(),
            white: (xyz_from_rgb * glam::DVec3::ONE).as_vec3(),
            largest: 0.0,
        };
        let (green, blue) = (colors.hunt_lab(glam::Vec3::Y), colors.hunt_lab(glam::Vec3::Z));
        colors.largest = hyab(green, blue).powf(COLOR_EXPONENT);
        colors
    }

    /// YCxCz, a linear space of opponent colours, as planes; the first is luminance.
    fn opponent(&self, picture: &Image<[u8; 3]>) -> Planes {
        let ycxcz = |rgb: &[u8; 3]| {
            let linear = glam::Vec3::from(rgb.map(|v| LINEAR_FROM_SRGB8[v as usize]));
            let v = self.xyz_from_rgb * linear / self.white;
            [116.0 * v.y - 16.0, 500.0 * (v.x - v.y), 200.0 * (v.y - v.z)]
        };
        let pixels: Vec<[f32; 3]> = picture.as_slice().par_iter().map(ycxcz).collect();
        std::array::from_fn(|k| {
            Image::from_vec(picture.size(), pixels.iter().map(|p| p[k]).collect())
        })
    }

    /// Linear RGB, as far as a display shows it.
    fn displayed(&self, [y, cx, cz]: [f32; 3]) -> glam::Vec3 {
        let y = (y + 16.0) / 116.0;
        let xyz = glam::Vec3::new(y + cx / 500.0, y, y - cz / 200.0) * self.white;
        (self.rgb_from_xyz * xyz).clamp(glam::Vec3::ZERO, glam::Vec3::ONE)
    }

    /// L*a*b* whose colours fade with darkness (Hunt's effect).
    fn hunt_lab(&self, linear: glam::Vec3) -> glam::Vec3 {
        const DELTA: f32 = 6.0 / 29.0;
        let f = |t: f32| {
            if t > DELTA.powi(3) { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 }
        };
        let v = self.xyz_from_rgb * linear / self.white;
        let lightness = 116.0 * f(v.y) - 16.0;
        let fading = 0.01 * lightness;
        let (a, b) = (500.0 * (f(v.x) - f(v.y)), 200.0 * (f(v.y) - f(v.z)));
        glam::Vec3::new(lightness, fading * a, fading * b)
    }

    /// Colour difference in [0, 1].
    fn difference(&self, reference: &Planes, test: &Planes) -> Image<f32> {
        let lab = |planes: &Planes, i: usize| {
            self.hunt_lab(self.displayed(std::array::from_fn(|k| planes[k].as_slice()[i])))
        };
        let pixel = |i| self.redistributed(hyab(lab(reference, i), lab(test, i)));
        let size = reference[0].size();
        Image::from_vec(size, (0..size.pixels()).into_par_iter().map(pixel).collect())
    }

    fn redistributed(&self, hyab: f32) -> f32 {
        let error = hyab.powf(COLOR_EXPONENT);
        let common = COMMON_SHARE * self.largest;
        if error < common {
            return error * (COMMON_RANGE / common);
        }
        let beyond = (error - common) / (self.largest - common);
        (COMMON_RANGE + beyond * (1.0 - COMMON_RANGE)).min(1.0)
    }
}

/// City blocks in lightness, Euclidean in colour.
fn hyab(a: glam::Vec3, b: glam::Vec3) -> f32 {
    let d = (a - b).abs();
    d.x + d.y.hypot(d.z)
}

/// First and second derivative of a Gaussian, and the Gaussian across.
struct FeatureKernels {
    smooth: Kernel,
    edge: Kernel,
    point: Kernel,
}

impl FeatureKernels {
    fn new(pixels_per_degree: f64) -> Self {
        let deviation = 0.5 * FEATURE_WIDTH_DEG * pixels_per_degree;
        let radius = (3.0 * deviation).ceil() as usize;
        let gaussian = |x: f64| (-0.5 * (x / deviation).powi(2)).exp();
        let (smooth, _) = Kernel::normalised(radius, gaussian);
        let edge = Kernel::balanced(radius, |x| -x * gaussian(x));
        let point = Kernel::balanced(radius, |x| ((x / deviation).powi(2) - 1.0) * gaussian(x));
        Self { smooth, edge, point }
    }

    /// Strength of edges and of points in luminance.
    fn detect(&self, y: &Image<f32>) -> [Image<f32>; 2] {
        let size: Size = y.size();
        let relative = y.as_slice().iter().map(|y| (y + 16.0) / 116.0).collect();
        let luminance = Image::from_vec(size, relative);
        [&self.edge, &self.point].map(|kernel| {
            let mut along = filter(&luminance, kernel, &self.smooth);
            let across = filter(&luminance, &self.smooth, kernel);
            let pairs = along.as_mut_slice().par_iter_mut().zip(across.as_slice());
            pairs.for_each(|(x, y)| *x = x.hypot(*y));
            along
        })
    }
}
