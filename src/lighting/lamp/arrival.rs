//! Light of a lamp where it arrives.

use super::candidate::Candidate;
use crate::lighting::bank::{Batch, LANES};
use crate::math::sh;
use glam::Vec3;

/// A lamp is never nearer than this share of its distance from the centre.
pub(super) const NEAREST: f32 = 0.1;

/// Calls a function with the number of bands as a constant, 2 to 6.
macro_rules! with_bands {
    ($bands:expr, $function:ident($($argument:expr),*)) => {
        match $bands {
            2 => $function::<2>($($argument),*),
            3 => $function::<3>($($argument),*),
            4 => $function::<4>($($argument),*),
            5 => $function::<5>($($argument),*),
            _ => $function::<6>($($argument),*),
        }
    };
}
pub(super) use with_bands;

/// The rays of light that surfaces get from a lamp.
pub(super) struct Arrival {
    centre: Vec3,
    candidate: Candidate,
    bands: usize,
}

impl Arrival {
    pub fn new(centre: Vec3, candidate: Candidate, coefficients: usize) -> Self {
        Self { centre, candidate, bands: coefficients.isqrt() }
    }

    pub fn bands(&self) -> usize {
        self.bands
    }

    /// T.Y(u) D^2 / r^2 of a packet with `BANDS * BANDS` rows of transfer. The number of bands is a
    /// constant, so that the basis stays in registers. Lengths are in units of the lamp's distance, which may
    /// be infinite.
    #[inline(always)]
    pub fn irradiance<const BANDS: usize>(
        &self,
        position: &[[f32; LANES]; 3],
        transfer: &[[f32; LANES]],
    ) -> [f32; LANES] {
        let Candidate { towards, nearness_per_m } = self.candidate;
        let mut u = [[0.0; LANES]; 3];
        let mut falloff = [0.0; LANES];
        for i in 0..LANES {
            let aside = |axis: usize| nearness_per_m * (position[axis][i] - self.centre[axis]);
            let v = [0, 1, 2].map(|axis| towards[axis] - aside(axis));
            let r2 = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).max(NEAREST * NEAREST);
            let inverse = 1.0 / r2.sqrt();
            for axis in 0..3 {
                u[axis][i] = v[axis] * inverse;
            }
            falloff[i] = 1.0 / r2;
        }
        let mut basis = [[0.0; LANES]; sh::MAX_COEFFICIENTS];
        sh::basis_lanes(&u, BANDS, &mut basis);
        let mut out = [0.0; LANES];
        for (row, y) in transfer[..BANDS * BANDS].iter().zip(&basis) {
            for i in 0..LANES {
                out[i] += row[i] * y[i];
            }
        }
        for i in 0..LANES {
            out[i] *= falloff[i];
        }
        out
    }
}

/// [`Arrival::irradiance`] of every `every`-th packet of a batch, a row each.
pub(super) fn irradiances(
    arrival: &Arrival,
    batch: &Batch,
    every: usize,
    out: &mut [[f32; LANES]],
) {
    with_bands!(arrival.bands, irradiances_of(arrival, batch, every, out));
}

fn irradiances_of<const BANDS: usize>(
    arrival: &Arrival,
    batch: &Batch,
    every: usize,
    out: &mut [[f32; LANES]],
) {
    #[multiversion::multiversion(targets(
        "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
        "x86_64+avx2+fma+bmi2"
    ))]
    fn dispatch<const BANDS: usize>(
        arrival: &Arrival,
        batch: &Batch,
        every: usize,
        out: &mut [[f32; LANES]],
    ) {
        let transfers = batch.transfer.chunks_exact(BANDS * BANDS);
        let packets = batch.packets.iter().zip(transfers).step_by(every);
        for (out, (packet, transfer)) in out.iter_mut().zip(packets) {
            *out = arrival.irradiance::<BANDS>(&packet.position, transfer);
        }
    }
    dispatch::<BANDS>(arrival, batch, every, out);
}
