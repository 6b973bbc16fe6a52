//! Spherical harmonics. The library evaluates, convolves and reads directions; rotation, products and projection
//! are made of its basis here, so that what is proved of them is proved of the basis.

use crate::arbitrary::*;
use glam::DVec3;
use kinlight::lighting::ShLight;
use kinlight::lighting::exitant::DominantLight;
use kinlight::math::sh::{self, CLAMPED_COSINE, MAX_BANDS};
use proptest::prelude::*;
use std::f64::consts::PI;

/// Rounding of sums of some hundred products of numbers below 5.
const ROUNDING: f64 = 1e-12;

/// P_l(x).
fn legendre(l: usize, x: f64) -> f64 {
    let (mut before, mut value) = (1.0, x);
    if l == 0 {
        return 1.0;
    }
    for k in 2..=l {
        let k = k as f64;
        (before, value) = (value, ((2.0 * k - 1.0) * x * value - (k - 1.0) * before) / k);
    }
    value
}

proptest! {
    /// sum_m Y_lm(a) Y_lm(b) = (2l + 1) / (4 pi) P_l(a.b): no direction is special, in any band.
    #[test]
    fn addition_theorem(a in direction(), b in direction()) {
        let (ya, yb) = (basis(a, MAX_BANDS), basis(b, MAX_BANDS));
        for l in 0..MAX_BANDS {
            let band = l * l..(l + 1) * (l + 1);
            let expected = (2 * l + 1) as f64 / (4.0 * PI) * legendre(l, a.dot(b));
            prop_assert!((dot(&ya[band.clone()], &yb[band]) - expected).abs() < ROUNDING);
        }
    }

    #[test]
    fn band_limited_functions_are_projected_onto_themselves(bands in 1..=MAX_BANDS, seed in coefficients(36)) {
        let light = &seed[..sh::coefficients(bands)];
        let back = projected(bands, |w| dot(light, &basis(w, bands)));
        prop_assert!(largest_difference(light, &back) < ROUNDING);
    }

    /// A turned function has the same power in every band, two turns are their product, and a turn can be taken back.
    #[test]
    fn rotations(light in coefficients(36), a in rotation(), b in rotation()) {
        let once = rotated(&light, a);
        for l in 0..MAX_BANDS {
            let band = l * l..(l + 1) * (l + 1);
            let power = |c: &[f64]| dot(&c[band.clone()], &c[band.clone()]);
            prop_assert!((power(&light) - power(&once)).abs() < 10.0 * ROUNDING);
        }
        prop_assert!(largest_difference(&rotated(&once, b), &rotated(&light, b * a)) < 10.0 * ROUNDING);
        prop_assert!(largest_difference(&rotated(&once, a.inverse()), &light) < 10.0 * ROUNDING);
    }

    /// The product of two functions of three bands has five.
    #[test]
    fn products(a in coefficients(9), b in coefficients(9), w in direction()) {
        let value = |c: &[f64], w: DVec3| dot(c, &basis(w, c.len().isqrt()));
        let product = projected(5, |w| value(&a, w) * value(&b, w));
        prop_assert!((value(&product, w) - value(&a, w) * value(&b, w)).abs() < 10.0 * ROUNDING);
        // the mean of a product is the product of the coefficients
        prop_assert!((product[0] * (4.0 * PI).sqrt() - dot(&a, &b)).abs() < 10.0 * ROUNDING);
    }

    /// Light convolved with a lobe, seen at n: A_l l_lm Y_lm(n). It is symmetric in light and surface, turns with
    /// both, and is bounded by what a lobe passes of the whole light.
    #[test]
    fn convolution_with_the_cosine(n in direction(), w in direction(), turn in rotation(), bands in 1..=MAX_BANDS) {
        let of = |n: DVec3, w: DVec3| {
            let transfer = sh::unoccluded_transfer(vec3(n), bands);
            let y = basis(w, bands);
            (0..y.len()).map(|i| f64::from(transfer[i]) * y[i]).sum::<f64>()
        };
        let expected: f64 = (0..bands)
            .map(|l| CLAMPED_COSINE[l] / PI * (2 * l + 1) as f64 / (4.0 * PI) * legendre(l, n.dot(w)))
            .sum();
        // directions and coefficients in f32: six bands of slopes up to 15
        prop_assert!((of(n, w) - expected).abs() < 2e-6);
        prop_assert!((of(n, w) - of(w, n)).abs() < 4e-6);
        prop_assert!((of(n, w) - of(turn * n, turn * w)).abs() < 4e-6);
    }

    /// Direction and strength of a lamp turn with it, whatever ambient light there is.
    #[test]
    fn the_dominant_light_turns_with_the_light(w in direction(), strength in 0.01..100.0f32, ambient in 0.0..10.0f32, turn in rotation()) {
        let lamp = |w: DVec3| {
            let mut coefficients: Vec<[f32; 3]> =
                basis(w, 4).iter().map(|&y| [strength * y as f32; 3]).collect();
            coefficients[0] = coefficients[0].map(|c| c + ambient);
            DominantLight::of(&ShLight { bands: 4, coefficients }).unwrap()
        };
        let (a, b) = (lamp(w), lamp(turn * w));
        prop_assert!((a.towards_light.as_dvec3() - w).length() < 1e-6);
        prop_assert!((turn * a.towards_light.as_dvec3() - b.towards_light.as_dvec3()).length() < 2e-6);
        prop_assert!((a.irradiance[1] / strength - 1.0).abs() < 1e-6);
    }
}
