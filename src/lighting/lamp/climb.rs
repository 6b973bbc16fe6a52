//! Where nearby the gain of a lamp is greatest: Newton's method.
//!
//! Every step is a smooth function of the samples, so that what hardly differs is hardly lit otherwise. A
//! choice among tried places is not: numbers that differ in their last bits make it jump from one to the next.

use super::candidate::Candidate;
use super::search::Search;
use nalgebra::{Matrix3, Vector3};

/// Half width of the differences that derivatives are taken from, in radians and in parallax (the share of
/// the lamp's distance that the samples extend over). Rounding of sums of f32, about 3e-7 of the gain, turns
/// the summit of a gain of curvature 0.5 by 1e-5 radians then.
const STENCIL: f32 = 0.03;
/// Curvature (share of the gain per square radian) below which a direction counts as flat.
const FLAT: f64 = 0.02;
/// A step may lose this share of the gain. Around a summit gains tell places apart from some thousandths of a radian
/// on, derivatives from 1e-5: if each step had to gain, rounding would decide where the last ones end, and the light
/// would jump by 4e-4 of its norm. It jumps by 3e-5 so.
const LOSS: f64 = 1e-5;
/// The longest step.
const REACH: f64 = 0.25;
const MOST_STEPS: usize = 10;
/// Shorter steps are left out: 0.001 degrees.
const NO_STEP: f64 = 2e-5;
/// A lamp is not searched nearer than 0.8 extents.
const MOST_PARALLAX: f32 = 1.25;

/// The gain around a place, to second order; two angles and the parallax. Derivatives are relative to the
/// gain.
struct Shape {
    at: Candidate,
    gain: f64,
    gradient: Vector3<f64>,
    hessian: Matrix3<f64>,
}

impl Search<'_> {
    /// The summit of the hill that `start` is on.
    pub(super) fn climb(&self, start: Candidate) -> (f64, Candidate) {
        let mut best = self.shape(start);
        let mut reach = REACH;
        for _ in 0..MOST_STEPS {
            let step = self.within(best.at, best.newton_step(0.0), reach);
            if !(best.gain > 0.0 && step.norm() > NO_STEP) {
                break;
            }
            let next = self.shape(self.moved(best.at, step));
            if next.gain > (1.0 - LOSS) * best.gain {
                reach = (2.0 * step.norm()).min(REACH);
                best = next;
            } else {
                reach = 0.25 * step.norm();
            }
        }
        (best.gain, best.at)
    }

    /// One step from the last place, held back by `pull` (share of the gain per square radian).
    pub(super) fn drift(&self, last: Candidate, pull: f64) -> (f64, Candidate) {
        let here = self.shape(last);
        if here.gain <= 0.0 {
            return (here.gain.max(0.0), here.at);
        }
        let whole = self.within(here.at, here.newton_step(pull), REACH);
        let steps = [1.0, 0.5, 0.25].map(|share| share * whole);
        let places = steps.map(|step| self.moved(here.at, step));
        let gains = self.gains(&places, 1);
        let worth = |k: usize| gains[k] / here.gain - 0.5 * pull * steps[k].norm_squared();
        (0..steps.len())
            .find(|&k| worth(k) > 1.0 - LOSS)
            .map_or((here.gain, here.at), |k| (gains[k], places[k]))
    }

    fn shape(&self, at: Candidate) -> Shape {
        let h = f64::from(STENCIL);
        let dimensions = if self.near { 3 } else { 2 };
        let axis = |k: usize| Vector3::ith(k, h);
        let mut offsets = vec![Vector3::zeros()];
        for k in 0..dimensions {
            offsets.extend([axis(k), -axis(k)]);
        }
        for k in 0..dimensions {
            offsets.extend((0..k).map(|j| axis(j) + axis(k)));
        }
        let places: Vec<Candidate> = offsets.iter().map(|&o| self.displaced(at, o)).collect();
        let gains = self.gains(&places, 1);
        let gain = gains[0];
        let mut shape =
            Shape { at: places[0], gain, gradient: Vector3::zeros(), hessian: Matrix3::zeros() };
        if gain <= 0.0 {
            return shape;
        }
        let relative: Vec<f64> = gains.iter().map(|g| g / gain).collect();
        let mut mixed = relative[1 + 2 * dimensions..].iter();
        for k in 0..dimensions {
            let [more, less] = [relative[1 + 2 * k], relative[2 + 2 * k]];
            shape.gradient[k] = (more - less) / (2.0 * h);
            shape.hessian[(k, k)] = (more - 2.0 + less) / (h * h);
            for j in 0..k {
                let both = mixed.next().expect("one for each pair");
                let bent = (both - relative[1 + 2 * j] - more + 1.0) / (h * h);
                shape.hessian[(j, k)] = bent;
                shape.hessian[(k, j)] = bent;
            }
        }
        shape
    }

    fn moved(&self, from: Candidate, step: Vector3<f64>) -> Candidate {
        let mut there = self.displaced(from, step);
        there.nearness_per_m = there.nearness_per_m.clamp(0.0, MOST_PARALLAX / self.extent_m);
        there
    }

    fn displaced(&self, from: Candidate, offset: Vector3<f64>) -> Candidate {
        let [right, up, parallax] = [offset.x, offset.y, offset.z].map(|v| v as f32);
        let nearer = if self.near { parallax / self.extent_m } else { 0.0 };
        from.moved([right, up], nearer)
    }

    /// A step that is not too long, and ends no farther than infinity.
    fn within(&self, from: Candidate, mut step: Vector3<f64>, reach: f64) -> Vector3<f64> {
        if self.near {
            let parallax = f64::from(from.nearness_per_m * self.extent_m);
            step.z = step.z.clamp(-parallax, f64::from(MOST_PARALLAX) - parallax);
        }
        step * (reach / step.norm().max(f64::MIN_POSITIVE)).min(1.0)
    }
}

impl Shape {
    /// Towards the summit; where the gain is not curved downwards, uphill.
    fn newton_step(&self, pull: f64) -> Vector3<f64> {
        let parts = self.hessian.symmetric_eigen();
        let along = parts.eigenvectors.transpose() * self.gradient;
        let curved = parts.eigenvalues.map(|v| v.abs().max(FLAT) + pull);
        parts.eigenvectors * along.component_div(&curved)
    }
}
