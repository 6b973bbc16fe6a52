//! When to change settings: update times in, steps on a ladder out. Knows nothing of a pipeline.

use crate::math::median;
use std::collections::VecDeque;

/// Frames whose median must exceed the budget before the settings get faster; a lone slow frame
/// never does it. Directly after a change fewer are at hand.
const DOWN_WINDOW: usize = 5;
const DOWN_FEWEST: usize = 3;

/// Frames whose median says whether better settings may fit.
const UP_WINDOW: usize = 15;

/// Share of the budget that settings may be predicted to take, to be stepped down to or started with.
pub(super) const FITS: f64 = 0.95;

/// And to be stepped up to. The gap between the two is the hysteresis: what was left at the
/// budget is not taken again before everything runs 15 % faster.
const FITS_BETTER: f64 = 0.85;

/// Frames after a change that are not looked at: memory is laid out anew, buffers are redone.
const SETTLE: usize = 2;

/// A step up has failed if a step down follows within so many frames.
const TRIAL: usize = 60;

/// Frames between a step down and the next step up. Doubled by every failed step up, halved by one
/// that lasts.
const COOL_DOWN: usize = 30;
const LONGEST_COOL_DOWN: usize = 64 * COOL_DOWN;

/// From one rung to another, because of this median update time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Change {
    pub from: usize,
    pub to: usize,
    pub median_ms: f64,
}

/// Keeps the median update time within a budget.
///
/// The predictions of a ladder are taken for right up to one common factor, the load of the
/// machine: the measured median over the prediction of the rung in use.
#[derive(Clone, Debug)]
pub struct Controller {
    budget_ms: f64,
    /// Of each rung; falling.
    predicted_ms: Vec<f64>,
    rung: usize,
    /// Newest last; all made on this rung.
    recent: VecDeque<f64>,
    settle: usize,
    /// Frames until a step up is allowed, and how many they will be after the next step down.
    wait: usize,
    cool_down: usize,
    /// Frames since a step up that may still fail.
    trial: Option<usize>,
}

impl Controller {
    /// `predicted_ms` falls from the most accurate to the fastest rung and has at least one;
    /// the first `warm_up` frames are not looked at.
    pub fn new(budget_ms: f64, predicted_ms: Vec<f64>, rung: usize, warm_up: usize) -> Self {
        assert!(rung < predicted_ms.len(), "rung {rung} of {}", predicted_ms.len());
        Self {
            budget_ms,
            predicted_ms,
            rung,
            recent: VecDeque::with_capacity(UP_WINDOW),
            settle: warm_up,
            wait: COOL_DOWN,
            cool_down: COOL_DOWN,
            trial: None,
        }
    }

    /// The rung in use.
    pub fn rung(&self) -> usize {
        self.rung
    }

    /// Takes in the update time of one frame made on [`Self::rung`]. Times that are not positive numbers
    /// are no frames.
    pub fn frame(&mut self, update_ms: f64) -> Option<Change> {
        if !(update_ms > 0.0 && update_ms.is_finite()) {
            return None;
        }
        self.wait = self.wait.saturating_sub(1);
        self.count_trial();
        if self.settle > 0 {
            self.settle -= 1;
            return None;
        }
        if self.recent.len() == UP_WINDOW {
            self.recent.pop_front();
        }
        self.recent.push_back(update_ms);
        self.step_down().or_else(|| self.step_up())
    }

    /// Whether even the fastest rung takes too long.
    pub fn exhausted(&self) -> bool {
        self.rung + 1 == self.predicted_ms.len() && self.too_slow().is_some()
    }

    fn count_trial(&mut self) {
        self.trial = match self.trial {
            Some(frames) if frames >= TRIAL => {
                self.cool_down = (self.cool_down / 2).max(COOL_DOWN);
                None
            }
            trial => trial.map(|frames| frames + 1),
        };
    }

    /// The median of the newest frames, where it exceeds the budget.
    fn too_slow(&self) -> Option<f64> {
        if self.recent.len() < DOWN_FEWEST {
            return None;
        }
        let newest = self.recent.iter().rev().take(DOWN_WINDOW).copied();
        median(newest).filter(|&ms| ms > self.budget_ms)
    }

    fn step_down(&mut self) -> Option<Change> {
        let median_ms = self.too_slow()?;
        let last = self.predicted_ms.len() - 1;
        if self.rung == last {
            return None;
        }
        let fits = |&rung: &usize| self.expected_ms(rung, median_ms) <= FITS * self.budget_ms;
        let to = (self.rung + 1..last).find(fits).unwrap_or(last);
        if self.trial.is_some() {
            self.cool_down = (2 * self.cool_down).min(LONGEST_COOL_DOWN);
        }
        self.trial = None;
        self.wait = self.cool_down;
        Some(self.change(to, median_ms))
    }

    fn step_up(&mut self) -> Option<Change> {
        if self.wait > 0 || self.recent.len() < UP_WINDOW {
            return None;
        }
        let median_ms = median(self.recent.iter().copied())?;
        let limit = FITS_BETTER * self.budget_ms;
        let to = (0..self.rung).find(|&rung| self.expected_ms(rung, median_ms) <= limit)?;
        self.trial = Some(0);
        Some(self.change(to, median_ms))
    }

    /// Time on another rung, if this one takes `median_ms`.
    fn expected_ms(&self, rung: usize, median_ms: f64) -> f64 {
        self.predicted_ms[rung] * median_ms / self.predicted_ms[self.rung]
    }

    fn change(&mut self, to: usize, median_ms: f64) -> Change {
        let from = std::mem::replace(&mut self.rung, to);
        self.recent.clear();
        self.settle = SETTLE;
        Change { from, to, median_ms }
    }
}
