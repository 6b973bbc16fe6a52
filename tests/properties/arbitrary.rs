//! Random input, and what tests make of it.

use glam::{DQuat, DVec3, Vec3};
use kinlight::math::sh;
use proptest::prelude::*;
use std::f64::consts::PI;

pub fn direction() -> impl Strategy<Value = DVec3> {
    let part = || -1.0..1.0f64;
    (part(), part(), part())
        .prop_map(DVec3::from)
        .prop_filter("a direction", |v| v.length() > 1e-2 && v.length() < 1.0)
        .prop_map(DVec3::normalize)
}

pub fn rotation() -> impl Strategy<Value = DQuat> {
    (direction(), 0.0..PI).prop_map(|(axis, angle)| DQuat::from_axis_angle(axis, angle))
}

pub fn coefficients(n: usize) -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(-1.0..1.0f64, n)
}

/// Y of the first bands.
pub fn basis(towards: DVec3, bands: usize) -> Vec<f64> {
    let mut out = [0.0; sh::MAX_COEFFICIENTS];
    sh::basis_f64(towards, bands, &mut out);
    out[..sh::coefficients(bands)].to_vec()
}

pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Directions and weights of a rule that is exact for polynomials of degree 15 on the sphere: Gauss-Legendre in z,
/// even steps around it.
pub fn quadrature() -> Vec<(DVec3, f64)> {
    const NODES: usize = 8;
    const AROUND: usize = 16;
    let mut out = Vec::with_capacity(NODES * AROUND);
    for i in 0..NODES {
        let mut z = (PI * (i as f64 + 0.75) / (NODES as f64 + 0.5)).cos();
        let mut slope = 0.0;
        for _ in 0..20 {
            // P_n and its derivative
            let (mut before, mut value) = (1.0, z);
            for l in 2..=NODES {
                let l = l as f64;
                (before, value) = (value, ((2.0 * l - 1.0) * z * value - (l - 1.0) * before) / l);
            }
            slope = NODES as f64 * (z * value - before) / (z * z - 1.0);
            z -= value / slope;
        }
        let weight = 2.0 / ((1.0 - z * z) * slope * slope);
        for k in 0..AROUND {
            let (sin, cos) = (2.0 * PI * (k as f64 + 0.3) / AROUND as f64).sin_cos();
            let r = (1.0 - z * z).sqrt();
            out.push((DVec3::new(r * cos, r * sin, z), weight * 2.0 * PI / AROUND as f64));
        }
    }
    out
}

/// Coefficients of a function on the sphere; exact where it has `16 - bands` bands at most.
pub fn projected(bands: usize, function: impl Fn(DVec3) -> f64) -> Vec<f64> {
    let mut out = vec![0.0; sh::coefficients(bands)];
    for (w, weight) in quadrature() {
        let value = weight * function(w);
        out.iter_mut().zip(basis(w, bands)).for_each(|(c, y)| *c += value * y);
    }
    out
}

/// Coefficients of a function that is turned.
pub fn rotated(light: &[f64], turn: DQuat) -> Vec<f64> {
    let bands = light.len().isqrt();
    projected(bands, |w| dot(light, &basis(turn.inverse() * w, bands)))
}

pub fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

pub fn vec3(v: DVec3) -> Vec3 {
    v.as_vec3()
}
