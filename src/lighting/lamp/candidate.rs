//! Places that a lamp may have.

use super::Lamp;
use glam::Vec3;
use std::f32::consts::TAU;

/// Sides that a place is turned to.
const AROUND: usize = 6;

/// A lamp seen from the centre of the samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Candidate {
    pub towards: Vec3,
    /// None: infinitely far.
    pub distance_m: Option<f32>,
}

impl Lamp {
    pub(super) fn seen_from(&self, centre: Vec3) -> Candidate {
        match *self {
            Lamp::Far { towards } => Candidate { towards, distance_m: None },
            Lamp::Near { position } => {
                let (towards, distance) = ((position - centre), position.distance(centre));
                match towards.try_normalize() {
                    Some(towards) => Candidate { towards, distance_m: Some(distance) },
                    None => Candidate { towards: Vec3::Z, distance_m: None },
                }
            }
        }
    }
}

impl Candidate {
    pub fn lamp(&self, centre: Vec3) -> Lamp {
        match self.distance_m {
            Some(distance) => Lamp::Near { position: centre + distance * self.towards },
            None => Lamp::Far { towards: self.towards },
        }
    }

    /// Turned by `step` radians towards each of several sides, and nearer and farther by that share.
    pub fn neighbours(self, step: f32, farthest_m: f32) -> Vec<Self> {
        let (x, y) = self.towards.any_orthonormal_pair();
        let around = (0..AROUND).map(|k| {
            let (sin, cos) = (TAU * k as f32 / AROUND as f32).sin_cos();
            (self.towards + step * (cos * x + sin * y)).normalize()
        });
        let turned = around.map(|towards| Self { towards, ..self });
        let moved = match self.distance_m {
            Some(d) => {
                let more = d * step.exp();
                [Some(d * (-step).exp()), (more < farthest_m).then_some(more)]
            }
            None => [None, Some(0.5 * farthest_m)],
        };
        turned.chain(moved.map(|distance_m| Self { distance_m, ..self })).collect()
    }
}
