//! How far the light may be off, coefficient by coefficient.
//!
//! Samples show `I = T rest + J theta + noise`: theta are the lamp's parameters, J what they change, rest is all
//! light beside the lamp. The lamp is found first, then the rest on what it leaves over. Near the solution both are
//! linear in that, r:
//!
//! ```text
//! d_theta = G J'W r                   G = (J'WJ + R)^-1, R the lamp's own prior
//! d_rest  = H T'W (r - J d_theta)     H = (T'WT + P)^-1
//! ```
//!
//! With r = T rest + noise, and light at a place that changes by L with theta, the error of the light is
//!
//! ```text
//! e = K [T J]'W noise + (K [T J]'W T - 1) rest,    K = [H, (L - H T'WJ) G]
//! ```
//!
//! noise first, then what regularisation keeps back of the rest and what the lamp takes of it. The rest is
//! believed to be of the size that it has where it is seen; to the extent that little of it is seen, of the usual
//! size of a coefficient. What no sample tells of the lamp is unknown.

use super::Fit;
use crate::lighting::LightPrior;
use crate::lighting::bank::{Bank, LANES};
use crate::lighting::lamp::{AMOUNTS, RIDGE, Sensitivity};
use crate::lighting::solve::{Penalty, Solution, pseudo_inverse};
use crate::lighting::{LightParams, ShLight};
use glam::Vec3;
use nalgebra::{DMatrix, DVector};

/// Second moments are taken of this many packets at most.
const PACKETS: usize = 48;

/// The usual size of a coefficient counts as much as the rest's size in so many independent directions.
const USUAL: f64 = 1.0;

/// What a solution's deviations depend on.
pub struct Deviating<'a> {
    pub bank: &'a Bank,
    pub params: &'a LightParams,
    pub solution: &'a Solution,
    /// The light at the point `at`; without one, in the middle of the samples.
    pub light: &'a ShLight,
    pub at: Option<Vec3>,
    /// Variance of a sample that the model explains.
    pub noise: f64,
}

/// Sums of `w d d'` and `(w / robust)^2 d d'` of design rows d = [T J].
struct Moments {
    gram: DMatrix<f64>,
    squares: DMatrix<f64>,
}

impl Fit {
    /// Standard deviation of each coefficient of the light's luminance.
    pub fn deviation(&self, of: &Deviating) -> Vec<f32> {
        let n = of.bank.coefficients();
        let sensitivity = self.sensitivity(of);
        let Moments { gram, squares } = self.moments(of.bank, sensitivity.as_ref());
        let m = gram.nrows() - n;
        let (t_j, j_j) = (gram.view((0, n), (n, m)), gram.view((n, n), (m, m)));
        let seen = DMatrix::from_row_slice(n, n, &self.equations().gram);
        let inverse = &of.solution.inverse;

        let unknown: Vec<f64> = sensitivity.iter().flat_map(|s| s.unknown()).collect();
        let prior = DMatrix::from_fn(m, m, |r, c| match r == c {
            true => {
                of.noise / unknown[r].max(f64::MIN_POSITIVE)
                    + if r < AMOUNTS { RIDGE * j_j[(r, r)] } else { 0.0 }
            }
            false => 0.0,
        });
        let of_lamp = pseudo_inverse(j_j + &prior);
        let changes = self.light_by_lamp(of, sensitivity.as_ref());

        // the lamp's part in the rest, and in all light
        let in_rest = -(inverse * t_j);
        let in_light = &changes + &in_rest;
        let columns = |lamp: &DMatrix<f64>| {
            let mut all = inverse.clone().resize_horizontally(n + m, 0.0);
            all.view_mut((0, n), (n, m)).copy_from(&(lamp * &of_lamp));
            all
        };
        let (of_rest, of_light) = (columns(&in_rest), columns(&in_light));
        let mut shown = seen.clone().resize_vertically(n + m, 0.0);
        shown.view_mut((n, 0), (m, n)).copy_from(&t_j.transpose());

        let by_band = DVector::from_vec(Penalty::weights(n, of.params)).map(|w| 1.0 / w);
        let noise = of.noise * (&seen * &of_rest * &squares * of_rest.transpose()).trace();
        let size = self.size_of_rest(&seen, &(of_rest * &shown), noise, &by_band, of.light);
        let mut sizes = by_band * size;
        // all light is positive: its mean may be far above what its parts differ by
        sizes[0] = sizes[0].max(f64::from(self.rest[0]).powi(2));
        let missed = &of_light * &shown - DMatrix::identity(n, n);
        let open = in_light * &of_lamp * &prior;
        (0..n)
            .map(|i| {
                let noise = (of_light.row(i) * &squares * of_light.row(i).transpose())[0];
                let rest: f64 = missed.row(i).iter().zip(&sizes).map(|(b, s)| b * b * s).sum();
                let lamp: f64 = open.row(i).iter().zip(&unknown).map(|(c, v)| c * c * v).sum();
                (of.noise * noise + rest + lamp).max(0.0).sqrt() as f32
            })
            .collect()
    }

    fn sensitivity<'a>(&'a self, of: &Deviating) -> Option<Sensitivity<'a>> {
        let field = self.field.as_ref()?;
        let weights = super::channel_weights(field.channels.len());
        let parts = field.channels.iter().zip(weights);
        let luminance = parts.fold((0.0, 0.0), |(a, b), (&(ambient, irradiance), w)| {
            (a + f64::from(w) * ambient, b + f64::from(w) * irradiance)
        });
        let (_, extent_m) = of.bank.centre_and_extent_m();
        let near = of.params.prior == LightPrior::NearLamp && extent_m > 0.0;
        Some(Sensitivity::new(field, luminance, near.then_some(extent_m)))
    }

    /// Of part of the packets, scaled to all.
    fn moments(&self, bank: &Bank, sensitivity: Option<&Sensitivity>) -> Moments {
        let n = bank.coefficients();
        let d = n + sensitivity.map_or(0, Sensitivity::parameters);
        let packets: usize = bank.batches().map(|batch| batch.packets.len()).sum();
        let every = packets.div_ceil(PACKETS).max(1);
        // columns of the lower triangles
        let (mut gram, mut squares) = (vec![0.0; d * d], vec![0.0; d * d]);
        let (mut row, mut weight) = (vec![0.0; d], 0.0);
        for batch in bank.batches() {
            let by_lamp = sensitivity.map(|s| s.of_samples(batch, n, every)).unwrap_or_default();
            for (k, packet) in batch.packets.iter().step_by(every).enumerate() {
                let transfer = &batch.transfer[k * every * n..][..n];
                let albedo = self.albedos.of(&packet.class);
                for i in (0..LANES).filter(|&i| packet.weight[i] > 0.0) {
                    let values = transfer.iter().chain(by_lamp.iter().map(|rows| &rows[k]));
                    for (row, value) in row.iter_mut().zip(values) {
                        *row = f64::from(albedo[i] * value[i]);
                    }
                    let w = f64::from(packet.weight[i]);
                    let whole = f64::from(packet.weight[i] / packet.robust[i]);
                    weight += w;
                    for c in 0..d {
                        let (a, b) = (w * row[c], whole * whole * row[c]);
                        let column = c * d + c..(c + 1) * d;
                        let sums = gram[column.clone()].iter_mut().zip(&mut squares[column]);
                        for ((gram, squares), value) in sums.zip(&row[c..]) {
                            *gram += a * value;
                            *squares += b * value;
                        }
                    }
                }
            }
        }
        let scale = if weight > 0.0 { self.equations().weight / weight } else { 0.0 };
        let whole = |sums: Vec<f64>| {
            let mut matrix = scale * DMatrix::from_vec(d, d, sums);
            matrix.fill_upper_triangle_with_lower_triangle();
            matrix
        };
        Moments { gram: whole(gram), squares: whole(squares) }
    }

    /// L: what the lamp's parameters change in the light at the point.
    fn light_by_lamp(&self, of: &Deviating, sensitivity: Option<&Sensitivity>) -> DMatrix<f64> {
        let n = of.bank.coefficients();
        let (Some(field), Some(sensitivity)) = (&self.field, sensitivity) else {
            return DMatrix::zeros(n, 0);
        };
        let columns = sensitivity.of_light(of.at.unwrap_or(field.centre), n);
        DMatrix::from_fn(n, columns.len(), |r, c| columns[c][r])
    }

    /// Variance of a coefficient of the rest in band 1. `filtered` is the rest that is found of a rest, `noise` the
    /// energy that noise alone shows of one.
    fn size_of_rest(
        &self,
        seen: &DMatrix<f64>,
        filtered: &DMatrix<f64>,
        noise: f64,
        by_band: &DVector<f64>,
        light: &ShLight,
    ) -> f64 {
        let n = by_band.len();
        let luminance = light.luminance();
        let power: f64 = luminance.iter().map(|&l| f64::from(l).powi(2)).sum();
        let usual = power / by_band.sum();
        let rest = DVector::from_fn(n, |i, _| f64::from(self.rest[i]));
        // A rest of variance 1 shows the energy `trace`, in so many independent directions.
        let spread = seen * filtered * DMatrix::from_diagonal(by_band) * filtered.transpose();
        let (trace, squared) = (spread.trace(), (&spread * &spread).trace());
        if !(trace > 0.0 && squared > 0.0) {
            return usual;
        }
        // where a rest of the usual size would drown in noise, nothing is learnt of its size
        let all = trace + noise / usual.max(f64::MIN_POSITIVE);
        let directions = trace * trace / squared * (trace / all);
        // no more than all light: what the lamp's own prior keeps back shows as a rest too
        let found = (rest.dot(&(seen * &rest)) / all).min(usual);
        (USUAL * usual + directions * found) / (USUAL + directions)
    }
}
