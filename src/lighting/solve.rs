//! Regularised solution of the normal equations, and how well they determine it.

use super::LightParams;
use super::normal_equations::NormalEquations;
use nalgebra::{Cholesky, DMatrix, DVector, SymmetricEigen};

/// Eigenvalues below this share of the largest are rounding: products of T are summed in f32 over chunks of 64, each
/// off by 64 * 2^-24 at most, and where all rows are alike, all are off by the same.
const RANK_TOLERANCE: f64 = 4e-6;

/// What f64 can tell from infinite.
const MAX_CONDITION: f64 = 1e16;

/// Least squares with a quadratic penalty, (N + P) l = b with diagonal P: every coefficient is believed to
/// be near zero, the more so in high bands.
#[derive(Clone, Debug, PartialEq)]
pub struct Penalty {
    /// Diagonal of P, in units of the normal equations.
    diagonal: Vec<f64>,
}

impl Penalty {
    pub fn new(equations: &NormalEquations, params: &LightParams) -> Self {
        let unit = params.tikhonov * equations.mean_eigenvalue();
        let weights = Self::weights(equations.n, params);
        Self { diagonal: weights.into_iter().map(|weight| unit * weight).collect() }
    }

    /// Of `n` coefficients, relative to band 1; the mean level is penalised like band 1.
    pub fn weights(n: usize, params: &LightParams) -> Vec<f64> {
        let weight = |l: usize| ((l * (l + 1)).max(2) as f64 / 2.0).powf(params.band_power);
        (0..n).map(|i| weight(i.isqrt())).collect()
    }
}

/// Non-negative least squares of two unknowns, with the symmetric matrix `[aa, ab, bb]`.
pub fn non_negative_pair([aa, ab, bb]: [f64; 3], [a_seen, b_seen]: [f64; 2]) -> (f64, f64) {
    let determinant = aa * bb - ab * ab;
    if determinant > 1e-12 * aa * bb {
        let a = (bb * a_seen - ab * b_seen) / determinant;
        let b = (aa * b_seen - ab * a_seen) / determinant;
        if a >= 0.0 && b >= 0.0 {
            return (a, b);
        }
    }
    // One of the two is zero: the better of each alone.
    let alone = |seen: f64, gram: f64| if gram > 0.0 { (seen / gram).max(0.0) } else { 0.0 };
    let (a, b) = (alone(a_seen, aa), alone(b_seen, bb));
    if a * a_seen >= b * b_seen { (a, 0.0) } else { (0.0, b) }
}

/// Solution for every channel, and the inverse that their deviations come from.
#[derive(Clone, Debug)]
pub struct Solution {
    /// `n` coefficients a channel.
    pub light: Vec<Vec<f64>>,
    /// Of N + P; a pseudo-inverse where neither data nor prior determine all.
    pub inverse: DMatrix<f64>,
}

/// What the data alone determine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spectrum {
    pub rank: usize,
    /// Largest by smallest eigenvalue; at most 1e16.
    pub condition: f64,
}

pub fn solve(equations: &NormalEquations, penalty: &Penalty) -> Solution {
    let n = equations.n;
    let mut matrix = DMatrix::from_row_slice(n, n, &equations.gram);
    for i in 0..n {
        matrix[(i, i)] += penalty.diagonal[i];
    }
    let rhs: Vec<_> = equations.rhs.iter().map(|b| DVector::from_column_slice(b)).collect();
    by_cholesky(&matrix, &rhs).unwrap_or_else(|| {
        // the solution of least norm: directions without data stay 0
        let inverse = pseudo_inverse(matrix);
        let light = rhs.iter().map(|b| (&inverse * b).as_slice().to_vec()).collect();
        Solution { light, inverse }
    })
}

/// `None` where the matrix is not safely positive definite.
fn by_cholesky(matrix: &DMatrix<f64>, rhs: &[DVector<f64>]) -> Option<Solution> {
    let factor = Cholesky::new(matrix.clone())?;
    let pivots = factor.l_dirty().diagonal().map(|d| d * d);
    // A lower bound of the condition number, good enough to tell rounding from data.
    (pivots.min() > RANK_TOLERANCE * pivots.max()).then(|| Solution {
        light: rhs.iter().map(|b| factor.solve(b).as_slice().to_vec()).collect(),
        inverse: factor.inverse(),
    })
}

/// Of a symmetric matrix without negative eigenvalues; those that are rounding count as zero.
pub fn pseudo_inverse(matrix: DMatrix<f64>) -> DMatrix<f64> {
    let n = matrix.nrows();
    if n == 0 {
        return matrix;
    }
    let SymmetricEigen { eigenvectors, eigenvalues } = SymmetricEigen::new(matrix);
    let limit = RANK_TOLERANCE * eigenvalues.max();
    let mut inverse = DMatrix::zeros(n, n);
    for (vector, &value) in eigenvectors.column_iter().zip(&eigenvalues) {
        if value > limit {
            inverse.ger(1.0 / value, &vector, &vector, 1.0);
        }
    }
    inverse
}

pub fn spectrum(equations: &NormalEquations) -> Spectrum {
    let n = equations.n;
    let values = DMatrix::from_row_slice(n, n, &equations.gram).symmetric_eigenvalues();
    let largest = values.max();
    let limit = RANK_TOLERANCE * largest;
    // Not the quotient with 1e-16 of the largest, which rounding lifts above the limit.
    let condition =
        if largest > 0.0 { largest / values.min().max(f64::MIN_POSITIVE) } else { MAX_CONDITION };
    Spectrum {
        rank: values.iter().filter(|&&v| v > limit).count(),
        condition: condition.min(MAX_CONDITION),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn equations(gram: &[f64], rhs: &[f64]) -> NormalEquations {
        NormalEquations { n: rhs.len(), gram: gram.to_vec(), rhs: vec![rhs.to_vec()], weight: 1.0 }
    }

    fn no_penalty(n: usize) -> Penalty {
        Penalty { diagonal: vec![0.0; n] }
    }

    #[test]
    fn known_system_and_inverse() {
        let found = solve(&equations(&[4.0, 2.0, 2.0, 3.0], &[2.0, 5.0]), &no_penalty(2));
        // inverse of [[4, 2], [2, 3]] is [[3, -2], [-2, 4]] / 8
        for (a, b) in found.light[0].iter().zip([-0.5, 2.0]) {
            assert!((a - b).abs() < 1e-14);
        }
        for (a, b) in found.inverse.iter().zip([0.375, -0.25, -0.25, 0.5]) {
            assert!((a - b).abs() < 1e-14);
        }
    }

    #[test]
    fn singular_system_gives_the_solution_of_least_norm() {
        let found = solve(&equations(&[1.0, 1.0, 1.0, 1.0], &[2.0, 2.0]), &no_penalty(2));
        assert!(found.light[0].iter().all(|l| (l - 1.0).abs() < 1e-14));
        // of [[1, 1], [1, 1]]: the eigenvalue 2 along the diagonal alone
        assert!(found.inverse.iter().all(|v| (v - 0.25).abs() < 1e-14));
        let nothing = solve(&equations(&[0.0; 4], &[0.0; 2]), &no_penalty(2));
        assert_eq!(nothing.light[0], [0.0, 0.0]);
        assert!(nothing.inverse.iter().all(|&v| v == 0.0));
    }

    #[test]
    fn prior_shrinks_by_its_share_and_grows_with_the_band() {
        let mut gram = [0.0; 81];
        (0..9).for_each(|i| gram[i * 10] = 2.0);
        let equations = equations(&gram, &[1.0; 9]);
        let params = LightParams { tikhonov: 0.5, band_power: 2.0, ..LightParams::default() };
        let found = solve(&equations, &Penalty::new(&equations, &params));
        // the mean eigenvalue is 2: penalties are 1 in bands 0 and 1, (6 / 2)^2 in band 2
        for (i, l) in found.light[0].iter().enumerate() {
            let expected = if i < 4 { 1.0 / 3.0 } else { 1.0 / 11.0 };
            assert!((l - expected).abs() < 1e-14, "{i}: {l}");
        }
    }

    #[test]
    fn spectrum_of_diagonal_matrices() {
        let s = spectrum(&equations(&[8.0, 0.0, 0.0, 2.0], &[0.0; 2]));
        assert_eq!((s.rank, s.condition), (2, 4.0));
        let s = spectrum(&equations(&[8.0, 0.0, 0.0, 0.0], &[0.0; 2]));
        assert_eq!((s.rank, s.condition), (1, 1e16));
        // 3 over 1e-16 times 3 is above 1e16
        let s = spectrum(&equations(&[3.0, 0.0, 0.0, 0.0], &[0.0; 2]));
        assert_eq!((s.rank, s.condition), (1, 1e16));
        assert_eq!(spectrum(&equations(&[0.0; 4], &[0.0; 2])).rank, 0);
    }
}
