//! How the light of a lamp changes with its parameters.

use super::LampField;
use super::arrival::{Arrival, irradiances};
use super::candidate::Candidate;
use crate::lighting::bank::{Batch, LANES};
use glam::Vec3;
use std::f32::consts::PI;

/// Half width of the differences that derivatives are taken from, in radians and in parallax.
const STEP: f32 = 0.01;

/// Where nothing is seen of it: the standard deviation of an angle, in radians, and of the parallax.
const UNKNOWN_ANGLE: f64 = 1.0;
const UNKNOWN_PARALLAX: f64 = 0.5;

/// Two places to either side of the lamp's, and how far they are apart in radians or in parallax.
struct Aside {
    less: Candidate,
    more: Candidate,
    apart: f64,
    unknown: f64,
}

/// Derivatives by the lamp's parameters: ambient radiance, irradiance, two angles and, where it may be near,
/// parallax (the share of its distance that the samples extend over).
pub struct Sensitivity<'a> {
    field: &'a LampField,
    /// Luminance of ambient radiance and irradiance.
    ambient: f64,
    irradiance: f64,
    asides: Vec<Aside>,
}

/// Parameters that are amounts of light; they come first.
pub const AMOUNTS: usize = 2;

impl<'a> Sensitivity<'a> {
    /// `extent_m` is that of the samples, where the lamp may be near.
    pub fn new(
        field: &'a LampField,
        (ambient, irradiance): (f64, f64),
        extent_m: Option<f32>,
    ) -> Self {
        let here = field.lamp.seen_from(field.centre);
        let turned = |by: [f32; 2]| here.moved(by, 0.0);
        let mut asides: Vec<Aside> = [[STEP, 0.0], [0.0, STEP]]
            .map(|by| Aside {
                less: turned(by.map(|v| -v)),
                more: turned(by),
                apart: f64::from(2.0 * STEP),
                unknown: UNKNOWN_ANGLE,
            })
            .into();
        if let Some(extent_m) = extent_m {
            let at = |nearness_per_m: f32| Candidate { nearness_per_m, ..here };
            // none is farther than infinity
            let less = at((here.nearness_per_m - STEP / extent_m).max(0.0));
            let more = at(here.nearness_per_m + STEP / extent_m);
            let apart = f64::from((more.nearness_per_m - less.nearness_per_m) * extent_m);
            asides.push(Aside { less, more, apart, unknown: UNKNOWN_PARALLAX });
        }
        Self { field, ambient, irradiance, asides }
    }

    pub fn parameters(&self) -> usize {
        AMOUNTS + self.asides.len()
    }

    /// Variance of each parameter before anything is seen. Amounts are of the size of all light.
    pub fn unknown(&self) -> impl Iterator<Item = f64> {
        let radiance = self.ambient + self.irradiance / std::f64::consts::PI;
        let amounts = [radiance, std::f64::consts::PI * radiance];
        amounts.into_iter().chain(self.asides.iter().map(|aside| aside.unknown)).map(|v| v * v)
    }

    /// Of the light at a point: a vector of coefficients a parameter.
    pub fn of_light(&self, point: Vec3, coefficients: usize) -> Vec<Vec<f64>> {
        let light = |candidate: Candidate, amounts: (f64, f64)| {
            let (lamp, centre) = (candidate.lamp(self.field.centre), self.field.centre);
            let there = LampField { lamp, centre, channels: vec![amounts] };
            there.light_at(point, coefficients).swap_remove(0)
        };
        let here = self.field.lamp.seen_from(self.field.centre);
        let mut out = vec![light(here, (1.0, 0.0)), light(here, (0.0, 1.0))];
        out.extend(self.asides.iter().map(|aside| {
            let amounts = (0.0, self.irradiance / aside.apart);
            let pairs = light(aside.more, amounts).into_iter().zip(light(aside.less, amounts));
            pairs.map(|(more, less)| more - less).collect()
        }));
        out
    }

    /// Of what every `every`-th packet shows at unit albedo: a row a packet, by parameter.
    pub fn of_samples(
        &self,
        batch: &Batch,
        coefficients: usize,
        every: usize,
    ) -> Vec<Vec<[f32; LANES]>> {
        let lit_by = |candidate: Candidate| {
            let arrival = Arrival::new(self.field.centre, candidate, coefficients);
            let mut out = vec![[0.0; LANES]; batch.packets.len().div_ceil(every)];
            irradiances(&arrival, batch, every, &mut out);
            out
        };
        let unit = (4.0 * PI).sqrt();
        let open = batch.transfer.iter().step_by(coefficients * every);
        let ambient = open.map(|row| row.map(|t| unit * t)).collect();
        let mut out = vec![ambient, lit_by(self.field.lamp.seen_from(self.field.centre))];
        out.extend(self.asides.iter().map(|aside| {
            let scale = (self.irradiance / aside.apart) as f32;
            let pairs = lit_by(aside.more).into_iter().zip(lit_by(aside.less));
            let rows = pairs.map(|(a, b)| std::array::from_fn(|i| scale * (a[i] - b[i])));
            rows.collect()
        }));
        out
    }
}
