//! Places that a lamp may have.

use super::Lamp;
use glam::Vec3;

/// A lamp seen from the centre of the samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Candidate {
    pub towards: Vec3,
    /// Inverse distance; 0: infinitely far. Light changes evenly with it, and smoothly as a lamp comes from
    /// infinity.
    pub nearness_per_m: f32,
}

impl Lamp {
    pub(super) fn seen_from(&self, centre: Vec3) -> Candidate {
        match *self {
            Lamp::Far { towards } => Candidate { towards, nearness_per_m: 0.0 },
            Lamp::Near { position } => {
                let towards = position - centre;
                match towards.try_normalize() {
                    Some(unit) => {
                        Candidate { towards: unit, nearness_per_m: 1.0 / towards.length() }
                    }
                    None => Candidate { towards: Vec3::Z, nearness_per_m: 0.0 },
                }
            }
        }
    }
}

impl Candidate {
    pub fn lamp(&self, centre: Vec3) -> Lamp {
        match self.distance_m() {
            Some(distance) => Lamp::Near { position: centre + distance * self.towards },
            None => Lamp::Far { towards: self.towards },
        }
    }

    /// None where it is infinitely far.
    pub fn distance_m(&self) -> Option<f32> {
        let distance = 1.0 / self.nearness_per_m;
        (self.nearness_per_m > 0.0 && distance.is_finite()).then_some(distance)
    }

    /// Turned by two small angles, in radians, and brought nearer.
    pub fn moved(self, [right, up]: [f32; 2], nearer_per_m: f32) -> Self {
        let (x, y) = self.towards.any_orthonormal_pair();
        Self {
            towards: (self.towards + right * x + up * y).normalize(),
            nearness_per_m: self.nearness_per_m + nearer_per_m,
        }
    }
}
