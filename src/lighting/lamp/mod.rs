//! One lamp, near or far, and ambient light: the simplest light that rooms have.
//!
//! A picture says little about high bands of light (a clamped cosine passes a quarter of band 2 and
//! nothing of band 3) and nothing about light from where no surface faces; and a lamp a few metres away
//! lights the near end of a table twice as much as the far end, which light from infinity can only explain
//! by a wrong direction. A lamp with a place has five unknowns and explains both.
//!
//! The seen light of a surface point x is `ambient T_0 sqrt(4 pi) + irradiance T.Y(u) D^2 / r^2`, where u
//! and r are direction and distance of the lamp from x, and D its distance from the centre of what is seen.

mod arrival;
mod candidate;
mod climb;
mod search;
mod sensitivity;
mod sums;

#[cfg(test)]
mod tests;

use super::bank::{Bank, Batch, LANES};
use crate::math::sh;
use arrival::{Arrival, NEAREST, irradiances};
use glam::Vec3;
use search::Search;
use std::f32::consts::PI;
use sums::sums;

pub use sensitivity::{AMOUNTS, Sensitivity};
pub use sums::RIDGE;

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lamp {
    /// World axes, metres.
    Near { position: Vec3 },
    /// Unit vector.
    Far { towards: Vec3 },
}

/// Weights of the fit, a row a packet: `w a^2` and `w a I` for each plane of I.
pub struct Design<'a> {
    pub bank: &'a Bank,
    pub gram: &'a [[f32; LANES]],
    pub seen: &'a [[f32; LANES]],
}

/// What is known of the lamp when it is searched.
#[derive(Clone, Copy, Debug)]
pub struct LastLamp {
    pub lamp: Lamp,
    /// Part of all other places is looked at, by this number another.
    pub turn: usize,
    /// It was found in earlier frames, and noise must not move it.
    pub held: bool,
}

/// The lamp that explains a bank best, and how much of it.
#[derive(Clone, Debug, PartialEq)]
pub struct LampField {
    pub lamp: Lamp,
    pub centre: Vec3,
    /// `(ambient radiance, irradiance at the centre of a surface that faces the lamp)` a channel.
    pub channels: Vec<(f64, f64)>,
}

impl LampField {
    /// The best lamp in the least-squares sense; with `near` false, at infinity. Without a `last` one it is
    /// searched everywhere among part of the samples and refined among all. Else it is followed from there.
    ///
    /// `None` with less than two bands, or where nothing is seen that a lamp could explain.
    pub fn search(design: &Design, near: bool, last: Option<&LastLamp>) -> Option<Self> {
        let n = design.bank.coefficients();
        if n < 4 {
            return None;
        }
        let (centre, extent_m) = design.bank.centre_and_extent_m();
        let search = Search { design, centre, extent_m, near: near && extent_m > 0.0 };
        let (gain, best) = match last {
            None => search.everywhere()?,
            Some(last) => search.follow(last.lamp.seen_from(centre), last),
        };
        (gain > 0.0).then(|| Self { lamp: best.lamp(centre), centre, channels: Vec::new() })
    }

    /// Finds the amounts for each channel, given its plane of `w a I`.
    pub fn measure(&mut self, design: &Design, channels: &[Vec<[f32; LANES]>]) {
        let arrival = [self.arrival(design.bank.coefficients())];
        let amounts = |seen: &Vec<_>| sums(design, seen, &arrival, 1)[0].amounts();
        self.channels = channels.iter().map(amounts).collect();
    }

    fn arrival(&self, coefficients: usize) -> Arrival {
        Arrival::new(self.centre, self.lamp.seen_from(self.centre), coefficients)
    }

    /// What each channel shows of a packet at unit albedo.
    pub fn shade(
        &self,
        coefficients: usize,
        batch: &Batch,
        mut out: impl FnMut(usize, usize, [f32; LANES]),
    ) {
        let arrival = self.arrival(coefficients);
        let unit = (4.0 * PI).sqrt();
        let mut lamps = vec![[0.0; LANES]; batch.packets.len()];
        irradiances(&arrival, batch, 1, &mut lamps);
        for (k, lamp) in lamps.iter().enumerate() {
            let open = &batch.transfer[k * coefficients];
            for (c, &(ambient, irradiance)) in self.channels.iter().enumerate() {
                let (ambient, irradiance) = (ambient as f32 * unit, irradiance as f32);
                let shade = |i: usize| ambient * open[i] + irradiance * lamp[i];
                out(c, k, std::array::from_fn(shade));
            }
        }
    }

    /// Its light at a point, a vector of coefficients a channel.
    pub fn light_at(&self, point: Vec3, coefficients: usize) -> Vec<Vec<f64>> {
        let there = self.lamp.seen_from(point);
        let from_centre = self.lamp.seen_from(self.centre);
        let falloff = match (from_centre.distance_m(), there.distance_m()) {
            (Some(from_centre), Some(distance)) => {
                f64::from(from_centre / distance.max(NEAREST * from_centre)).powi(2)
            }
            _ => 1.0,
        };
        let basis = sh::basis(there.towards, coefficients.isqrt());
        let light = |&(ambient, irradiance): &(f64, f64)| {
            let lamp = |y: &f32| irradiance * falloff * f64::from(*y);
            let mut light: Vec<f64> = basis[..coefficients].iter().map(lamp).collect();
            light[0] += ambient * f64::from(4.0 * PI).sqrt();
            light
        };
        self.channels.iter().map(light).collect()
    }
}
