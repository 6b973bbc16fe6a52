//! Directions spread evenly over the sphere.

use glam::{DVec3, Vec3};
use std::f64::consts::PI;

/// A Fibonacci spiral of n unit vectors from +z to -z.
pub fn fibonacci_sphere(n: usize) -> Vec<Vec3> {
    fibonacci_sphere_f64(n).map(|direction| direction.as_vec3()).collect()
}

/// The same in f64, any part of it at a time.
pub fn fibonacci_sphere_f64(
    n: usize,
) -> impl ExactSizeIterator<Item = DVec3> + DoubleEndedIterator + Clone {
    let golden = PI * (3.0 - 5f64.sqrt());
    (0..n).map(move |i| {
        let z = 1.0 - (2 * i + 1) as f64 / n as f64;
        let r = (1.0 - z * z).sqrt();
        let (sin, cos) = (golden * i as f64).sin_cos();
        DVec3::new(r * cos, r * sin, z)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_unit_and_balanced() {
        let directions = fibonacci_sphere(200);
        assert!(directions.iter().all(|d| (d.length() - 1.0).abs() < 1e-6));
        let mean = directions.iter().sum::<Vec3>() / 200.0;
        assert!(mean.length() < 1e-2, "{mean}");
        // any direction has one within twice the radius of an equal share of the sphere, 4 degrees each
        for probe in fibonacci_sphere(1000) {
            let best = directions.iter().map(|d| d.dot(probe)).fold(-1.0, f32::max);
            assert!(best > 12f32.to_radians().cos(), "{probe}");
        }
        assert!(fibonacci_sphere(0).is_empty());
    }
}
