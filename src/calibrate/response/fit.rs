//! The curve in least squares of codes.
//!
//! Noise and rounding are errors of codes, not of the logarithm of light: a fit that looks the curve up at
//! the codes as found takes the noise for light, by percents where the curve bends or codes end. So each
//! code is compared with the one that the curve and the pixel's light predict (Gauss-Newton on both). The
//! ends cut noise off: near them the mean of what noise and the ends make of the predicted code is
//! compared, and what is used is chosen by the predicted code, never by the one that noise has touched.

use super::{CODES, Channel, hat};
use crate::calibrate::CalibrateError;
use nalgebra::{DMatrix, DVector};

/// Rounds of Gauss and Newton's method, at most; it ends when no held code moves by a hundredth.
const ROUNDS: usize = 12;
/// A predicted code of which the ends leave less than this share of the noise says nothing.
const LEFT_BY_ENDS: f64 = 0.05;
/// Codes below are as good as black.
const LOWEST: f64 = 2.0;
/// Pixels whose light is known no better than to this share of itself only count where half of them
/// are no better.
const KNOWN_LIGHT: f64 = 0.02;
/// Residuals beyond this many standard deviations count linearly.
const HUBER: f64 = 3.0;
/// Weight of the curve's own curvature beside that of its change: it only rules where no code is held.
const CURVATURE_SHARE: f64 = 1e-3;
/// A code is held where the samples within a code of it fix it to so much of a code, or to this share of
/// its light.
const HELD_CODES: f64 = 0.1;
const HELD_LIGHT: f64 = 0.01;

/// `g(at) - ln E = target`, where `at` may lie between codes.
struct Equation {
    at: f64,
    target: f64,
    weight: f64,
}

/// g of all codes, rising, and its slope smoothed over five codes.
struct Curve {
    log_light: Vec<f64>,
    slope: Vec<f64>,
}

impl Curve {
    fn new(log_light: &DVector<f64>) -> Self {
        let mut top = f64::NEG_INFINITY;
        let rising: Vec<f64> = log_light
            .iter()
            .map(|&v| {
                top = v.max(top + 1e-6);
                top
            })
            .collect();
        let central = |z: usize| {
            let (a, b) = (z.saturating_sub(1), (z + 1).min(CODES - 1));
            (rising[b] - rising[a]) / (b - a) as f64
        };
        let smooth = |z: usize| {
            let near = z.saturating_sub(2)..(z + 3).min(CODES);
            let count = near.len() as f64;
            (near.map(central).sum::<f64>() / count).max(1e-4)
        };
        let slope = (0..CODES).map(smooth).collect();
        Self { log_light: rising, slope }
    }

    /// The code, which need not be whole, of this light; 0 below the ends, as the curve goes on above.
    fn code(&self, log_light: f64) -> f64 {
        let above = self.log_light.partition_point(|&v| v <= log_light);
        if above == 0 {
            return 0.0;
        }
        let below = (above - 1).min(CODES - 2);
        let (low, high) = (self.log_light[below], self.log_light[below + 1]);
        let share = (log_light - low) / (high - low);
        if below == 0 { share } else { below as f64 * (1.0 + 1.0 / below as f64).powf(share) }
    }

    fn slope(&self, code: f64) -> f64 {
        let (below, share) = between(code);
        self.slope[below] + share.min(1.0) * (self.slope[below + 1] - self.slope[below])
    }
}

/// The code below and how far it is to the next, by the logarithm of codes: over it, a power of light is a
/// straight line.
fn between(code: f64) -> (usize, f64) {
    let below = (code as usize).min(CODES - 2);
    if below == 0 {
        return (below, code);
    }
    (below, (code / below as f64).ln() / (1.0 + 1.0 / below as f64).ln())
}

/// Standard deviation of codes, by bands of sixteen: light's own noise grows with it, and scans and
/// compression have their own.
struct Noise([f64; 16]);

impl Noise {
    fn at(&self, code: f64) -> f64 {
        let place = (code / 16.0 - 0.5).clamp(0.0, 15.0);
        let below = (place as usize).min(14);
        self.0[below] + (place - below as f64) * (self.0[below + 1] - self.0[below])
    }

    fn median(&self) -> f64 {
        let mut sorted = self.0;
        sorted.sort_by(f64::total_cmp);
        sorted[8]
    }
}

/// Light of a pixel and what each of its codes says of the curve.
struct Pixel<'a> {
    codes: &'a [u8],
    log_light: f64,
}

/// The curve of pixels that saw still light, `log_times` being those of their codes.
pub(super) fn fit(
    samples: &[Vec<u8>],
    log_times: &[f64],
    smoothness: f64,
) -> Result<Channel, CalibrateError> {
    let undetermined = || CalibrateError::Data("the response is not determined".into());
    let mut log_light = start(samples, log_times).ok_or_else(undetermined)?;
    let curve = Curve::new(&log_light);
    let mut pixels: Vec<Pixel> =
        samples.iter().filter_map(|codes| first_light(&curve, codes, log_times)).collect();
    let mut noise = Noise([1.0; 16]);
    let mut used = Vec::new();
    for _ in 0..ROUNDS {
        let curve = Curve::new(&log_light);
        for pixel in &mut pixels {
            for _ in 0..2 {
                step_light(&curve, pixel, log_times, &noise);
            }
        }
        used = known(&curve, &pixels, log_times, &noise);
        noise = noise_of(&curve, &used, log_times, &noise).ok_or_else(undetermined)?;
        let of_pixel = |pixel: &&Pixel| equations(&curve, pixel, log_times, &noise);
        let (mut matrix, right, total) = normal_equations(used.iter().map(of_pixel));
        let count: f64 =
            used.iter().flat_map(of_pixel).map(|e| e.weight * curve.slope(e.at).powi(2)).sum();
        add_smoothness(&mut matrix, &curve, smoothness * count / CODES as f64);
        // The curve's height is free (light has no unit here): g(128) = 0.
        matrix[(128, 128)] += total;
        let solved = matrix.cholesky().map(|c| c.solve(&right)).ok_or_else(undetermined)?;
        let held = held(&curve, &used, log_times, &noise);
        let moved = (0..CODES)
            .filter(|&z| held[z])
            .map(|z| (solved[z] - log_light[z]).abs() / curve.slope[z])
            .fold(0.0, f64::max);
        log_light = solved;
        if moved < 0.01 {
            break;
        }
    }
    let curve = Curve::new(&log_light);
    let top = curve.log_light[CODES - 1];
    Ok(Channel {
        pixels: used.len(),
        noise: noise.median(),
        held: held(&curve, &used, log_times, &noise),
        curve: curve.log_light.iter().map(|v| (v - top).exp()).collect(),
    })
}

/// Debevec and Malik's solution: the curve at the codes as found.
fn start(samples: &[Vec<u8>], log_times: &[f64]) -> Option<DVector<f64>> {
    let of_pixel = |codes: &Vec<u8>| -> Vec<Equation> {
        let each = codes.iter().zip(log_times).map(|(&code, &target)| Equation {
            at: f64::from(code),
            target,
            weight: hat(code).powi(2),
        });
        each.filter(|e| e.weight > 0.0).collect()
    };
    let (mut matrix, right, total) = normal_equations(samples.iter().map(of_pixel));
    for z in 1..CODES - 1 {
        let share = 100.0 * total / CODES as f64 * hat(z as u8).powi(2);
        add_square(&mut matrix, share, z - 1, &[1.0, -2.0, 1.0]);
    }
    matrix[(128, 128)] += total;
    Some(matrix.cholesky()?.solve(&right))
}

/// Light from the codes as found, those near the ends left out.
fn first_light<'a>(curve: &Curve, codes: &'a [u8], log_times: &[f64]) -> Option<Pixel<'a>> {
    let (mut sum, mut total) = (0.0, 0.0);
    for (&code, time) in codes.iter().zip(log_times).filter(|c| (4..=250).contains(c.0)) {
        let weight = curve.slope[usize::from(code)].powi(-2);
        sum += weight * (curve.log_light[usize::from(code)] - time);
        total += weight;
    }
    (total > 0.0).then(|| Pixel { codes, log_light: sum / total })
}

/// One code of a pixel beside what is predicted of it.
struct Prediction {
    /// Found less expected.
    off: f64,
    /// Before noise and ends; may lie above 255.
    code: f64,
    /// How far the expected code moves with the predicted one: 1 clear of the ends.
    gain: f64,
    /// Of a code, by noise.
    deviation: f64,
    /// Of the curve.
    slope: f64,
    log_time: f64,
}

impl Prediction {
    /// What it knows of the logarithm of light: one over its variance.
    fn information(&self) -> f64 {
        (self.gain / (self.slope * self.deviation)).powi(2)
    }
}

/// The predictions that say something.
fn predictions<'a>(
    curve: &'a Curve,
    pixel: &'a Pixel,
    log_times: &'a [f64],
    noise: &'a Noise,
) -> impl Iterator<Item = Prediction> + 'a {
    pixel.codes.iter().zip(log_times).filter_map(move |(&found, &log_time)| {
        let code = curve.code(pixel.log_light + log_time);
        let deviation = noise.at(code);
        let (expected, gain) = cut_off(code, deviation);
        (code >= LOWEST && gain > LEFT_BY_ENDS).then(|| Prediction {
            off: f64::from(found) - expected,
            code,
            gain,
            deviation,
            slope: curve.slope(code),
            log_time,
        })
    })
}

/// The mean of a code with normal noise that 0 and 255 cut off, and its derivative.
fn cut_off(code: f64, noise: f64) -> (f64, f64) {
    let (low, high) = (-code / noise, (255.0 - code) / noise);
    let density = |x: f64| (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
    let gain = below(high) - below(low);
    let mean = code * gain + noise * (density(low) - density(high)) + 255.0 * (1.0 - below(high));
    (mean, gain)
}

/// Share of a normal distribution below so many standard deviations (Abramowitz and Stegun 26.2.17, to
/// 1e-7).
fn below(deviations: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.231_641_9 * deviations.abs());
    let series = [0.319_381_530, -0.356_563_782, 1.781_477_937, -1.821_255_978, 1.330_274_429];
    let sum = series.iter().rev().fold(0.0, |sum, b| (sum + b) * t);
    let tail = (-0.5 * deviations * deviations).exp() / std::f64::consts::TAU.sqrt() * sum;
    if deviations < 0.0 { tail } else { 1.0 - tail }
}

fn step_light(curve: &Curve, pixel: &mut Pixel, log_times: &[f64], noise: &Noise) {
    let (mut sum, mut total) = (0.0, 0.0);
    for p in predictions(curve, pixel, log_times, noise) {
        sum += p.information() * p.off * p.slope / p.gain;
        total += p.information();
    }
    if total > 0.0 {
        pixel.log_light += sum / total;
    }
}

/// Pixels with two usable codes and well known light.
fn known<'a>(
    curve: &Curve,
    pixels: &'a [Pixel<'a>],
    log_times: &[f64],
    noise: &Noise,
) -> Vec<&'a Pixel<'a>> {
    let deviation = |pixel: &Pixel| {
        let each = predictions(curve, pixel, log_times, noise);
        let (count, sum) = each.fold((0, 0.0), |(n, s), p| (n + 1, s + p.information()));
        (count >= 2).then(|| 1.0 / sum.sqrt())
    };
    let all: Vec<_> = pixels.iter().filter_map(|p| Some((p, deviation(p)?))).collect();
    let mut sorted: Vec<f64> = all.iter().map(|p| p.1).collect();
    sorted.sort_by(f64::total_cmp);
    let limit = sorted.get(sorted.len() / 2).map_or(0.0, |median| median.max(KNOWN_LIGHT));
    all.into_iter().filter(|p| p.1 <= limit).map(|p| p.0).collect()
}

/// Robust standard deviation of codes that the ends leave alone; each pixel's light has taken one degree of
/// freedom. Bands with few codes take that of all.
fn noise_of(curve: &Curve, used: &[&Pixel], log_times: &[f64], noise: &Noise) -> Option<Noise> {
    const ENOUGH: usize = 200;
    let mut sizes: Vec<(usize, f64)> = Vec::new();
    for pixel in used {
        let before = sizes.len();
        let each = predictions(curve, pixel, log_times, noise).filter(|p| p.gain > 0.99);
        sizes.extend(each.map(|p| ((p.code as usize / 16).min(15), p.off.abs())));
        let count = (sizes.len() - before) as f64;
        let scale = (count / (count - 1.0).max(1.0)).sqrt();
        sizes[before..].iter_mut().for_each(|size| size.1 *= scale);
    }
    // 1.48 times the median is one sigma of a normal distribution; rounding alone makes 0.29.
    let deviation = |mut sizes: Vec<f64>| {
        let middle = sizes.len() / 2;
        let (_, median, _) = sizes.select_nth_unstable_by(middle, f64::total_cmp);
        (1.4826 * *median).max(0.29)
    };
    let all = (!sizes.is_empty()).then(|| deviation(sizes.iter().map(|s| s.1).collect()))?;
    let of_band = |band: usize| {
        let own: Vec<f64> = sizes.iter().filter(|s| s.0 == band).map(|s| s.1).collect();
        // Half way by ratio: a band that pixels' lights follow looks quieter than it is.
        if own.len() < ENOUGH { all } else { (all * deviation(own)).sqrt() }
    };
    Some(Noise(std::array::from_fn(of_band)))
}

/// What the codes of a pixel say, linear about the predicted ones.
fn equations(curve: &Curve, pixel: &Pixel, log_times: &[f64], noise: &Noise) -> Vec<Equation> {
    let of_code = |p: Prediction| {
        let robust = (HUBER * p.deviation / p.off.abs().max(1e-9)).min(1.0);
        Equation {
            at: p.code,
            target: p.log_time - p.off * p.slope / p.gain,
            weight: robust * p.information(),
        }
    };
    predictions(curve, pixel, log_times, noise).map(of_code).collect()
}

/// Normal equations of the values of g with the ln E of each pixel at its best, and the sum of weights.
fn normal_equations(
    pixels: impl Iterator<Item = Vec<Equation>>,
) -> (DMatrix<f64>, DVector<f64>, f64) {
    let mut matrix = DMatrix::zeros(CODES, CODES);
    let mut right = DVector::zeros(CODES);
    let mut total = 0.0;
    let mut touched: Vec<(usize, f64)> = Vec::new();
    for equations in pixels {
        let sum: f64 = equations.iter().map(|e| e.weight).sum();
        if sum <= 0.0 {
            continue;
        }
        total += sum;
        let mean = equations.iter().map(|e| e.weight * e.target).sum::<f64>() / sum;
        touched.clear();
        for Equation { at, target, weight } in equations {
            let (below, share) = between(at);
            let nodes = [(below, 1.0 - share), (below + 1, share)];
            for (i, a) in nodes {
                right[i] += weight * a * (target - mean);
                for (j, b) in nodes {
                    matrix[(i, j)] += weight * a * b;
                }
                touched.push((i, weight * a));
            }
        }
        for &(i, a) in &touched {
            for &(j, b) in &touched {
                matrix[(i, j)] -= a * b / sum;
            }
        }
    }
    (matrix, right, total)
}

/// Adds the square of a combination of values of g from `first` on.
fn add_square(matrix: &mut DMatrix<f64>, weight: f64, first: usize, combination: &[f64]) {
    for (i, a) in combination.iter().enumerate() {
        for (j, b) in combination.iter().enumerate() {
            matrix[(first + i, first + j)] += weight * a * b;
        }
    }
}

/// Holds the curvature of g over the logarithm of the code near its neighbours'. A power of light has none
/// at all, a curve with a shoulder one that changes slowly. In codes, so that it weighs the same in
/// shadows as in lights.
fn add_smoothness(matrix: &mut DMatrix<f64>, curve: &Curve, strength: f64) {
    let place = |z: usize| (z as f64 + 0.03).ln();
    let bend = |z: usize| {
        let (before, after) = (place(z) - place(z - 1), place(z + 1) - place(z));
        let scale = 0.5 * (before + after) / curve.slope[z];
        [scale / before, -scale / before - scale / after, scale / after]
    };
    for z in 1..CODES - 1 {
        add_square(matrix, CURVATURE_SHARE * strength, z - 1, &bend(z));
    }
    for z in 1..CODES - 2 {
        let ([a, b, c], [d, e, f]) = (bend(z), bend(z + 1));
        add_square(matrix, strength, z - 1, &[-a, d - b, e - c, f]);
    }
}

/// Which codes the pictures determine.
fn held(curve: &Curve, used: &[&Pixel], log_times: &[f64], noise: &Noise) -> Vec<bool> {
    let mut counts = vec![0usize; CODES];
    for pixel in used {
        for p in predictions(curve, pixel, log_times, noise).filter(|p| p.gain > 0.5) {
            counts[(p.code.round() as usize).min(CODES - 1)] += 1;
        }
    }
    let near = |z: usize| counts[z.saturating_sub(1)..(z + 2).min(CODES)].iter().sum::<usize>();
    let enough = |z: usize| {
        let tolerance = HELD_CODES.max(HELD_LIGHT / curve.slope[z]);
        near(z) as f64 >= (noise.at(z as f64) / tolerance).powi(2)
    };
    // Smoothness alone moves the lowest codes of a curve with a straight toe (sRGB) by a tenth of a code.
    (0..CODES).map(|z| z as f64 >= 3.0 * LOWEST && enough(z)).collect()
}
