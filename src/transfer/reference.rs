//! Ray-traced transfer of single points: slow, and exact but for the number of rays.

use crate::math::sh::{MAX_COEFFICIENTS, basis_f64, coefficients, unoccluded_transfer};
use glam::{DVec3, Vec3};
use std::f64::consts::PI;

/// Transfer (1/pi) integral V(w) max(0, n.w) Y(w) dw of a point, with `hit(origin, direction)` telling
/// whether a ray that starts at the point meets anything. `normal` is of unit length.
///
/// The rays are a Fibonacci lattice on the disc, lifted to the hemisphere, so that their density is
/// cos / pi, and the transfer is the mean of V Y. Only what is hidden is taken from the rays, the rest is
/// analytic: a point that sees no surface is exact for any number of rays.
pub fn traced_transfer(
    hit: impl Fn(Vec3, Vec3) -> bool,
    position: Vec3,
    normal: Vec3,
    bands: usize,
    rays: usize,
) -> [f32; MAX_COEFFICIENTS] {
    let mut hidden = [0.0f64; MAX_COEFFICIENTS];
    let mut y = [0.0; MAX_COEFFICIENTS];
    for k in 0..rays {
        let direction = cosine_direction(normal, k, rays);
        if hit(position, direction) {
            basis_f64(direction.as_dvec3(), bands, &mut y);
            hidden.iter_mut().zip(y).for_each(|(sum, y)| *sum += y / rays as f64);
        }
    }
    let mut out = unoccluded_transfer(normal, bands);
    for k in 0..coefficients(bands) {
        out[k] = (f64::from(out[k]) - hidden[k]) as f32;
    }
    out
}

/// The k-th of n directions with density cos / pi around a unit normal.
fn cosine_direction(normal: Vec3, k: usize, n: usize) -> Vec3 {
    let golden = PI * (3.0 - 5f64.sqrt());
    let squared = (k as f64 + 0.5) / n as f64;
    let (sin, cos) = (golden * k as f64).sin_cos();
    let (x, y) = (squared.sqrt() * cos, squared.sqrt() * sin);
    let normal = normal.as_dvec3().normalize();
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    let direction: DVec3 = tangent * x + bitangent * y + normal * (1.0 - squared).sqrt();
    direction.as_vec3().normalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::sh;

    #[test]
    fn everything_hidden_leaves_nothing() {
        let n = Vec3::new(0.36, -0.48, 0.8);
        let open = traced_transfer(|_, _| false, Vec3::ZERO, n, 6, 10);
        assert_eq!(open, unoccluded_transfer(n, 6));
        let closed = traced_transfer(|_, _| true, Vec3::ZERO, n, 6, 20_000);
        // error of the lattice with 20000 rays on polynomials of degree 5
        assert!(closed.iter().all(|v| v.abs() < 1e-3), "{closed:?}");
    }

    #[test]
    fn half_the_sky_gives_the_closed_form() {
        // Hidden where x > 0, seen from a floor: half of the light, and along x the integral of
        // cos sin^2 over a quarter sphere, -(1/pi) (pi/4)(1/2 * ...) = -4/(3 pi) / 2 in 1/pi cos.
        let t = traced_transfer(|_, d| d.x > 0.0, Vec3::ZERO, Vec3::Z, 2, 100_000);
        let y00 = 0.5 / PI.sqrt();
        assert!((f64::from(t[0]) - 0.5 * y00).abs() < 1e-4);
        // mean of x over the half disc x < 0 of unit radius is -4 / (3 pi), on half of the rays
        let expected = (3.0 / (4.0 * PI)).sqrt() * -4.0 / (3.0 * PI) / 2.0;
        assert!((f64::from(t[3]) - expected).abs() < 1e-4, "{} {expected}", t[3]);
        assert!(sh::coefficients(2) == 4 && t[4..].iter().all(|&v| v == 0.0));
    }
}
