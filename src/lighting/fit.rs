//! The light that explains a bank of samples: lamp, albedo of each class, and what least squares adds.

mod deviation;

use super::albedo::Albedos;
use super::bank::{Bank, Batch, LANES};
use super::field::LightField;
use super::lamp::{Design, LampField, LastLamp};
use super::normal_equations::{NormalEquations, padded};
use super::solve::{Penalty, Solution, solve};
use super::{LightChannels, LightParams, LightPrior, ShLight};
use crate::math::color::luminance;
pub use deviation::Deviating;

/// Rounds of lamp, albedo and robust weights: for a first fit, and from one frame to the next.
const FIRST_ROUNDS: usize = 5;
const ROUNDS: usize = 1;

/// The middle residual is taken over every n-th packet.
const MIDDLE_STRIDE: usize = 2;

/// How well a batch is explained.
#[derive(Clone, Copy, Debug, Default)]
pub struct Residual {
    pub squares: f64,
    pub energy: f64,
    /// Squares of what robust weights leave of each.
    limited: f64,
    samples: f64,
    /// Samples that robust weights leave whole.
    whole: f64,
}

impl Residual {
    /// Root mean square relative to that of the picture.
    pub fn relative(&self) -> f64 {
        if self.energy > 0.0 { (self.squares / self.energy).max(0.0).sqrt() } else { 0.0 }
    }

    /// Variance of a sample, as it enters a robust fit of so many coefficients (Huber 1981): residuals
    /// are limited, and those that are do not pull any more.
    pub fn noise(&self, rank: usize) -> f64 {
        let freedom = (self.samples - rank as f64).max(1.0);
        let whole = (self.whole / self.samples.max(1.0)).max(1.0 / self.samples.max(1.0));
        self.limited / freedom / (whole * whole)
    }
}

/// I = albedo (lamp and ambient light + T.rest).
#[derive(Clone, Debug, Default)]
pub struct Fit {
    field: Option<LampField>,
    albedos: Albedos,
    /// Of the last solution: the light that the lamp leaves over, in luminance.
    rest: Vec<f32>,
    /// Searches so far.
    turn: usize,
    scratch: Scratch,
}

#[derive(Clone, Debug, Default)]
struct Scratch {
    gram: Vec<[f32; LANES]>,
    seen: Vec<[f32; LANES]>,
    predicted: Vec<[f32; LANES]>,
    channels: Vec<Vec<[f32; LANES]>>,
    median: Vec<f32>,
    rows: Vec<f32>,
    targets: Vec<Vec<f32>>,
    weights: Vec<f32>,
    equations: NormalEquations,
}

impl Fit {
    pub fn forget(&mut self) {
        self.field = None;
        self.albedos = Albedos::default();
        self.rest.clear();
        self.turn = 0;
    }

    /// Explains the bank; leaves its robust weights up to date.
    pub fn explain(&mut self, bank: &mut Bank, params: &LightParams) -> Solution {
        let rounds = if self.rest.is_empty() { FIRST_ROUNDS } else { ROUNDS };
        bank.weigh(params.balance_normals);
        for _ in 0..rounds {
            self.find_lamp(bank, params, rounds < FIRST_ROUNDS);
            let robust = params.huber > 0.0;
            if self.field.is_none() {
                // Without a lamp the residual is that of the light itself.
                if !robust {
                    break;
                }
                self.find_rest(bank, params);
            } else if params.albedo_classes {
                self.predict(bank);
                self.albedos.fit(bank, &self.scratch.predicted);
            }
            if robust {
                self.weigh_residuals(bank, params);
            }
        }
        self.find_rest(bank, params)
    }

    pub fn light_field(&self, solution: &Solution, bands: usize) -> LightField {
        let channels = &solution.light;
        let coefficients = (0..channels[0].len())
            .map(|i| match &channels[..] {
                [r, g, b] => [r[i] as f32, g[i] as f32, b[i] as f32],
                _ => [channels[0][i] as f32; 3],
            })
            .collect();
        LightField { lamp: self.field.clone(), rest: ShLight { bands, coefficients } }
    }

    pub fn equations(&self) -> &NormalEquations {
        &self.scratch.equations
    }

    /// How well a batch is explained, with its robust weights.
    pub fn residual(&self, batch: &Batch, n: usize) -> Residual {
        let mut total = Residual::default();
        self.shade(batch, n, |k, shade| {
            let packet = &batch.packets[k];
            for i in 0..LANES {
                let w = packet.robust[i] * packet.present[i];
                let error = packet.luminance[i] - shade[i];
                total.squares += f64::from(w * error * error);
                total.energy += f64::from(w * packet.luminance[i] * packet.luminance[i]);
                total.limited += f64::from(w * error).powi(2);
                total.samples += f64::from(packet.present[i]);
                total.whole += f64::from(u8::from(w >= 1.0));
            }
        });
        total
    }

    fn find_lamp(&mut self, bank: &Bank, params: &LightParams, held: bool) {
        let near = match params.prior {
            LightPrior::Dark => return,
            LightPrior::DistantLamp => false,
            LightPrior::NearLamp => true,
        };
        let Scratch { gram, seen, channels, .. } = &mut self.scratch;
        gram.clear();
        seen.clear();
        let planes = channel_count(params);
        channels.resize(planes, Vec::new());
        channels.iter_mut().for_each(Vec::clear);
        for packet in bank.batches().flat_map(|b| &b.packets) {
            let a = self.albedos.of(&packet.class);
            let w = &packet.weight;
            gram.push(std::array::from_fn(|i| w[i] * a[i] * a[i]));
            seen.push(std::array::from_fn(|i| w[i] * a[i] * packet.luminance[i]));
            if let [r, g, b] = &mut channels[..] {
                for (plane, seen) in [r, g, b].into_iter().zip(&packet.rgb) {
                    plane.push(std::array::from_fn(|i| w[i] * a[i] * seen[i]));
                }
            }
        }
        let design = Design { bank, gram, seen };
        let lamp = self.field.as_ref().map(|field| field.lamp);
        let last = lamp.map(|lamp| LastLamp { lamp, turn: self.turn, held });
        self.field = LampField::search(&design, near, last.as_ref());
        self.turn += 1;
        if let Some(field) = &mut self.field {
            match &channels[..] {
                [_] => field.measure(&design, std::slice::from_ref(seen)),
                planes => field.measure(&design, planes),
            }
        }
    }

    /// Luminance of unit albedo under the lamp, for all packets of the bank.
    fn predict(&mut self, bank: &Bank) {
        let mut predicted = std::mem::take(&mut self.scratch.predicted);
        predicted.clear();
        for batch in bank.batches() {
            self.add_under_lamp(batch, bank.coefficients(), &mut predicted);
        }
        self.scratch.predicted = predicted;
    }

    /// Appends the luminance of unit albedo under the lamp, a row a packet; zero without a lamp.
    fn add_under_lamp(&self, batch: &Batch, n: usize, out: &mut Vec<[f32; LANES]>) {
        let first = out.len();
        out.resize(first + batch.packets.len(), [0.0; LANES]);
        let Some(field) = &self.field else { return };
        let weights = channel_weights(field.channels.len());
        field.shade(n, batch, |c, k, shade| {
            for i in 0..LANES {
                out[first + k][i] += weights[c] * shade[i];
            }
        });
    }

    /// Least squares on what the lamp leaves over.
    fn find_rest(&mut self, bank: &Bank, params: &LightParams) -> Solution {
        let n = bank.coefficients();
        let channels = channel_count(params);
        self.scratch.equations.reset(n, channels);
        for batch in bank.batches() {
            self.add_equations(batch, n, channels);
        }
        let equations = &self.scratch.equations;
        let solution = solve(equations, &Penalty::new(equations, params));
        let weights = channel_weights(channels);
        self.rest = (0..n)
            .map(|i| solution.light.iter().zip(weights).map(|(l, w)| l[i] as f32 * w).sum())
            .collect();
        solution
    }

    fn add_equations(&mut self, batch: &Batch, n: usize, channels: usize) {
        let width = padded(n);
        let Scratch { rows, targets, weights, equations, .. } = &mut self.scratch;
        rows.clear();
        rows.resize(batch.packets.len() * LANES * width, 0.0);
        weights.clear();
        targets.resize(channels, Vec::new());
        targets.iter_mut().for_each(Vec::clear);
        for (k, packet) in batch.packets.iter().enumerate() {
            let albedo = self.albedos.of(&packet.class);
            for i in 0..LANES {
                let row = &mut rows[(k * LANES + i) * width..][..n];
                for (c, t) in row.iter_mut().enumerate() {
                    *t = albedo[i] * batch.transfer[k * n + c][i];
                }
            }
            weights.extend(packet.weight);
            match &mut targets[..] {
                [white] => white.extend(packet.luminance),
                planes => planes.iter_mut().zip(packet.rgb).for_each(|(p, seen)| p.extend(seen)),
            }
        }
        if let Some(field) = &self.field {
            field.shade(n, batch, |c, k, shade| {
                let albedo = self.albedos.of(&batch.packets[k].class);
                let plane = &mut targets[c][k * LANES..(k + 1) * LANES];
                for i in 0..LANES {
                    plane[i] -= albedo[i] * shade[i];
                }
            });
        }
        equations.add_rows(rows, targets, weights);
    }

    /// Calls `out(packet, luminance that the model shows)`.
    fn shade(&self, batch: &Batch, n: usize, mut out: impl FnMut(usize, [f32; LANES])) {
        let mut lamp = Vec::with_capacity(batch.packets.len());
        self.add_under_lamp(batch, n, &mut lamp);
        for (k, packet) in batch.packets.iter().enumerate() {
            let albedo = self.albedos.of(&packet.class);
            let mut shade = lamp[k];
            for (row, rest) in batch.transfer[k * n..].iter().zip(&self.rest) {
                for i in 0..LANES {
                    shade[i] += row[i] * rest;
                }
            }
            out(k, std::array::from_fn(|i| albedo[i] * shade[i]));
        }
    }

    /// Huber weights of the residuals. Where there is a lamp they are those of the lamp alone: what it does
    /// not explain is what they are there to find.
    fn weigh_residuals(&mut self, bank: &mut Bank, params: &LightParams) {
        let n = bank.coefficients();
        let rest = match self.field {
            Some(_) => std::mem::take(&mut self.rest),
            None => Vec::new(),
        };
        let mut residuals = std::mem::take(&mut self.scratch.predicted);
        residuals.clear();
        for batch in bank.batches() {
            self.shade(batch, n, |k, shade| {
                let packet = &batch.packets[k];
                residuals.push(std::array::from_fn(|i| packet.luminance[i] - shade[i]));
            });
        }
        if self.field.is_some() {
            self.rest = rest;
        }
        let limit = params.huber * self.robust_deviation(bank, &residuals);
        let packets = bank.batches_mut().flat_map(|b| &mut b.packets);
        for (packet, residual) in packets.zip(&residuals) {
            for i in 0..LANES {
                let r = residual[i].abs();
                packet.robust[i] = if r > limit { limit / r } else { 1.0 };
            }
        }
        self.scratch.predicted = residuals;
        bank.weigh(params.balance_normals);
    }

    /// 1.4826 times the median of the residuals: the standard deviation of a normal distribution. It is the mean of
    /// the middle tenth: one residual alone moves with its own noise, and the light with it.
    fn robust_deviation(&mut self, bank: &Bank, residuals: &[[f32; LANES]]) -> f32 {
        let median = &mut self.scratch.median;
        median.clear();
        let packets = bank.batches().flat_map(|b| &b.packets).zip(residuals);
        for (packet, residual) in packets.step_by(MIDDLE_STRIDE) {
            median
                .extend((0..LANES).filter(|&i| packet.present[i] > 0.0).map(|i| residual[i].abs()));
        }
        if median.is_empty() {
            return 0.0;
        }
        1.4826 * middle_mean(median)
    }
}

/// Mean of those of the middle tenth, by size. There must be one.
fn middle_mean(values: &mut [f32]) -> f32 {
    let (middle, half) = (values.len() / 2, values.len() / 20);
    let (first, last) = (middle - half, (middle + half).min(values.len() - 1));
    let (_, low, above) = values.select_nth_unstable_by(first, f32::total_cmp);
    let mut sum = f64::from(*low);
    if last > first {
        let (within, high, _) = above.select_nth_unstable_by(last - first - 1, f32::total_cmp);
        sum += f64::from(*high) + within.iter().map(|&v| f64::from(v)).sum::<f64>();
    }
    (sum / (last - first + 1) as f64) as f32
}

fn channel_count(params: &LightParams) -> usize {
    match params.channels {
        LightChannels::Intensity => 1,
        LightChannels::Rgb => 3,
    }
}

/// What each channel counts for in the luminance.
fn channel_weights(channels: usize) -> [f32; 3] {
    match channels {
        3 => [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(luminance),
        _ => [1.0, 0.0, 0.0],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_tenth_is_averaged() {
        for (values, mean) in [
            (vec![3.0], 3.0),
            (vec![5.0, 1.0], 5.0),
            (vec![9.0, 1.0, 4.0], 4.0),
            // 45 to 55 of 0 to 100
            ((0..=100).rev().map(|v| v as f32).collect(), 50.0),
            // 9, 10 and 11 of 20
            ((0..20).map(|v| (v * v) as f32).collect(), (81.0 + 100.0 + 121.0) / 3.0),
        ] {
            let mut given = values.clone();
            assert_eq!(middle_mean(&mut given), mean, "{values:?}");
        }
    }

    #[test]
    fn one_value_hardly_moves_the_middle() {
        let mut rng = crate::math::random::Rng::new(&[4]);
        let values: Vec<f32> = (0..2000).map(|_| rng.normal().abs()).collect();
        let found = middle_mean(&mut values.clone());
        // The median of |x| of a normal distribution, to three deviations of that of 2000 samples.
        assert!((found - 0.6745).abs() < 3.0 * 1.25 / 2000f32.sqrt(), "{found}");
        let mut sorted = values.clone();
        sorted.sort_by(f32::total_cmp);
        let (gap, mut moved) = (sorted[1001] - sorted[999], sorted.clone());
        moved[1000] += 0.4 * gap;
        assert!((middle_mean(&mut moved) - found).abs() < 0.4 * gap / 200.0 + 1e-7);
    }
}
