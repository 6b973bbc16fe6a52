//! Non-linear least squares with few parameters.

use nalgebra::{DMatrix, DVector};

/// The normal equations `J^T W J` and `J^T W r` of residuals `r` at some parameters, and the cost.
pub(super) struct Normal {
    pub matrix: DMatrix<f64>,
    pub gradient: DVector<f64>,
    pub cost: f64,
}

impl Normal {
    pub fn new(parameters: usize) -> Self {
        Self {
            matrix: DMatrix::zeros(parameters, parameters),
            gradient: DVector::zeros(parameters),
            cost: 0.0,
        }
    }

    /// One residual with the derivative of each parameter, under Huber's weights: beyond `limit` a
    /// residual counts linearly.
    pub fn add(&mut self, residual: f64, slope: &DVector<f64>, limit: f64) {
        let size = residual.abs();
        let weight = if size <= limit { 1.0 } else { limit / size };
        self.cost += if size <= limit { size * size } else { limit * (2.0 * size - limit) };
        self.matrix.ger(weight, slope, slope, 1.0);
        self.gradient.axpy(weight * residual, slope, 1.0);
    }
}

/// Levenberg and Marquardt's method with the diagonal as scale. Ends when a step gains less than a
/// millionth of the cost.
pub(super) fn minimise(
    start: DVector<f64>,
    rounds: usize,
    mut normal: impl FnMut(&DVector<f64>) -> Normal,
) -> (DVector<f64>, Normal) {
    let mut at = start;
    let mut here = normal(&at);
    let mut damping = 1e-3;
    for _ in 0..rounds {
        let mut damped = here.matrix.clone();
        for i in 0..at.len() {
            // A parameter that nothing depends on stays where it is.
            damped[(i, i)] += damping * here.matrix[(i, i)].max(1e-12);
        }
        let step = damped.cholesky().map(|c| c.solve(&here.gradient));
        let next = step.map(|step| &at - step);
        let there = next.as_ref().map(&mut normal).filter(|n| n.cost.is_finite());
        match (next, there) {
            (Some(next), Some(there)) if there.cost < here.cost => {
                let gain = here.cost - there.cost;
                (at, here) = (next, there);
                damping = (damping * 0.2).max(1e-12);
                if gain < 1e-6 * here.cost {
                    break;
                }
            }
            _ if damping > 1e8 => break,
            _ => damping *= 8.0,
        }
    }
    (at, here)
}
