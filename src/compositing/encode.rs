//! Linear light to display codes.

use crate::math::color::{linear_from_srgb, srgb8_from_linear};
use std::sync::LazyLock;

/// Buckets over [0, 1]. The steepest part of the curve changes code every 1 / (12.92 * 255) =
/// 3.0e-4, so a bucket of 2.4e-4 holds at most one change.
const BUCKETS: usize = 4096;

/// Exact sRGB encoding by table: the code at a bucket's start, and where the next code begins.
#[derive(Debug)]
pub struct SrgbEncoder {
    code: [u8; BUCKETS + 1],
    begins: [f32; 257],
}

pub static SRGB: LazyLock<SrgbEncoder> = LazyLock::new(|| SrgbEncoder {
    code: std::array::from_fn(|k| srgb8_from_linear(k as f32 / BUCKETS as f32)),
    begins: std::array::from_fn(|c| match c {
        256 => f32::INFINITY,
        _ => linear_from_srgb((c as f32 - 0.5) / 255.0),
    }),
});

impl SrgbEncoder {
    /// The codes at the buckets' starts, then where each of the 256 codes begins and one number that no
    /// light reaches.
    #[cfg(feature = "gpu")]
    pub fn tables(&self) -> (&[u8], [f32; 257]) {
        (&self.code, self.begins.map(|light| light.min(f32::MAX)))
    }

    /// The nearest code; values outside [0, 1] are clamped, NaN gives 0.
    #[inline(always)]
    pub fn encode(&self, linear: f32) -> u8 {
        // max turns NaN into 0
        let linear = linear.max(0.0).clamp(0.0, 1.0);
        let code = self.code[(linear * BUCKETS as f32) as usize];
        code + u8::from(linear >= self.begins[usize::from(code) + 1])
    }
}

/// Linear up to here, compressed towards 1 above.
pub const SHOULDER: f32 = 0.8;

/// Keeps virtual pixels that are brighter than white from being cut off: linear below
/// [`SHOULDER`], then x / (1 + x) (Reinhard et al. 2002), with a continuous slope. The colour's
/// channels keep their proportions.
#[inline(always)]
pub fn soften(rgb: [f32; 3]) -> [f32; 3] {
    let brightest = rgb[0].max(rgb[1]).max(rgb[2]);
    if brightest > SHOULDER {
        let room = 1.0 - SHOULDER;
        let above = (brightest - SHOULDER) / room;
        // x / (1 + x), in the form that stays finite for any x
        let scale = (SHOULDER + room * (1.0 - 1.0 / (1.0 + above))) / brightest;
        rgb.map(|v| v * scale)
    } else {
        rgb
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::color::LINEAR_FROM_SRGB8;

    #[test]
    fn every_code_survives_the_round_trip() {
        for code in 0..=255u8 {
            assert_eq!(SRGB.encode(LINEAR_FROM_SRGB8[usize::from(code)]), code);
        }
    }

    #[test]
    fn encoding_is_within_half_a_step() {
        let n = 1_000_000;
        for k in 0..=n {
            let linear = k as f32 / n as f32;
            let exact = 255.0 * crate::math::color::srgb_from_linear(linear);
            let error = (f32::from(SRGB.encode(linear)) - exact).abs();
            // half a step, and f32 rounding of values up to 255
            assert!(error <= 0.5 + 1e-4, "{linear}: {error}");
        }
    }

    #[test]
    fn values_outside_the_range() {
        for (linear, code) in
            [(-1.0, 0), (7.0, 255), (f32::INFINITY, 255), (f32::NEG_INFINITY, 0), (f32::NAN, 0)]
        {
            assert_eq!(SRGB.encode(linear), code, "{linear}");
        }
    }

    #[test]
    fn shoulder_is_linear_below_and_never_reaches_white() {
        assert_eq!(soften([0.1, 0.8, 0.3]), [0.1, 0.8, 0.3]);
        let mut last = 0.8;
        for k in 1..100 {
            let [x, half, _] = soften([0.8 + 0.1 * k as f32, 0.4 + 0.05 * k as f32, 0.0]);
            assert!(x > last && x < 1.0);
            assert!((half / x - 0.5).abs() < 1e-6);
            last = x;
        }
        assert!((soften([f32::MAX, 0.0, 0.0])[0] - 1.0).abs() < 1e-6);
        // the slope just above the knee is 1
        assert!((soften([0.801; 3])[0] - 0.801).abs() < 1e-5);
    }
}
