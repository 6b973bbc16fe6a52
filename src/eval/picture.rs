//! Picture error: PSNR, SSIM and relative RMSE inside a mask.

use super::EvalError;
use crate::image::{Image, Size};

#[cfg(test)]
mod tests;

const PEAK: f64 = 255.0;

/// Side of the SSIM window.
const WINDOW: usize = 11;

/// Peak signal-to-noise ratio in dB of 8-bit pictures, over all channels; +inf where they are
/// equal.
pub fn psnr_db(a: &Image<[u8; 3]>, b: &Image<[u8; 3]>) -> Result<f64, EvalError> {
    same_size(a.size(), b.size(), 1)?;
    let squares: u64 = a
        .as_slice()
        .iter()
        .flatten()
        .zip(b.as_slice().iter().flatten())
        .map(|(&a, &b)| u64::from(a.abs_diff(b)).pow(2))
        .sum();
    let mse = squares as f64 / (3 * a.size().pixels()) as f64;
    Ok(10.0 * (PEAK * PEAK / mse).log10())
}

/// Mean structural similarity of the luma (Wang et al. 2004): 11x11 Gaussian window with a standard
/// deviation of 1.5 pixels, K1 = 0.01, K2 = 0.03, over all windows that lie inside the picture, at
/// full resolution. Luma is Rec. 601 on encoded values, as in that paper's own program.
pub fn ssim(a: &Image<[u8; 3]>, b: &Image<[u8; 3]>) -> Result<f64, EvalError> {
    same_size(a.size(), b.size(), WINDOW)?;
    let (c1, c2) = ((0.01 * PEAK).powi(2), (0.03 * PEAK).powi(2));
    let (a, b) = (luma(a), luma(b));
    let (mean_a, mean_b) = (blur(&a), blur(&b));
    let (aa, bb, ab) = (blur(&product(&a, &a)), blur(&product(&b, &b)), blur(&product(&a, &b)));
    let mut sum = 0.0;
    for i in 0..mean_a.as_slice().len() {
        let (ma, mb) = (mean_a.as_slice()[i], mean_b.as_slice()[i]);
        let variance_a = aa.as_slice()[i] - ma * ma;
        let variance_b = bb.as_slice()[i] - mb * mb;
        let covariance = ab.as_slice()[i] - ma * mb;
        sum += (2.0 * ma * mb + c1) * (2.0 * covariance + c2)
            / ((ma * ma + mb * mb + c1) * (variance_a + variance_b + c2));
    }
    Ok(sum / mean_a.size().pixels() as f64)
}

/// Root mean square of `estimate - truth` relative to that of `truth`, over the channels of all
/// pixels where `mask` is set. To measure a change of light alone, give the pictures' differences
/// from the unchanged one.
pub fn relative_rmse(
    estimate: &Image<[f32; 3]>,
    truth: &Image<[f32; 3]>,
    mask: &Image<bool>,
) -> Result<f64, EvalError> {
    same_size(estimate.size(), truth.size(), 1)?;
    same_size(mask.size(), truth.size(), 1)?;
    let (mut error, mut norm) = (0.0, 0.0);
    let pixels = estimate.as_slice().iter().zip(truth.as_slice()).zip(mask.as_slice());
    for ((estimate, truth), _) in pixels.filter(|&(_, &inside)| inside) {
        for (&estimate, &truth) in estimate.iter().zip(truth) {
            error += (f64::from(estimate) - f64::from(truth)).powi(2);
            norm += f64::from(truth).powi(2);
        }
    }
    if !(norm > 0.0 && norm.is_finite() && error.is_finite()) {
        let why = "relative RMSE: the truth inside the mask is empty, black or not finite";
        return Err(EvalError::Undefined(why.into()));
    }
    Ok((error / norm).sqrt())
}

/// Where any channel of two pictures differs by more than `threshold`.
pub fn changed(
    before: &Image<[f32; 3]>,
    after: &Image<[f32; 3]>,
    threshold: f32,
) -> Result<Image<bool>, EvalError> {
    same_size(before.size(), after.size(), 1)?;
    let pixels = before.as_slice().iter().zip(after.as_slice());
    let differs = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).any(|k| (a[k] - b[k]).abs() > threshold);
    Ok(Image::from_vec(before.size(), pixels.map(differs).collect()))
}

pub(crate) fn same_size(a: Size, b: Size, window: usize) -> Result<(), EvalError> {
    if a != b {
        return Err(EvalError::SizeMismatch(a, b));
    }
    if a.width < window || a.height < window {
        return Err(EvalError::PictureTooSmall { size: a, window });
    }
    Ok(())
}

fn luma(image: &Image<[u8; 3]>) -> Image<f64> {
    let weights = [0.299, 0.587, 0.114];
    let luma = |rgb: &[u8; 3]| (0..3).map(|k| weights[k] * f64::from(rgb[k])).sum();
    Image::from_vec(image.size(), image.as_slice().iter().map(luma).collect())
}

fn product(a: &Image<f64>, b: &Image<f64>) -> Image<f64> {
    let values = a.as_slice().iter().zip(b.as_slice()).map(|(a, b)| a * b);
    Image::from_vec(a.size(), values.collect())
}

/// Gaussian means of all windows inside the image, which is at least as large as one.
fn blur(image: &Image<f64>) -> Image<f64> {
    let kernel = gaussian();
    let size = Size::new(image.width() - WINDOW + 1, image.height());
    let mut across = Image::new(size, 0.0);
    for y in 0..size.height {
        let row = image.row(y);
        for (x, out) in across.row_mut(y).iter_mut().enumerate() {
            *out = row[x..x + WINDOW].iter().zip(kernel).map(|(v, k)| v * k).sum();
        }
    }
    let mut out = Image::new(Size::new(size.width, image.height() - WINDOW + 1), 0.0);
    for y in 0..out.height() {
        for (i, k) in kernel.into_iter().enumerate() {
            let row = out.row_mut(y).iter_mut();
            row.zip(across.row(y + i)).for_each(|(out, v)| *out += k * v);
        }
    }
    out
}

fn gaussian() -> [f64; WINDOW] {
    let centre = (WINDOW / 2) as f64;
    let weights: [f64; WINDOW] =
        std::array::from_fn(|i| (-(i as f64 - centre).powi(2) / (2.0 * 1.5 * 1.5)).exp());
    let sum: f64 = weights.iter().sum();
    weights.map(|w| w / sum)
}
