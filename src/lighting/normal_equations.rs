//! T^T W T and T^T W I: f32 sums over short chunks of rows, f64 totals.

/// Rows summed in f32 before they enter the f64 totals: the rounding error of a chunk stays below
/// 64 * 2^-24 of its value, and averages out over the chunks.
const CHUNK: usize = 64;

/// Rows of the Gram matrix that are accumulated together. From 8 on, LLVM packs the rows instead of
/// the columns into vectors and the kernel takes five times as long.
const BLOCK: usize = 4;

/// Coefficients are padded with zeros to whole vectors.
pub const fn padded(coefficients: usize) -> usize {
    coefficients.next_multiple_of(16)
}

/// Normal equations of weighted least squares, with one right-hand side per colour channel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NormalEquations {
    /// Coefficients, n.
    pub n: usize,
    /// n x n, row-major.
    pub gram: Vec<f64>,
    /// n values per channel.
    pub rhs: Vec<Vec<f64>>,
    /// Sum of the weights.
    pub weight: f64,
}

impl NormalEquations {
    /// Empties the sums and gives them this shape.
    pub fn reset(&mut self, n: usize, channels: usize) {
        self.n = n;
        self.weight = 0.0;
        self.gram.clear();
        self.gram.resize(n * n, 0.0);
        self.rhs.resize(channels, Vec::new());
        for rhs in &mut self.rhs {
            rhs.clear();
            rhs.resize(n, 0.0);
        }
    }

    /// Mean of the diagonal: the scale that the regularisation is relative to.
    pub fn mean_eigenvalue(&self) -> f64 {
        (0..self.n).map(|i| self.gram[i * (self.n + 1)]).sum::<f64>() / self.n.max(1) as f64
    }

    /// Adds rows: `rows` holds `padded(n)` coefficients each, `targets` one plane a channel.
    pub fn add_rows(&mut self, rows: &[f32], targets: &[Vec<f32>], weights: &[f32]) {
        match padded(self.n) {
            16 => add_rows::<16>(self, rows, targets, weights),
            32 => add_rows::<32>(self, rows, targets, weights),
            _ => add_rows::<48>(self, rows, targets, weights),
        }
    }
}

fn add_rows<const P: usize>(
    sums: &mut NormalEquations,
    rows: &[f32],
    targets: &[Vec<f32>],
    weights: &[f32],
) {
    let mut weighted = [[0.0; P]; CHUNK];
    let mut block = [[0.0; P]; BLOCK];
    for (c, (rows, weights)) in rows.chunks(CHUNK * P).zip(weights.chunks(CHUNK)).enumerate() {
        let (rows, _) = rows.as_chunks::<P>();
        weigh_rows(rows, weights, &mut weighted);
        let weighted = &weighted[..rows.len()];
        for first in (0..sums.n).step_by(BLOCK) {
            gram_block(rows, weighted, first, &mut block);
            for (i, sum) in block.iter().enumerate().take(sums.n - first) {
                let total = &mut sums.gram[(first + i) * sums.n..][..sums.n];
                total.iter_mut().zip(sum).for_each(|(t, &s)| *t += f64::from(s));
            }
        }
        for (rhs, targets) in sums.rhs.iter_mut().zip(targets) {
            let mut sum = [0.0; P];
            for (row, &target) in weighted.iter().zip(&targets[c * CHUNK..]) {
                sum.iter_mut().zip(row).for_each(|(s, t)| *s += t * target);
            }
            rhs.iter_mut().zip(&sum).for_each(|(t, &s)| *t += f64::from(s));
        }
        sums.weight += f64::from(weights.iter().sum::<f32>());
    }
}

fn weigh_rows<const P: usize>(rows: &[[f32; P]], weights: &[f32], out: &mut [[f32; P]; CHUNK]) {
    for ((out, row), &w) in out.iter_mut().zip(rows).zip(weights) {
        for (out, t) in out.iter_mut().zip(row) {
            *out = t * w;
        }
    }
}

#[inline(always)]
fn gram_block_body<const P: usize>(
    rows: &[[f32; P]],
    weighted: &[[f32; P]],
    first: usize,
    out: &mut [[f32; P]; BLOCK],
) {
    let mut sum = [[0.0f32; P]; BLOCK];
    for (row, weighted) in rows.iter().zip(weighted) {
        for i in 0..BLOCK {
            let factor = weighted[(first + i).min(P - 1)];
            for k in 0..P {
                sum[i][k] += factor * row[k];
            }
        }
    }
    *out = sum;
}

/// Rows `first..first + BLOCK` of the Gram matrix of one chunk.
fn gram_block<const P: usize>(
    rows: &[[f32; P]],
    weighted: &[[f32; P]],
    first: usize,
    out: &mut [[f32; P]; BLOCK],
) {
    #[multiversion::multiversion(targets(
        "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
        "x86_64+avx2+fma+bmi2"
    ))]
    fn dispatch<const P: usize>(
        rows: &[[f32; P]],
        weighted: &[[f32; P]],
        first: usize,
        out: &mut [[f32; P]; BLOCK],
    ) {
        gram_block_body(rows, weighted, first, out);
    }
    dispatch(rows, weighted, first, out);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Rng;

    fn case(n: usize, count: usize) -> (Vec<f32>, Vec<Vec<f32>>, Vec<f32>) {
        let mut rng = Rng::new(&[11, n as u32]);
        let p = padded(n);
        let mut rows = vec![0.0; count * p];
        for row in rows.chunks_mut(p) {
            row[..n].fill_with(|| rng.normal());
        }
        let targets = (0..3).map(|_| (0..count).map(|_| rng.normal()).collect()).collect();
        let weights = (0..count).map(|_| rng.uniform()).collect();
        (rows, targets, weights)
    }

    #[test]
    fn sums_match_plain_f64_loops_for_every_number_of_bands() {
        for bands in 1..=6 {
            let (n, count) = (bands * bands, 333);
            let (rows, targets, weights) = case(n, count);
            let mut sums = NormalEquations::default();
            sums.reset(n, 3);
            sums.add_rows(&rows, &targets, &weights);
            let entry = |r: usize, i: usize| f64::from(rows[r * padded(n) + i]);
            for i in 0..n {
                for j in 0..n {
                    let exact: f64 =
                        (0..count).map(|r| f64::from(weights[r]) * entry(r, i) * entry(r, j)).sum();
                    // 64 roundings of sums up to about 64
                    assert!((sums.gram[i * n + j] - exact).abs() < 2e-4, "bands {bands} {i} {j}");
                }
                for c in 0..3 {
                    let exact: f64 = (0..count)
                        .map(|r| f64::from(weights[r] * targets[c][r]) * entry(r, i))
                        .sum();
                    assert!((sums.rhs[c][i] - exact).abs() < 2e-4, "bands {bands} {i}");
                }
            }
        }
    }
}
