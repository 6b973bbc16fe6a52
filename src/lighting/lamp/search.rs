//! The place that explains a bank best: searched everywhere once, then followed from frame to frame.

use super::Design;
use super::arrival::Arrival;
use super::candidate::Candidate;
use super::sums::sums;
use crate::math::fibonacci_sphere;
use glam::Vec3;
use rayon::prelude::*;

/// Directions and distances (in units of the extent of what is seen) of the first search.
const DIRECTIONS: usize = 200;
const DISTANCES: [f32; 6] = [1.6, 2.4, 3.6, 5.2, 8.0, 14.0];

/// The first search looks at this many packets at most.
const SEARCH_PACKETS: usize = 96;

/// Where a lamp is known, every n-th direction is looked at again in each frame, others in the next.
pub(super) const TURNS: usize = 8;

/// Part of the samples must speak for another place by this much before all are asked.
const CLEARLY_BETTER: f64 = 1.01;

/// A known lamp moves where that explains this share of the picture more: places and distances that explain
/// the same lie in a long valley, along which noise alone would carry it.
const REASON_TO_MOVE: f64 = 5e-4;

/// Steps around a place, in radians and in the logarithm of the distance, from about half the spacing of the
/// first search down to 0.07 degrees.
const COLD_STEPS: [f32; 5] = [0.25, 0.15, 0.09, 0.06, 0.04];
const WARM_STEPS: [f32; 6] = [0.04, 0.02, 0.01, 0.005, 0.0025, 0.00125];

/// A lamp this many extents away is as good as infinitely far.
const FAR: f32 = 30.0;

pub(super) struct Search<'a> {
    pub design: &'a Design<'a>,
    pub centre: Vec3,
    pub extent_m: f32,
    pub near: bool,
}

impl Search<'_> {
    /// The best place of all; none where no lamp explains anything.
    pub fn everywhere(&self) -> Option<(f64, Candidate)> {
        Some(self.descend(self.coarse(0, 1)?.1))
    }

    /// The best place near the last one, unless another is clearly better.
    pub fn follow(&self, last: Candidate, turn: usize) -> (f64, Candidate) {
        let last = if self.near { last } else { Candidate { distance_m: None, ..last } };
        let here = self.refine(last, &WARM_STEPS, REASON_TO_MOVE);
        let part = self.best_of(&[here.1], self.part()).map_or(0.0, |(gain, _)| gain);
        match self.coarse(turn % TURNS, TURNS) {
            Some((gain, other)) if gain > CLEARLY_BETTER * part => {
                let there = self.descend(other);
                if there.0 > CLEARLY_BETTER * here.0 { there } else { here }
            }
            _ => here,
        }
    }

    /// Every n-th packet makes up the part of the samples that many places are tried on.
    fn part(&self) -> usize {
        let packets: usize = self.design.bank.batches().map(|b| b.packets.len()).sum();
        packets.div_ceil(SEARCH_PACKETS).max(1)
    }

    /// The best of many directions, `first` and every `every`-th after it, at several distances.
    fn coarse(&self, first: usize, every: usize) -> Option<(f64, Candidate)> {
        let mut distances = vec![None];
        if self.near {
            distances.extend(DISTANCES.map(|d| Some(d * self.extent_m)));
        }
        let candidates: Vec<Candidate> = fibonacci_sphere(DIRECTIONS)
            .into_iter()
            .skip(first)
            .step_by(every)
            .flat_map(|towards| {
                distances.iter().map(move |&distance_m| Candidate { towards, distance_m })
            })
            .collect();
        self.best_of(&candidates, self.part())
    }

    fn descend(&self, start: Candidate) -> (f64, Candidate) {
        self.refine(self.refine(start, &COLD_STEPS, 0.0).1, &WARM_STEPS, 0.0)
    }

    fn refine(&self, start: Candidate, steps: &[f32], reason: f64) -> (f64, Candidate) {
        let mut best = self.best_of(&[start], 1).unwrap_or((0.0, start));
        for &step in steps {
            let mut around = best.1.neighbours(step, FAR * self.extent_m);
            around.retain(|c| self.near || c.distance_m.is_none());
            if let Some(better) = self.best_of(&around, 1).filter(|b| b.0 > (1.0 + reason) * best.0)
            {
                best = better;
            }
        }
        best
    }

    /// The candidate of the largest gain, the first of equals; none where all gain nothing.
    fn best_of(&self, candidates: &[Candidate], every: usize) -> Option<(f64, Candidate)> {
        let n = self.design.bank.coefficients();
        let arrivals: Vec<Arrival> =
            candidates.iter().map(|&candidate| Arrival::new(self.centre, candidate, n)).collect();
        let share = candidates.len().div_ceil(rayon::current_num_threads()).max(1);
        let gains: Vec<f64> = arrivals
            .par_chunks(share)
            .flat_map_iter(|part| sums(self.design, self.design.seen, part, every))
            .map(|sums| sums.gain())
            .collect();
        let mut best = None;
        for (&gain, &candidate) in gains.iter().zip(candidates) {
            if gain > best.map_or(0.0, |(most, _)| most) {
                best = Some((gain, candidate));
            }
        }
        best
    }
}
