//! Where, and by how much, a virtual object changed the light on real surfaces.
//!
//! Changes are differences of linear light from the picture without the object. Path-traced pictures
//! are noisy, and many changes are weaker than the noise of a pixel: differences are averaged over 5x5
//! pixels, those that the object covers left out, in truth and composed frame alike. A pixel counts as
//! changed where the luminance of the averaged true difference is more than four standard deviations
//! of its noise, and at least [`LEAST_CHANGE`].

use crate::eval::EvalError;
use crate::eval::picture::{relative_rmse, same_size};
use crate::image::{Image, Size};
use crate::math::color::{LINEAR_FROM_SRGB8, luminance};
use rayon::prelude::*;

/// In linear light, white = 1: about one 8-bit step of middle grey.
const LEAST_CHANGE: f32 = 0.004;
const NOISE_DEVIATIONS: f32 = 4.0;
/// Half the side of the window that differences are averaged over.
const RADIUS: usize = 2;
/// Pixels this close to the object's mix it with what is behind, and lossy files smear it further.
const OBJECT_MARGIN: usize = 2;

/// The true change of one frame.
pub struct Change {
    real: Image<bool>,
    true_change: Image<[f32; 3]>,
    /// Real surfaces that changed.
    changed: Image<bool>,
    /// Standard deviation of the noise in the luminance of `true_change`.
    noise: f32,
}

/// Errors of a composed frame, see [`super::CompositeFrame`]; NaN where nothing changed.
pub struct ChangeErrors {
    pub changed_rmse: f64,
    pub shadow_found: f64,
    pub spill: f64,
}

impl Change {
    /// `object` marks the pixels that show the object.
    pub fn of(
        input: &Image<[u8; 3]>,
        truth: &Image<[u8; 3]>,
        object: &Image<bool>,
    ) -> Result<Self, EvalError> {
        same_size(input.size(), truth.size(), 1)?;
        same_size(object.size(), truth.size(), 1)?;
        let real = away_from(object);
        let true_change = averaged_difference(input, truth, &real);
        let noise = noise_of(&true_change, &real);
        let least = LEAST_CHANGE.max(NOISE_DEVIATIONS * noise);
        let changed = true_change.as_slice().iter().zip(real.as_slice());
        let changed = changed.map(|(&c, &real)| real && luminance(c).abs() > least).collect();
        Ok(Self { changed: Image::from_vec(real.size(), changed), real, true_change, noise })
    }

    pub fn pixels(&self) -> usize {
        self.changed.as_slice().iter().filter(|&&c| c).count()
    }

    /// Relative RMSE of the luminance of a perfect frame, from the truth's noise.
    pub fn noise_rmse(&self) -> f64 {
        let power: f64 = self.selected(true, &self.true_change).map(|v| v * v).sum();
        f64::from(self.noise) * (self.pixels() as f64 / power).sqrt()
    }

    pub fn errors(
        &self,
        input: &Image<[u8; 3]>,
        composed: &Image<[u8; 3]>,
    ) -> Result<ChangeErrors, EvalError> {
        same_size(input.size(), self.real.size(), 1)?;
        same_size(composed.size(), self.real.size(), 1)?;
        let change = averaged_difference(input, composed, &self.real);
        let changed_rmse = match relative_rmse(&change, &self.true_change, &self.changed) {
            Err(EvalError::Undefined(_)) => f64::NAN,
            result => result?,
        };
        let absolute: f64 = self.selected(true, &self.true_change).map(f64::abs).sum();
        let elsewhere: f64 = self.selected(false, &change).map(f64::abs).sum();
        let pairs = self.selected(true, &change).zip(self.selected(true, &self.true_change));
        let (found, shadow) = pairs
            .filter(|&(_, truth)| truth < 0.0)
            .fold((0.0, 0.0), |(a, b), (found, truth)| (a + found, b + truth));
        Ok(ChangeErrors {
            changed_rmse,
            shadow_found: defined_ratio(found, shadow),
            spill: defined_ratio(elsewhere, absolute),
        })
    }

    /// Luminance of `change` on real surfaces that did, or did not, change.
    fn selected<'a>(
        &'a self,
        changed: bool,
        change: &'a Image<[f32; 3]>,
    ) -> impl Iterator<Item = f64> + 'a {
        let pixels =
            change.as_slice().iter().zip(self.real.as_slice()).zip(self.changed.as_slice());
        pixels
            .filter(move |((_, real), is)| **real && **is == changed)
            .map(|((&c, _), _)| f64::from(luminance(c)))
    }
}

fn defined_ratio(a: f64, b: f64) -> f64 {
    if b == 0.0 { f64::NAN } else { a / b }
}

pub fn linear(picture: &Image<[u8; 3]>) -> Image<[f32; 3]> {
    let pixels = picture.as_slice().iter().map(|c| c.map(|v| LINEAR_FROM_SRGB8[v as usize]));
    Image::from_vec(picture.size(), pixels.collect())
}

/// Pixels further from the object than the margin.
fn away_from(object: &Image<bool>) -> Image<bool> {
    let mut real = Image::new(object.size(), true);
    real.par_rows_mut().for_each(|(y, row)| {
        for (x, real) in row.iter_mut().enumerate() {
            *real = !window(object.size(), x, y, OBJECT_MARGIN).any(|at| object[at]);
        }
    });
    real
}

/// `after - before` in linear light, averaged over the real pixels of each window; zero elsewhere.
fn averaged_difference(
    before: &Image<[u8; 3]>,
    after: &Image<[u8; 3]>,
    real: &Image<bool>,
) -> Image<[f32; 3]> {
    let (before, after) = (linear(before), linear(after));
    let mut out = Image::new(real.size(), [0.0; 3]);
    out.par_rows_mut().for_each(|(y, row)| {
        for (x, out) in row.iter_mut().enumerate().filter(|&(x, _)| real[(x, y)]) {
            let mut sum = [0.0; 3];
            let mut count = 0.0;
            for at in window(real.size(), x, y, RADIUS).filter(|&at| real[at]) {
                (0..3).for_each(|k| sum[k] += after[at][k] - before[at][k]);
                count += 1.0;
            }
            *out = sum.map(|v| v / count); // the pixel itself counts
        }
    });
    out
}

fn window(size: Size, x: usize, y: usize, radius: usize) -> impl Iterator<Item = (usize, usize)> {
    let columns = x.saturating_sub(radius)..(x + radius + 1).min(size.width);
    (y.saturating_sub(radius)..(y + radius + 1).min(size.height))
        .flat_map(move |y| columns.clone().map(move |x| (x, y)))
}

/// Robust standard deviation (1.4826 times the median size) of the luminance: most pixels show noise
/// alone.
fn noise_of(change: &Image<[f32; 3]>, real: &Image<bool>) -> f32 {
    let pixels = change.as_slice().iter().zip(real.as_slice()).filter(|(_, real)| **real);
    let mut sizes: Vec<f32> = pixels.map(|(&c, _)| luminance(c).abs()).collect();
    if sizes.is_empty() {
        return 0.0;
    }
    let middle = sizes.len() / 2;
    1.4826 * *sizes.select_nth_unstable_by(middle, f32::total_cmp).1
}
