//! The response curve of a camera from pictures of one view at several exposures.
//!
//! Debevec and Malik 1997, equation 3: `g(Z_ij) = ln E_i + ln t_j` with a smooth `g`, solved with errors in
//! the codes `Z_ij` (see `fit`). The radiances `ln E_i` are eliminated pixel by pixel, which leaves 256
//! unknowns for any number of pixels, so that no handful of them has to be picked.

mod fit;
mod merge;
mod stack;

pub use merge::merge;

use super::CalibrateError;
use crate::capture::calibration::Response;
use crate::image::{Image, Size};

const CODES: usize = 256;

/// One picture of the stack.
#[derive(Clone, Debug)]
pub struct Exposure {
    /// What messages call it.
    pub name: String,
    pub picture: Image<[u8; 3]>,
    /// Of any unit, as long as all share it.
    pub time: f64,
}

#[derive(Clone, Debug)]
pub struct ResponseOptions {
    /// Weight of the change of the curve's curvature from code to code, in terms of the mean weight of a
    /// code: it smooths over some three codes (the sixth root of it).
    pub smoothness: f64,
    /// Pixels along each side that are not used.
    pub border: usize,
    /// Pixels that are used of each channel, at most.
    pub pixels: usize,
}

impl Default for ResponseOptions {
    fn default() -> Self {
        // Stops a factor apart leave free what repeats at that factor: a weak weight lets it in.
        Self { smoothness: 1e3, border: 0, pixels: 40_000 }
    }
}

/// What was found.
#[derive(Clone, Debug)]
pub struct FoundResponse {
    pub response: Response,
    /// Pixels used, of each channel.
    pub pixels: [usize; 3],
    /// Standard deviation of a code, of each channel.
    pub noise_codes: [f64; 3],
    /// RMS of `g(Z) - ln E - ln t` over weighted samples: relative error of a single exposure.
    pub rms_log: [f64; 3],
    /// First and last code of each stretch that no picture determines, of each channel: there the curve
    /// only continues what it is beside.
    pub continued: [Vec<(u8, u8)>; 3],
}

/// The response of each channel, with 1 at the upper end: white stays white, and the colour matrix or
/// the white balance is left to say more.
pub fn find_response(
    stack: &[Exposure],
    options: &ResponseOptions,
) -> Result<FoundResponse, CalibrateError> {
    stack::check(stack)?;
    let places = places(stack[0].picture.size(), options)?;
    let mut order: Vec<&Exposure> = stack.iter().collect();
    order.sort_by(|a, b| a.time.total_cmp(&b.time));
    stack::check_order(&order, &places)?;
    let mut found: Vec<(Channel, f64)> = Vec::with_capacity(3);
    for channel in 0..3 {
        found.push(solve(&order, &places, channel, options.smoothness)?);
    }
    let curve = |c: usize| found[c].0.curve.clone();
    Ok(FoundResponse {
        response: Response { red: curve(0), green: curve(1), blue: curve(2) },
        pixels: std::array::from_fn(|c| found[c].0.pixels),
        noise_codes: std::array::from_fn(|c| found[c].0.noise),
        rms_log: std::array::from_fn(|c| found[c].1),
        continued: std::array::from_fn(|c| stretches(&found[c].0.held)),
    })
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
fn hat(code: u8) -> f64 {
    f64::from(code.min(255 - code)) / 127.0
}

/// The curve of one channel, its largest light 1.
struct Channel {
    curve: Vec<f64>,
    pixels: usize,
    noise: f64,
    /// Which codes the pictures determine.
    held: Vec<bool>,
}

fn solve(
    order: &[&Exposure],
    places: &[usize],
    channel: usize,
    smoothness: f64,
) -> Result<(Channel, f64), CalibrateError> {
    let log_times: Vec<f64> = order.iter().map(|e| e.time.ln()).collect();
    let samples: Vec<Vec<u8>> = places
        .iter()
        .map(|&i| order.iter().map(|e| e.picture.as_slice()[i][channel]).collect())
        .filter(|codes: &Vec<u8>| is_still(codes))
        .collect();
    if samples.len() < 100 {
        let channel = ["red", "green", "blue"][channel];
        let problem = format!(
            "{channel}: {} pixels change with the exposure time as light does: too few",
            samples.len()
        );
        return Err(CalibrateError::Data(problem));
    }
    let found = fit::fit(&samples, &log_times, smoothness)?;
    let rms_log = residual(&samples, &log_times, &found.curve);
    Ok((found, rms_log))
}

/// More light for longer gives no lower code, but for noise: otherwise something moved.
fn is_still(codes: &[u8]) -> bool {
    codes.windows(2).all(|w| w[1] >= w[0].saturating_sub(stack::NOISE))
        && codes.iter().filter(|&&c| hat(c) > 0.0).count() >= 2
}

fn residual(samples: &[Vec<u8>], log_times: &[f64], curve: &[f64]) -> f64 {
    let (mut square, mut total) = (0.0, 0.0);
    for codes in samples {
        let each = || {
            let log_light = |c: u8| curve[usize::from(c)].max(f64::MIN_POSITIVE).ln();
            codes.iter().zip(log_times).map(move |(&c, t)| (hat(c).powi(2), log_light(c) - t))
        };
        let (sum, mean) = each().fold((0.0, 0.0), |(s, m), (w, v)| (s + w, m + w * v));
        let mean = mean / sum;
        square += each().map(|(w, v)| w * (v - mean).powi(2)).sum::<f64>();
        total += sum;
    }
    (square / total).sqrt()
}

/// First and last code of each stretch that is not held.
fn stretches(held: &[bool]) -> Vec<(u8, u8)> {
    let mut found: Vec<(u8, u8)> = Vec::new();
    for code in (0..=255u8).filter(|&c| !held[usize::from(c)]) {
        match found.last_mut() {
            Some(last) if last.1 + 1 == code => last.1 = code,
            _ => found.push((code, code)),
        }
    }
    found
}

#[cfg(test)]
mod tests;
