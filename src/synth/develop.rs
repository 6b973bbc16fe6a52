//! From radiance to the picture that a camera gives.

use crate::image::Image;
use crate::math::color::srgb8_from_linear;
use crate::math::random::Rng;
use rayon::prelude::*;

/// Variance of linear light at a value v is `SHOT * v + READ * READ` (Foi et al. 2008): 4000 electrons
/// at full scale, and a dark noise of 0.2 %. It makes about 1.5 of 255 steps in the mid tones.
const SHOT: f32 = 1.0 / 4000.0;
const READ: f32 = 0.002;

/// Exposed, with sensor noise where `noise` seeds it (sequence, frame), and encoded as 8-bit sRGB.
pub fn developed(
    radiance: &Image<[f32; 3]>,
    exposure: f32,
    noise: Option<[u32; 2]>,
) -> Image<[u8; 3]> {
    let mut out = Image::new(radiance.size(), [0; 3]);
    out.par_rows_mut().for_each(|(y, row)| {
        for (x, (pixel, rgb)) in row.iter_mut().zip(radiance.row(y)).enumerate() {
            let exposed = rgb.map(|v| v * exposure);
            let sensed = match noise {
                None => exposed,
                Some([seed, frame]) => {
                    let mut rng = Rng::new(&[seed, frame, 0xc0, y as u32, x as u32]);
                    exposed.map(|v| v + rng.normal() * (SHOT * v + READ * READ).sqrt())
                }
            };
            *pixel = sensed.map(srgb8_from_linear);
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Size;
    use crate::math::color::LINEAR_FROM_SRGB8;

    #[test]
    fn noise_is_unbiased_and_as_large_as_documented() {
        let size = Size::new(160, 120);
        for value in [0.1f32, 0.25, 0.6] {
            let flat = Image::new(size, [value; 3]);
            let noisy = developed(&flat, 1.0, Some([3, 5]));
            let linear: Vec<f64> = noisy
                .as_slice()
                .iter()
                .flatten()
                .map(|&v| f64::from(LINEAR_FROM_SRGB8[v as usize]))
                .collect();
            let n = linear.len() as f64;
            let mean = linear.iter().sum::<f64>() / n;
            let sigma = (linear.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
            let expected = f64::from(SHOT * value + READ * READ).sqrt();
            // 57600 values: a standard error of 0.3 %; encoding adds a twelfth of a step squared
            assert!((0.98..1.06).contains(&(sigma / expected)), "{value}: {sigma} {expected}");
            assert!((mean - f64::from(value)).abs() < 0.1 * expected, "{mean}");
        }
    }

    #[test]
    fn frames_differ_by_their_noise_and_are_repeated_exactly() {
        let flat = Image::new(Size::new(16, 9), [0.3; 3]);
        let picture = |frame| developed(&flat, 1.0, Some([1, frame]));
        assert_eq!(picture(4), picture(4));
        assert_ne!(picture(4), picture(5));
        let clean = developed(&flat, 0.5, None);
        assert!(clean.as_slice().iter().all(|p| *p == [srgb8_from_linear(0.15); 3]));
    }
}
