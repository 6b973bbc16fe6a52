//! Real orthonormal spherical harmonics without Condon-Shortley sign: index `l (l + 1) + m`, all
//! constants positive, so band 1 is `0.488603 * (y, z, x)`.

use glam::{DVec3, Vec3};
use std::f64::consts::PI;
use std::sync::LazyLock;

pub const MAX_BANDS: usize = 6;
pub const MAX_COEFFICIENTS: usize = MAX_BANDS * MAX_BANDS;

/// Coefficients of `bands` bands.
pub const fn coefficients(bands: usize) -> usize {
    bands * bands
}

/// The basis functions Y of the first `bands` bands in a unit direction, written to
/// `out[..bands * bands]`.
///
/// Uses Re and Im of (x + iy)^m, so that the poles need no special case.
pub fn basis_f64(direction: DVec3, bands: usize, out: &mut [f64]) {
    assert!((1..=MAX_BANDS).contains(&bands), "1 to {MAX_BANDS} bands, not {bands}");
    let (x, y, z) = (direction.x, direction.y, direction.z);
    let (mut re, mut im) = (1.0, 0.0);
    let mut diagonal = 1.0; // P_m^m / sin^m = (2m - 1)!!
    for m in 0..bands {
        let (mut previous, mut current) = (0.0, diagonal);
        for l in m..bands {
            let k = normalisation(l, m);
            if m == 0 {
                out[l * (l + 1)] = k * current;
            } else {
                let k = k * std::f64::consts::SQRT_2 * current;
                out[l * (l + 1) + m] = k * re;
                out[l * (l + 1) - m] = k * im;
            }
            let next =
                (z * (2 * l + 1) as f64 * current - (l + m) as f64 * previous) / (l + 1 - m) as f64;
            previous = current;
            current = next;
        }
        (re, im) = (re * x - im * y, re * y + im * x);
        diagonal *= (2 * m + 1) as f64;
    }
}

fn normalisation(l: usize, m: usize) -> f64 {
    let ratio: f64 = ((l - m + 1)..=(l + m)).map(|k| k as f64).product();
    ((2 * l + 1) as f64 / (4.0 * PI) / ratio).sqrt()
}

/// f32 form of [`basis_f64`].
pub fn basis(direction: Vec3, bands: usize) -> [f32; MAX_COEFFICIENTS] {
    let mut out = [0.0; MAX_COEFFICIENTS];
    basis_f64(direction.as_dvec3(), bands, &mut out);
    out.map(|v| v as f32)
}

/// Zonal factors of the clamped cosine: a function with coefficients c_lm, seen through
/// max(0, n.w), integrates to sum A_l c_lm Y_lm(n) (Ramamoorthi and Hanrahan 2001).
pub const CLAMPED_COSINE: [f64; MAX_BANDS] = [PI, 2.0 * PI / 3.0, PI / 4.0, 0.0, -PI / 24.0, 0.0];

/// Transfer of an unoccluded surface with this normal: (1/pi) integral max(0, n.w) Y(w) dw.
pub fn unoccluded_transfer(normal: Vec3, bands: usize) -> [f32; MAX_COEFFICIENTS] {
    let mut out = [0.0; MAX_COEFFICIENTS];
    basis_f64(normal.as_dvec3(), bands, &mut out);
    for l in 0..bands {
        for value in &mut out[l * l..(l + 1) * (l + 1)] {
            *value *= CLAMPED_COSINE[l] / PI;
        }
    }
    out.map(|v| v as f32)
}

/// Normalisations by [l][m]; those of m > 0 hold the square root of 2.
static NORMALISATION: LazyLock<[[f32; MAX_BANDS]; MAX_BANDS]> = LazyLock::new(|| {
    std::array::from_fn(|l| {
        std::array::from_fn(|m| match m {
            0 => normalisation(l, 0) as f32,
            m if m <= l => (std::f64::consts::SQRT_2 * normalisation(l, m)) as f32,
            _ => 0.0,
        })
    })
});

/// Factors of the basis times those of [`CLAMPED_COSINE`] over pi, by `MAX_BANDS * l + m`; those of m > 0
/// hold the square root of 2.
#[cfg(feature = "gpu")]
pub(crate) fn lobe_factors() -> [f32; MAX_COEFFICIENTS] {
    std::array::from_fn(|i| {
        let l = i / MAX_BANDS;
        NORMALISATION[l][i % MAX_BANDS] * (CLAMPED_COSINE[l] / PI) as f32
    })
}

/// The basis in L unit directions at once, for SIMD kernels: `out[coefficient][lane]`.
#[inline(always)]
pub fn basis_lanes<const L: usize>(
    [x, y, z]: &[[f32; L]; 3],
    bands: usize,
    out: &mut [[f32; L]; MAX_COEFFICIENTS],
) {
    let table = &*NORMALISATION;
    let (mut re, mut im) = ([1.0; L], [0.0; L]);
    let mut diagonal = 1.0;
    for m in 0..bands.min(MAX_BANDS) {
        let (mut previous, mut current) = ([0.0; L], [diagonal; L]);
        for l in m..bands.min(MAX_BANDS) {
            let k = table[l][m];
            let (plus, minus) = (l * (l + 1) + m, l * (l + 1) - m);
            let (a, b) = ((2 * l + 1) as f32, (l + m) as f32);
            let scale = 1.0 / (l + 1 - m) as f32;
            // Loops of one output each: two that may be the same row keep LLVM from using vectors.
            if m > 0 {
                for i in 0..L {
                    out[minus][i] = k * current[i] * im[i];
                }
            }
            for i in 0..L {
                out[plus][i] = k * current[i] * re[i];
            }
            for i in 0..L {
                let next = (z[i] * a * current[i] - b * previous[i]) * scale;
                previous[i] = current[i];
                current[i] = next;
            }
        }
        for i in 0..L {
            (re[i], im[i]) = (re[i] * x[i] - im[i] * y[i], re[i] * y[i] + im[i] * x[i]);
        }
        diagonal *= (2 * m + 1) as f32;
    }
}

/// Unit vector towards the light from band 1 of a light; `None` where band 1 is zero.
pub fn dominant_direction(coefficients: &[f32]) -> Option<Vec3> {
    let [_, y, z, x, ..] = *coefficients else { return None };
    let band = Vec3::new(x, y, z);
    // Squares of what is very dim or bright leave the range in which f32 is precise.
    match (1e-30..1e30).contains(&band.length_squared()) {
        true => band.try_normalize(),
        false => (band / band.abs().max_element()).try_normalize(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::fibonacci_sphere_f64;

    #[test]
    fn named_constants_and_signs() {
        let d = DVec3::new(0.36, 0.48, 0.8);
        let mut y = [0.0; MAX_COEFFICIENTS];
        basis_f64(d, 4, &mut y);
        let expected = [
            0.282095,
            0.488603 * d.y,
            0.488603 * d.z,
            0.488603 * d.x,
            1.092548 * d.x * d.y,
            1.092548 * d.y * d.z,
            0.315392 * (3.0 * d.z * d.z - 1.0),
            1.092548 * d.x * d.z,
            0.546274 * (d.x * d.x - d.y * d.y),
            0.590044 * d.y * (3.0 * d.x * d.x - d.y * d.y),
            2.890611 * d.x * d.y * d.z,
            0.457046 * d.y * (5.0 * d.z * d.z - 1.0),
            0.373176 * d.z * (5.0 * d.z * d.z - 3.0),
            0.457046 * d.x * (5.0 * d.z * d.z - 1.0),
            1.445306 * d.z * (d.x * d.x - d.y * d.y),
            0.590044 * d.x * (d.x * d.x - 3.0 * d.y * d.y),
        ];
        for (i, (a, e)) in y.iter().zip(expected).enumerate() {
            // the printed constants have six decimals
            assert!((a - e).abs() < 2e-6, "coefficient {i}: {a} against {e}");
        }
    }

    #[test]
    fn basis_is_orthonormal() {
        let n = 20_000;
        let mut gram = vec![0.0; MAX_COEFFICIENTS * MAX_COEFFICIENTS];
        let mut y = [0.0; MAX_COEFFICIENTS];
        for d in fibonacci_sphere_f64(n) {
            basis_f64(d, MAX_BANDS, &mut y);
            for i in 0..MAX_COEFFICIENTS {
                for j in 0..MAX_COEFFICIENTS {
                    gram[i * MAX_COEFFICIENTS + j] += y[i] * y[j] * 4.0 * PI / n as f64;
                }
            }
        }
        for i in 0..MAX_COEFFICIENTS {
            for j in 0..MAX_COEFFICIENTS {
                let e = if i == j { 1.0 } else { 0.0 };
                // error of the Fibonacci rule with 20000 points on polynomials of degree 10
                assert!((gram[i * MAX_COEFFICIENTS + j] - e).abs() < 1e-3, "{i} {j}");
            }
        }
    }

    #[test]
    fn clamped_cosine_matches_quadrature() {
        let normal = DVec3::new(-0.48, 0.6, 0.64);
        let n = 200_000;
        let mut sum = [0.0; MAX_COEFFICIENTS];
        let mut y = [0.0; MAX_COEFFICIENTS];
        for d in fibonacci_sphere_f64(n) {
            basis_f64(d, MAX_BANDS, &mut y);
            let w = normal.dot(d).max(0.0) * 4.0 / n as f64;
            sum.iter_mut().zip(y).for_each(|(s, y)| *s += w * y);
        }
        let analytic = unoccluded_transfer(normal.as_vec3(), MAX_BANDS);
        for i in 0..MAX_COEFFICIENTS {
            assert!((sum[i] - f64::from(analytic[i])).abs() < 1e-4, "{i}");
        }
    }

    #[test]
    fn lanes_agree_with_the_scalar_basis() {
        let directions: Vec<_> = fibonacci_sphere_f64(32).collect();
        for bands in 1..=MAX_BANDS {
            let lane = |axis: usize| std::array::from_fn(|i| directions[i][axis] as f32);
            let mut out = [[f32::NAN; 32]; MAX_COEFFICIENTS];
            basis_lanes(&[lane(0), lane(1), lane(2)], bands, &mut out);
            for (i, d) in directions.iter().enumerate() {
                let expected = basis(d.as_vec3(), bands);
                for k in 0..coefficients(bands) {
                    // recursions of five steps in f32, values up to 3
                    assert!((out[k][i] - expected[k]).abs() < 3e-6, "{k}: {}", out[k][i]);
                }
                assert!(out[coefficients(bands)..].iter().all(|row| row[i].is_nan()));
            }
        }
    }

    #[test]
    fn dominant_direction_points_towards_the_light() {
        for towards in [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z] {
            let light = basis(towards, 2);
            let found = dominant_direction(&light).unwrap();
            assert!(found.dot(towards) > 0.999_999);
        }
        assert!(dominant_direction(&[1.0, 0.0, 0.0, 0.0]).is_none());
        assert!(dominant_direction(&[1.0, 0.0, f32::NAN, 0.0]).is_none());
        for scale in [1e-44, 1e-20, 1e20, 1e38] {
            let found = dominant_direction(&[0.0, 0.6 * scale, 0.0, 0.8 * scale]).unwrap();
            // 1e-44 is seven steps of the smallest f32
            let rounding = if scale < 1e-40 { 0.1 } else { 1e-6 };
            assert!(found.distance(Vec3::new(0.8, 0.6, 0.0)) < rounding, "{scale}: {found}");
            assert!((found.length() - 1.0).abs() < 1e-6, "{scale}: {found}");
        }
    }
}
