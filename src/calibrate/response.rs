//! The response curve of a camera from pictures of one view at several exposures.
//!
//! Debevec and Malik 1997, equation 3: `g(Z_ij) = ln E_i + ln t_j` with a smooth `g`, in the least squares
//! sense. The radiances `ln E_i` are eliminated pixel by pixel, which leaves 256 unknowns for any
//! number of pixels, so that no handful of them has to be picked.

use super::CalibrateError;
use crate::capture::calibration::Response;
use crate::image::{Image, Size};
use nalgebra::{DMatrix, DVector};

const CODES: usize = 256;

/// One picture of the stack.
#[derive(Clone, Debug)]
pub struct Exposure {
    pub picture: Image<[u8; 3]>,
    /// Of any unit, as long as all share it.
    pub time: f64,
}

#[derive(Clone, Debug)]
pub struct ResponseOptions {
    /// Weight of the curve's second differences, in terms of the mean weight of a code.
    pub smoothness: f64,
    /// Pixels along each side that are not used.
    pub border: usize,
    /// Pixels that are used of each channel, at most.
    pub pixels: usize,
}

impl Default for ResponseOptions {
    fn default() -> Self {
        // Stops a factor apart leave free what repeats at that factor: a weak weight lets it in.
        Self { smoothness: 100.0, border: 0, pixels: 40_000 }
    }
}

/// What was found.
#[derive(Clone, Debug)]
pub struct FoundResponse {
    pub response: Response,
    /// Pixels used, of each channel.
    pub pixels: [usize; 3],
    /// RMS of `g(Z) - ln E - ln t` over weighted samples: relative error of a single exposure.
    pub rms_log: [f64; 3],
    /// Lowest and highest code that carried weight.
    pub codes: [(u8, u8); 3],
}

/// The response of each channel, with 1 at the upper end: white stays white, and the colour matrix or
/// the white balance is left to say more.
pub fn find_response(
    stack: &[Exposure],
    options: &ResponseOptions,
) -> Result<FoundResponse, CalibrateError> {
    check(stack)?;
    let places = places(stack[0].picture.size(), options)?;
    let mut found: Vec<Channel> = Vec::with_capacity(3);
    for channel in 0..3 {
        found.push(solve(stack, &places, channel, options.smoothness)?);
    }
    let curve = |c: usize| found[c].curve.clone();
    Ok(FoundResponse {
        response: Response { red: curve(0), green: curve(1), blue: curve(2) },
        pixels: std::array::from_fn(|c| found[c].pixels),
        rms_log: std::array::from_fn(|c| found[c].rms_log),
        codes: std::array::from_fn(|c| found[c].codes),
    })
}

fn check(stack: &[Exposure]) -> Result<(), CalibrateError> {
    let first = stack.first().map(|e| e.picture.size());
    let size = first.ok_or(CalibrateError::Options("no exposures".into()))?;
    if stack.iter().any(|e| e.picture.size() != size) {
        return Err(CalibrateError::Options("exposures differ in size".into()));
    }
    if stack.iter().any(|e| !(e.time > 0.0 && e.time.is_finite())) {
        return Err(CalibrateError::Options("an exposure time is not positive".into()));
    }
    let times = || stack.iter().map(|e| e.time);
    let (low, high) = (times().fold(f64::INFINITY, f64::min), times().fold(0.0, f64::max));
    if high < 1.5 * low {
        let problem = "exposure times must differ, by a factor of 1.5 at least";
        return Err(CalibrateError::Options(problem.into()));
    }
    Ok(())
}

/// A regular grid over the picture without its border.
fn places(size: Size, options: &ResponseOptions) -> Result<Vec<usize>, CalibrateError> {
    let inner = |side: usize| side.saturating_sub(2 * options.border);
    let (width, height) = (inner(size.width), inner(size.height));
    if width * height < 1000 {
        let problem = format!("{width}x{height} pixels inside the border are too few");
        return Err(CalibrateError::Options(problem));
    }
    let step = ((width * height) as f64 / options.pixels.max(1000) as f64).sqrt().ceil() as usize;
    let line = |side: usize| (0..side).step_by(step.max(1)).map(|v| v + options.border);
    Ok(line(height).flat_map(|y| line(width).map(move |x| y * size.width + x)).collect())
}

/// Debevec and Malik's hat, zero at both ends: codes there mean "at most" and "at least".
fn weight(code: u8) -> f64 {
    f64::from(code.min(255 - code)) / 127.0
}

struct Channel {
    curve: Vec<f64>,
    pixels: usize,
    rms_log: f64,
    codes: (u8, u8),
}

fn solve(
    stack: &[Exposure],
    places: &[usize],
    channel: usize,
    smoothness: f64,
) -> Result<Channel, CalibrateError> {
    let mut order: Vec<&Exposure> = stack.iter().collect();
    order.sort_by(|a, b| a.time.total_cmp(&b.time));
    let log_times: Vec<f64> = order.iter().map(|e| e.time.ln()).collect();
    let samples: Vec<Vec<u8>> = places
        .iter()
        .map(|&i| order.iter().map(|e| e.picture.as_slice()[i][channel]).collect())
        .filter(|codes: &Vec<u8>| is_still(codes))
        .collect();
    let (mut matrix, right, total) = data_equations(&samples, &log_times);
    if samples.len() < 100 || total <= 0.0 {
        let problem = "too few pixels change with the exposure time as light does";
        return Err(CalibrateError::Data(problem.into()));
    }
    add_smoothness(&mut matrix, smoothness * total / CODES as f64);
    // The curve's height is free (light has no unit here): g(128) = 0.
    matrix[(128, 128)] += total;
    let solved = matrix.cholesky().map(|c| c.solve(&right));
    let log_light = solved.ok_or(CalibrateError::Data("the response is not determined".into()))?;
    let rms_log = residual(&samples, &log_times, &log_light);
    let weighted = || samples.iter().flatten().copied().filter(|&c| weight(c) > 0.0);
    let codes = (weighted().min().unwrap_or(0), weighted().max().unwrap_or(255));
    Ok(Channel { curve: rising(&log_light), pixels: samples.len(), rms_log, codes })
}

/// More light for longer gives no lower code, but for noise: otherwise something moved.
fn is_still(codes: &[u8]) -> bool {
    const NOISE: u8 = 8;
    codes.windows(2).all(|w| w[1] >= w[0].saturating_sub(NOISE))
        && codes.iter().filter(|&&c| weight(c) > 0.0).count() >= 2
}

/// Normal equations of the 256 values of g with every ln E at its best, and the sum of weights.
fn data_equations(samples: &[Vec<u8>], log_times: &[f64]) -> (DMatrix<f64>, DVector<f64>, f64) {
    let mut matrix = DMatrix::zeros(CODES, CODES);
    let mut right = DVector::zeros(CODES);
    let mut total = 0.0;
    for codes in samples {
        let w: Vec<f64> = codes.iter().map(|&c| weight(c).powi(2)).collect();
        let sum: f64 = w.iter().sum();
        let mean_time = w.iter().zip(log_times).map(|(w, t)| w * t).sum::<f64>() / sum;
        total += sum;
        for (j, &code) in codes.iter().enumerate() {
            let z = usize::from(code);
            matrix[(z, z)] += w[j];
            right[z] += w[j] * (log_times[j] - mean_time);
            for (k, &other) in codes.iter().enumerate() {
                matrix[(z, usize::from(other))] -= w[j] * w[k] / sum;
            }
        }
    }
    (matrix, right, total)
}

fn add_smoothness(matrix: &mut DMatrix<f64>, strength: f64) {
    for z in 1..CODES - 1 {
        let share = strength * weight(z as u8).powi(2);
        for (i, a) in [1.0, -2.0, 1.0].into_iter().enumerate() {
            for (j, b) in [1.0, -2.0, 1.0].into_iter().enumerate() {
                matrix[(z - 1 + i, z - 1 + j)] += share * a * b;
            }
        }
    }
}

fn residual(samples: &[Vec<u8>], log_times: &[f64], log_light: &DVector<f64>) -> f64 {
    let (mut square, mut total) = (0.0, 0.0);
    for codes in samples {
        let each = || {
            codes
                .iter()
                .zip(log_times)
                .map(|(&c, t)| (weight(c).powi(2), log_light[usize::from(c)] - t))
        };
        let (sum, mean) = each().fold((0.0, 0.0), |(s, m), (w, v)| (s + w, m + w * v));
        let mean = mean / sum;
        square += each().map(|(w, v)| w * (v - mean).powi(2)).sum::<f64>();
        total += sum;
    }
    (square / total).sqrt()
}

/// Light from its logarithm, 1 at the upper end. Where noise bends the curve down, it stays level.
fn rising(log_light: &DVector<f64>) -> Vec<f64> {
    let mut top = f64::NEG_INFINITY;
    let level: Vec<f64> = log_light
        .iter()
        .map(|&v| {
            top = top.max(v);
            top
        })
        .collect();
    level.iter().map(|v| (v - top).exp()).collect()
}

/// Relative radiance of each pixel from the whole stack (Debevec and Malik 1997, equation 6); where all
/// exposures are at an end of the curve, what the exposure nearest to it says.
pub fn merge(stack: &[Exposure], response: &Response) -> Result<Image<[f32; 3]>, CalibrateError> {
    check(stack)?;
    let curves = response.channels();
    let size = stack[0].picture.size();
    let radiance = |i: usize, channel: usize| {
        let (mut sum, mut total) = (0.0, 0.0);
        let mut end = (f64::INFINITY, 0.0);
        for exposure in stack {
            let code = exposure.picture.as_slice()[i][channel];
            let light = curves[channel].get(usize::from(code)).copied().unwrap_or(1.0);
            if weight(code) > 0.0 && light > 0.0 {
                sum += weight(code) * (light / exposure.time).ln();
                total += weight(code);
            }
            // Of "at least" the largest bound, of "at most" the smallest.
            let key = if code == 255 { exposure.time } else { 1.0 / exposure.time };
            if key < end.0 {
                end = (key, light / exposure.time);
            }
        }
        if total > 0.0 { (sum / total).exp() as f32 } else { end.1 as f32 }
    };
    let pixels =
        (0..size.pixels()).map(|i| std::array::from_fn(|channel| radiance(i, channel))).collect();
    Ok(Image::from_vec(size, pixels))
}

#[cfg(test)]
mod tests;
