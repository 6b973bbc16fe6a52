//! The fall-off of light towards the corners, from pictures of an evenly lit surface.

use super::CalibrateError;
use crate::capture::calibration::{Photometry, Vignetting};
use crate::capture::linear_from_code;
use crate::image::{Image, Size};
use nalgebra::{DMatrix, DVector};

/// Pixels that are averaged to one sample; their noise is small beside the surface's own unevenness.
const CELL: usize = 16;

/// A picture of an evenly lit surface.
#[derive(Clone, Debug)]
pub struct FlatField {
    /// What messages call it.
    pub name: String,
    pub picture: Image<[u8; 3]>,
}

/// Fall-off, and how well the pictures follow it.
#[derive(Clone, Debug)]
pub struct FoundVignetting {
    pub vignetting: Vignetting,
    pub samples: usize,
    /// RMS of the relative difference.
    pub rms: f64,
    /// Share of light that reaches the farthest corner.
    pub corner: f64,
}

/// Logarithm of light at a place, and which picture it is from.
struct Sample {
    /// -1 to 1 over the longer side, from the centre.
    x: f64,
    y: f64,
    radius2: f64,
    picture: usize,
    log_light: f64,
}

/// Fits one fall-off to all pictures. Each may have its own brightness and its own even gradient of
/// illumination, which no one can avoid on a wall; `center` is in shares of width and height, best that
/// of the lens. Codes are read through the response of `photometry`, where it has one.
pub fn find_vignetting(
    pictures: &[FlatField],
    photometry: &Photometry,
    center: [f64; 2],
) -> Result<FoundVignetting, CalibrateError> {
    let first = pictures.first().ok_or(CalibrateError::Options("no pictures".into()))?;
    let size = first.picture.size();
    if let Some(other) = pictures.iter().find(|p| p.picture.size() != size) {
        return Err(CalibrateError::Options(format!(
            "pictures of the flat field differ in size: {} has {size} pixels, {} has {}",
            first.name,
            other.name,
            other.picture.size()
        )));
    }
    let frame = Vignetting { center, falloff: [0.0; 3] };
    let curves = linear_from_code(photometry);
    let mut samples: Vec<Sample> = Vec::new();
    for (i, FlatField { name, picture }) in pictures.iter().enumerate() {
        let own = cells(picture, i, &frame, &curves);
        // Level and gradient of each picture are three unknowns.
        if own.len() < 4 {
            let count = own.len();
            return Err(CalibrateError::Data(format!(
                "{name}: {count} cells of {CELL} pixels are neither dark nor saturated: too few"
            )));
        }
        samples.extend(own);
    }
    if samples.len() < 50 {
        let problem =
            format!("{} cells of {CELL} pixels are neither dark nor saturated", samples.len());
        return Err(CalibrateError::Data(format!("{problem}: too few")));
    }
    let solution = robust_fit(&samples, pictures.len())?;
    let falloff = [solution[0], solution[1], solution[2]];
    let vignetting = Vignetting { center, falloff };
    let square: f64 = samples.iter().map(|s| residual(s, &solution).powi(2)).sum();
    Ok(FoundVignetting {
        vignetting,
        samples: samples.len(),
        rms: (square / samples.len() as f64).sqrt(),
        corner: vignetting.share(farthest(&frame, size)),
    })
}

fn farthest(frame: &Vignetting, size: Size) -> f64 {
    let (right, bottom) = ((size.width - 1) as f64, (size.height - 1) as f64);
    [(0.0, 0.0), (right, 0.0), (0.0, bottom), (right, bottom)]
        .iter()
        .map(|&(x, y)| frame.radius2(x, y, size.width, size.height))
        .fold(0.0, f64::max)
}

/// Light of each cell, all channels together; cells with a pixel near an end of the codes are left out.
fn cells(
    picture: &Image<[u8; 3]>,
    index: usize,
    frame: &Vignetting,
    curves: &[[f32; 256]; 3],
) -> Vec<Sample> {
    let size = picture.size();
    let half = 0.5 * size.width.max(size.height) as f64;
    let mut found = Vec::new();
    for top in (0..size.height.saturating_sub(CELL - 1)).step_by(CELL) {
        for left in (0..size.width.saturating_sub(CELL - 1)).step_by(CELL) {
            let Some(light) = mean_light(picture, left, top, curves) else { continue };
            let middle = |v: usize| (v + CELL / 2) as f64 - 0.5;
            let (x, y) = (middle(left), middle(top));
            found.push(Sample {
                x: (x + 0.5) / half - size.width as f64 / (2.0 * half),
                y: (y + 0.5) / half - size.height as f64 / (2.0 * half),
                radius2: frame.radius2(x, y, size.width, size.height),
                picture: index,
                log_light: light.ln(),
            });
        }
    }
    found
}

fn mean_light(
    picture: &Image<[u8; 3]>,
    left: usize,
    top: usize,
    curves: &[[f32; 256]; 3],
) -> Option<f64> {
    let mut sum = 0.0;
    for y in top..top + CELL {
        for codes in &picture.row(y)[left..left + CELL] {
            if codes.iter().any(|c| !(4..=250).contains(c)) {
                return None;
            }
            sum += (0..3).map(|c| f64::from(curves[c][usize::from(codes[c])])).sum::<f64>();
        }
    }
    Some(sum).filter(|s| *s > 0.0)
}

/// Three coefficients of the fall-off, then level and gradient of each picture.
fn row(sample: &Sample, pictures: usize) -> DVector<f64> {
    let mut row = DVector::zeros(3 + 3 * pictures);
    let r2 = sample.radius2;
    let own = 3 + 3 * sample.picture;
    (row[0], row[1], row[2]) = (r2, r2 * r2, r2 * r2 * r2);
    (row[own], row[own + 1], row[own + 2]) = (1.0, sample.x, sample.y);
    row
}

fn residual(sample: &Sample, solution: &DVector<f64>) -> f64 {
    let pictures = (solution.len() - 3) / 3;
    sample.log_light - row(sample, pictures).dot(solution)
}

/// Least squares with Huber's weights: dust and the shadow of a screw must not bend the lens.
fn robust_fit(samples: &[Sample], pictures: usize) -> Result<DVector<f64>, CalibrateError> {
    let unknowns = 3 + 3 * pictures;
    let mut weights = vec![1.0; samples.len()];
    let mut solution = DVector::zeros(unknowns);
    for _ in 0..8 {
        let mut matrix = DMatrix::zeros(unknowns, unknowns);
        let mut right = DVector::zeros(unknowns);
        for (sample, &weight) in samples.iter().zip(&weights) {
            let row = row(sample, pictures);
            matrix.ger(weight, &row, &row, 1.0);
            right.axpy(weight * sample.log_light, &row, 1.0);
        }
        let problem = "the pictures do not determine the fall-off";
        let factor = matrix.cholesky().ok_or(CalibrateError::Data(problem.into()))?;
        solution = factor.solve(&right);
        let mut sizes: Vec<f64> = samples.iter().map(|s| residual(s, &solution).abs()).collect();
        let limit = {
            let mut sorted = sizes.clone();
            sorted.sort_by(f64::total_cmp);
            // 1.48 times the median is one sigma of a normal distribution
            (2.0 * 1.4826 * sorted[sorted.len() / 2]).max(1e-9)
        };
        for (weight, size) in weights.iter_mut().zip(&mut sizes) {
            *weight = if *size <= limit { 1.0 } else { limit / *size };
        }
    }
    Ok(solution)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::color::srgb8_from_linear;
    use crate::math::random::Rng;

    #[test]
    fn the_fall_off_is_found_under_noise_a_gradient_and_dust() {
        let size = Size::new(323, 241);
        let truth = Vignetting { center: [0.5, 0.5], falloff: [-0.55, -0.12, 0.08] };
        let mut rng = Rng::new(&[7]);
        let pictures: Vec<_> = [0.55, 0.3]
            .iter()
            .map(|level| {
                let mut picture = Image::new(size, [0u8; 3]);
                for (x, y) in (0..size.pixels()).map(|i| (i % size.width, i / size.width)) {
                    let r2 = truth.radius2(x as f64, y as f64, size.width, size.height);
                    let lamp = level * (1e-3 * x as f64 - 4e-4 * y as f64).exp();
                    let dust = if x / 12 == 9 && y / 12 == 4 { 0.6 } else { 1.0 };
                    let light = lamp * truth.share(r2) * dust;
                    let mut noisy = || light * (1.0 + 0.02 * f64::from(rng.normal()));
                    picture.row_mut(y)[x] =
                        [noisy(), noisy(), noisy()].map(|v| srgb8_from_linear(v as f32));
                }
                FlatField { name: format!("{level}.png"), picture }
            })
            .collect();
        let found = find_vignetting(&pictures, &Photometry::default(), [0.5; 2]).unwrap();
        let worst = (0..=100)
            .map(|i| f64::from(i) / 100.0)
            .map(|r2| (found.vignetting.share(r2) / truth.share(r2) - 1.0).abs())
            .fold(0.0, f64::max);
        println!("worst relative error of the fall-off {worst:.5}, rms {:.5}", found.rms);
        // 2 % of noise over the 768 values of a cell are 7e-4; six unknowns of a picture's 300 cells leave
        // at the rim, where they are loosest, a third of that. Four standard deviations.
        assert!(worst < 1e-3, "{worst} {:?}", found.vignetting);
        let rim = truth.share(truth.radius2(0.0, 0.0, size.width, size.height));
        assert!((found.corner / rim - 1.0).abs() < 1e-3, "{} {rim}", found.corner);
    }

    #[test]
    fn a_saturated_field_is_refused() {
        let flat = |name: &str, size: Size, code: u8| FlatField {
            name: name.into(),
            picture: Image::new(size, [code; 3]),
        };
        let size = Size::new(320, 240);
        let refusal = |fields: &[FlatField]| {
            find_vignetting(fields, &Photometry::default(), [0.5; 2]).unwrap_err().to_string()
        };
        let white = refusal(&[flat("grey.png", size, 128), flat("white.png", size, 255)]);
        assert!(white.contains("white.png") && white.contains("saturated"), "{white}");
        let sizes = refusal(&[flat("a.png", size, 128), flat("b.png", Size::new(64, 48), 128)]);
        assert!(
            sizes.contains("a.png has 320x240") && sizes.contains("b.png has 64x48"),
            "{sizes}"
        );
        assert!(refusal(&[]).contains("no pictures"));
    }
}
