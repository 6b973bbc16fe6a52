//! Radiance from a stack of exposures whose response is known.

use super::{Exposure, hat, stack};
use crate::calibrate::CalibrateError;
use crate::capture::calibration::Response;
use crate::image::Image;

/// Relative radiance of each pixel from the whole stack (Debevec and Malik 1997, equation 6); where all
/// exposures are at an end of the curve, what the exposure nearest to it says.
pub fn merge(stack: &[Exposure], response: &Response) -> Result<Image<[f32; 3]>, CalibrateError> {
    stack::check(stack)?;
    let curves = response.channels();
    let size = stack[0].picture.size();
    let radiance = |i: usize, channel: usize| {
        let (mut sum, mut total) = (0.0, 0.0);
        let mut end = (f64::INFINITY, 0.0);
        for exposure in stack {
            let code = exposure.picture.as_slice()[i][channel];
            let light = curves[channel].get(usize::from(code)).copied().unwrap_or(1.0);
            if hat(code) > 0.0 && light > 0.0 {
                sum += hat(code) * (light / exposure.time).ln();
                total += hat(code);
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
