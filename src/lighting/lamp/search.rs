//! The place that explains a bank best: searched everywhere once, then followed from frame to frame.

use super::arrival::Arrival;
use super::candidate::Candidate;
use super::sums::sums;
use super::{Design, LastLamp};
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

/// A known lamp is held where it was by this share of the gain per square radian and remembered frame: places and
/// distances that explain the same lie in a long valley, along which noise alone would carry it. Among 0 to 8 for all
/// frames together, this kept the error of the first frames and halved the unrest of later ones.
const PULL_OF_A_FRAME: f64 = 0.5;

pub(super) struct Search<'a> {
    pub design: &'a Design<'a>,
    pub centre: Vec3,
    pub extent_m: f32,
    pub near: bool,
}

impl Search<'_> {
    /// The best place of all; none where no lamp explains anything.
    pub fn everywhere(&self) -> Option<(f64, Candidate)> {
        Some(self.climb(self.coarse(0, 1)?.1))
    }

    /// The best place near the last one, unless another is clearly better.
    pub fn follow(&self, last: Candidate, known: &LastLamp) -> (f64, Candidate) {
        let last = if self.near { last } else { Candidate { nearness_per_m: 0.0, ..last } };
        let here = match known.held {
            true => {
                let frames = self.design.bank.batches().count();
                self.drift(last, PULL_OF_A_FRAME * frames as f64)
            }
            false => self.climb(last),
        };
        let part = self.gains(&[here.1], self.part())[0];
        match self.coarse(known.turn % TURNS, TURNS) {
            Some((gain, other)) if gain > CLEARLY_BETTER * part => {
                let there = self.climb(other);
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
        let mut nearnesses = vec![0.0];
        if self.near {
            nearnesses.extend(DISTANCES.map(|d| 1.0 / (d * self.extent_m)));
        }
        let candidates: Vec<Candidate> = fibonacci_sphere(DIRECTIONS)
            .into_iter()
            .skip(first)
            .step_by(every)
            .flat_map(|towards| {
                nearnesses.iter().map(move |&nearness_per_m| Candidate { towards, nearness_per_m })
            })
            .collect();
        self.best_of(&candidates, self.part())
    }

    /// The candidate of the largest gain, the first of equals; none where all gain nothing.
    fn best_of(&self, candidates: &[Candidate], every: usize) -> Option<(f64, Candidate)> {
        let gains = self.gains(candidates, every);
        let mut best = None;
        for (&gain, &candidate) in gains.iter().zip(candidates) {
            if gain > best.map_or(0.0, |(most, _)| most) {
                best = Some((gain, candidate));
            }
        }
        best
    }

    /// Of every `every`-th packet.
    pub(super) fn gains(&self, candidates: &[Candidate], every: usize) -> Vec<f64> {
        let n = self.design.bank.coefficients();
        let arrivals: Vec<Arrival> =
            candidates.iter().map(|&candidate| Arrival::new(self.centre, candidate, n)).collect();
        let share = candidates.len().div_ceil(rayon::current_num_threads()).max(1);
        arrivals
            .par_chunks(share)
            .flat_map_iter(|part| sums(self.design, self.design.seen, part, every))
            .map(|sums| sums.gain())
            .collect()
    }
}
