//! Least squares of the two unknowns of a given lamp: its irradiance, and ambient light.

use super::Design;
use super::arrival::{Arrival, with_bands};
use crate::lighting::bank::{Batch, LANES};
use crate::lighting::solve::non_negative_pair;
use std::f32::consts::PI;

/// Added to the diagonal, relative: where ambient light and lamp explain the same, the weaker of both.
pub const RIDGE: f64 = 0.02;

/// What a bank shows, for a lamp at given albedos: the sums of a least-squares fit of two unknowns.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sums {
    ambient_ambient: f64,
    ambient_lamp: f64,
    lamp_lamp: f64,
    ambient_seen: f64,
    lamp_seen: f64,
}

impl Sums {
    fn add(&mut self, other: Self) {
        self.ambient_ambient += other.ambient_ambient;
        self.ambient_lamp += other.ambient_lamp;
        self.lamp_lamp += other.lamp_lamp;
        self.ambient_seen += other.ambient_seen;
        self.lamp_seen += other.lamp_seen;
    }

    pub fn amounts(&self) -> (f64, f64) {
        let with_ridge = |v: f64| (1.0 + RIDGE) * v;
        non_negative_pair(
            [with_ridge(self.ambient_ambient), self.ambient_lamp, with_ridge(self.lamp_lamp)],
            [self.ambient_seen, self.lamp_seen],
        )
    }

    /// What the fit takes off the squared residual.
    pub fn gain(&self) -> f64 {
        let (a, l) = self.amounts();
        let quadratic = (1.0 + RIDGE) * (self.ambient_ambient * a * a + self.lamp_lamp * l * l)
            + 2.0 * self.ambient_lamp * a * l;
        2.0 * (self.ambient_seen * a + self.lamp_seen * l) - quadratic
    }
}

/// Sums over every `every`-th packet of the bank for each of several lamps, in the order of the batches.
/// All lamps are asked of one batch before the next: it stays in the cache.
pub(super) fn sums(
    design: &Design,
    seen: &[[f32; LANES]],
    arrivals: &[Arrival],
    every: usize,
) -> Vec<Sums> {
    let mut totals = vec![Sums::default(); arrivals.len()];
    let mut first = 0;
    for batch in design.bank.batches() {
        let range = first..first + batch.packets.len();
        first = range.end;
        let planes = Planes { gram: &design.gram[range.clone()], seen: &seen[range] };
        for (total, arrival) in totals.iter_mut().zip(arrivals) {
            total.add(with_bands!(arrival.bands(), sums_of(arrival, batch, planes, every)));
        }
    }
    totals
}

/// Weights of the fit of one batch, a row a packet.
#[derive(Clone, Copy)]
struct Planes<'a> {
    gram: &'a [[f32; LANES]],
    seen: &'a [[f32; LANES]],
}

fn sums_of<const BANDS: usize>(
    arrival: &Arrival,
    batch: &Batch,
    planes: Planes,
    every: usize,
) -> Sums {
    #[multiversion::multiversion(targets(
        "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
        "x86_64+avx2+fma+bmi2"
    ))]
    fn dispatch<const BANDS: usize>(
        arrival: &Arrival,
        batch: &Batch,
        planes: Planes,
        every: usize,
    ) -> Sums {
        sums_body::<BANDS>(arrival, batch, planes, every)
    }
    dispatch::<BANDS>(arrival, batch, planes, every)
}

#[inline(always)]
fn sums_body<const BANDS: usize>(
    arrival: &Arrival,
    batch: &Batch,
    Planes { gram, seen }: Planes,
    every: usize,
) -> Sums {
    let unit = (4.0 * PI).sqrt();
    let mut lanes = [[0.0f32; LANES]; 5];
    let transfers = batch.transfer.chunks_exact(BANDS * BANDS);
    let rows = batch.packets.iter().zip(transfers).zip(gram.iter().zip(seen));
    for ((packet, transfer), (gram, seen)) in rows.step_by(every) {
        let lamp = arrival.irradiance::<BANDS>(&packet.position, transfer);
        for i in 0..LANES {
            let ambient = unit * transfer[0][i];
            lanes[0][i] += gram[i] * ambient * ambient;
            lanes[1][i] += gram[i] * ambient * lamp[i];
            lanes[2][i] += gram[i] * lamp[i] * lamp[i];
            lanes[3][i] += seen[i] * ambient;
            lanes[4][i] += seen[i] * lamp[i];
        }
    }
    let total = |k: usize| lanes[k].iter().map(|&v| f64::from(v)).sum::<f64>();
    Sums {
        ambient_ambient: total(0),
        ambient_lamp: total(1),
        lamp_lamp: total(2),
        ambient_seen: total(3),
        lamp_seen: total(4),
    }
}
