//! One lamp, near or far, and ambient light: the simplest light that rooms have.
//!
//! A picture says little about high bands of light (a clamped cosine passes a quarter of band 2 and
//! nothing of band 3) and nothing about light from where no surface faces; and a lamp a few metres away
//! lights the near end of a table twice as much as the far end, which light from infinity can only explain
//! by a wrong direction. A lamp with a place has five unknowns and explains both.
//!
//! The seen light of a surface point x is `ambient T_0 sqrt(4 pi) + irradiance T.Y(u) D^2 / r^2`, where u
//! and r are direction and distance of the lamp from x, and D its distance from the centre of what is seen.

use super::bank::{Bank, Batch, LANES};
use super::solve::non_negative_pair;
use crate::math::{fibonacci_sphere, sh};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::{PI, TAU};

/// Directions and distances (in units of the extent of what is seen) of the first search.
const DIRECTIONS: usize = 200;
const DISTANCES: [f32; 6] = [1.6, 2.4, 3.6, 5.2, 8.0, 14.0];

/// The first search looks at this many packets at most.
const SEARCH_PACKETS: usize = 96;

/// Where a lamp is known, every n-th direction is looked at again in each frame, others in the next.
const TURNS: usize = 8;

/// Part of the samples must speak for another place by this much before all are asked.
const CLEARLY_BETTER: f64 = 1.01;

/// A known lamp moves where that explains this share of the picture more: places and distances that explain
/// the same lie in a long valley, along which noise alone would carry it.
const REASON_TO_MOVE: f64 = 5e-4;

/// Steps around a place, in radians and in the logarithm of the distance, from about half the spacing of the
/// first search down to 0.07 degrees.
const COLD_STEPS: [f32; 5] = [0.25, 0.15, 0.09, 0.06, 0.04];
const WARM_STEPS: [f32; 6] = [0.04, 0.02, 0.01, 0.005, 0.0025, 0.00125];
const AROUND: usize = 6;

/// Added to the diagonal, relative: where ambient light and lamp explain the same, the weaker of both.
pub const RIDGE: f64 = 0.02;

/// A lamp this many extents away is as good as infinitely far.
const FAR: f32 = 30.0;
/// A lamp is never nearer than this share of its distance from the centre.
const NEAREST: f32 = 0.1;

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lamp {
    /// World axes, metres.
    Near { position: Vec3 },
    /// Unit vector.
    Far { towards: Vec3 },
}

/// A lamp seen from the centre of the samples.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Candidate {
    towards: Vec3,
    /// None: infinitely far.
    distance_m: Option<f32>,
}

/// What a bank shows, for a lamp at given albedos: the sums of a least-squares fit of two unknowns.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    ambient_ambient: f64,
    ambient_lamp: f64,
    lamp_lamp: f64,
    ambient_seen: f64,
    lamp_seen: f64,
}

/// The rays of light that a packet gets from a lamp.
struct Arrival {
    centre: Vec3,
    candidate: Candidate,
    far_basis: [f32; sh::MAX_COEFFICIENTS],
    bands: usize,
}

/// Weights of the fit, a row a packet: `w a^2` and `w a I` for each plane of I.
pub struct Design<'a> {
    pub bank: &'a Bank,
    pub gram: &'a [[f32; LANES]],
    pub seen: &'a [[f32; LANES]],
}

/// The lamp that explains a bank best, and how much of it.
#[derive(Clone, Debug, PartialEq)]
pub struct LampField {
    pub lamp: Lamp,
    pub centre: Vec3,
    /// `(ambient radiance, irradiance at the centre of a surface that faces the lamp)` a channel.
    pub channels: Vec<(f64, f64)>,
}

impl Lamp {
    fn seen_from(&self, centre: Vec3) -> Candidate {
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
    fn lamp(&self, centre: Vec3) -> Lamp {
        match self.distance_m {
            Some(distance) => Lamp::Near { position: centre + distance * self.towards },
            None => Lamp::Far { towards: self.towards },
        }
    }

    /// Turned by `step` radians towards each of several sides, and nearer and farther by that share.
    fn neighbours(self, step: f32, farthest_m: f32) -> Vec<Self> {
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

impl Arrival {
    fn new(centre: Vec3, candidate: Candidate, coefficients: usize) -> Self {
        let bands = coefficients.isqrt();
        Self { centre, candidate, far_basis: sh::basis(candidate.towards, bands), bands }
    }

    /// T.Y(u) D^2 / r^2 of a packet.
    #[inline(always)]
    fn irradiance(&self, position: &[[f32; LANES]; 3], transfer: &[[f32; LANES]]) -> [f32; LANES] {
        let mut out = [0.0; LANES];
        let Some(distance) = self.candidate.distance_m else {
            for (row, y) in transfer.iter().zip(self.far_basis) {
                for i in 0..LANES {
                    out[i] += row[i] * y;
                }
            }
            return out;
        };
        let lamp = self.centre + distance * self.candidate.towards;
        let squared = distance * distance;
        let nearest = NEAREST * NEAREST * squared;
        let mut u = [[0.0; LANES]; 3];
        let mut falloff = [0.0; LANES];
        for i in 0..LANES {
            let v = [0, 1, 2].map(|axis| lamp[axis] - position[axis][i]);
            let r2 = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).max(nearest);
            let inverse = 1.0 / r2.sqrt();
            for axis in 0..3 {
                u[axis][i] = v[axis] * inverse;
            }
            falloff[i] = squared / r2;
        }
        let mut basis = [[0.0; LANES]; sh::MAX_COEFFICIENTS];
        sh::basis_lanes(&u, self.bands, &mut basis);
        for (row, y) in transfer.iter().zip(&basis) {
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

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn sums_of(
    arrival: &Arrival,
    batch: &Batch,
    n: usize,
    (gram, seen): (&[[f32; LANES]], &[[f32; LANES]]),
    every: usize,
) -> Sums {
    let unit = (4.0 * PI).sqrt();
    let mut lanes = [[0.0f32; LANES]; 5];
    for k in (0..batch.packets.len()).step_by(every) {
        let transfer = &batch.transfer[k * n..(k + 1) * n];
        let lamp = arrival.irradiance(&batch.packets[k].position, transfer);
        let (gram, seen) = (&gram[k], &seen[k]);
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

impl Sums {
    fn add(&mut self, other: Self) {
        self.ambient_ambient += other.ambient_ambient;
        self.ambient_lamp += other.ambient_lamp;
        self.lamp_lamp += other.lamp_lamp;
        self.ambient_seen += other.ambient_seen;
        self.lamp_seen += other.lamp_seen;
    }

    fn amounts(&self) -> (f64, f64) {
        let with_ridge = |v: f64| (1.0 + RIDGE) * v;
        non_negative_pair(
            [with_ridge(self.ambient_ambient), self.ambient_lamp, with_ridge(self.lamp_lamp)],
            [self.ambient_seen, self.lamp_seen],
        )
    }

    /// What the fit takes off the squared residual.
    fn gain(&self) -> f64 {
        let (a, l) = self.amounts();
        let quadratic = (1.0 + RIDGE) * (self.ambient_ambient * a * a + self.lamp_lamp * l * l)
            + 2.0 * self.ambient_lamp * a * l;
        2.0 * (self.ambient_seen * a + self.lamp_seen * l) - quadratic
    }
}

/// Sums over every `every`-th packet of the bank, in the order of the batches.
fn sums(design: &Design, seen: &[[f32; LANES]], arrival: &Arrival, every: usize) -> Sums {
    let mut total = Sums::default();
    let mut first = 0;
    for batch in design.bank.batches() {
        let range = first..first + batch.packets.len();
        first = range.end;
        let planes = (&design.gram[range.clone()], &seen[range]);
        total.add(sums_of(arrival, batch, design.bank.coefficients(), planes, every));
    }
    total
}

impl LampField {
    /// The best lamp in the least-squares sense; with `near` false, at infinity. Without a `last` one it is
    /// searched everywhere among part of the samples and refined among all. Else it is followed from there,
    /// and part of all other places is looked at, by `turn` another in every call.
    ///
    /// `None` with less than two bands, or where nothing is seen that a lamp could explain.
    pub fn search(design: &Design, near: bool, last: Option<&Lamp>, turn: usize) -> Option<Self> {
        let n = design.bank.coefficients();
        if n < 4 {
            return None;
        }
        let (centre, extent_m) = design.bank.centre_and_extent_m();
        let near = near && extent_m > 0.0;
        let search = Search { design, centre, extent_m, near };
        let (gain, best) = match last {
            None => search.descend(search.coarse(0, 1)?.1),
            Some(lamp) => search.follow(lamp.seen_from(centre), turn),
        };
        (gain > 0.0).then(|| Self { lamp: best.lamp(centre), centre, channels: Vec::new() })
    }

    /// Finds the amounts for each channel, given its plane of `w a I`.
    pub fn measure(&mut self, design: &Design, channels: &[Vec<[f32; LANES]>]) {
        let arrival = self.arrival(design.bank.coefficients());
        self.channels =
            channels.iter().map(|seen| sums(design, seen, &arrival, 1).amounts()).collect();
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
        for (k, packet) in batch.packets.iter().enumerate() {
            let transfer = &batch.transfer[k * coefficients..(k + 1) * coefficients];
            let lamp = arrival.irradiance(&packet.position, transfer);
            for (c, &(ambient, irradiance)) in self.channels.iter().enumerate() {
                let (ambient, irradiance) = (ambient as f32 * unit, irradiance as f32);
                let shade = |i: usize| ambient * transfer[0][i] + irradiance * lamp[i];
                out(c, k, std::array::from_fn(shade));
            }
        }
    }

    /// Its light at a point, a vector of coefficients a channel.
    pub fn light_at(&self, point: Vec3, coefficients: usize) -> Vec<Vec<f64>> {
        let there = self.lamp.seen_from(point);
        let falloff = match (self.lamp.seen_from(self.centre).distance_m, there.distance_m) {
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

struct Search<'a> {
    design: &'a Design<'a>,
    centre: Vec3,
    extent_m: f32,
    near: bool,
}

impl Search<'_> {
    /// The best place near the last one, unless another is clearly better.
    fn follow(&self, last: Candidate, turn: usize) -> (f64, Candidate) {
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
        let gains: Vec<f64> = candidates
            .par_iter()
            .map(|&candidate| {
                let arrival = Arrival::new(self.centre, candidate, n);
                sums(self.design, self.design.seen, &arrival, every).gain()
            })
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

#[cfg(test)]
mod tests {
    use super::super::bank::Sample;
    use super::*;

    /// A floor with bumps, two metres wide, unoccluded, lit by `lamp` (irradiance 1 at the origin) and ambient
    /// light 0.2.
    fn lit_by(lamp: Lamp) -> Bank {
        let mut batch = Batch::default();
        batch.clear();
        for (k, bump) in fibonacci_sphere(900).into_iter().enumerate() {
            let position =
                Vec3::new((k % 30) as f32 / 15.0 - 1.0, (k / 30) as f32 / 15.0 - 1.0, 0.0);
            let normal = (Vec3::Z + 0.8 * bump).normalize();
            let (towards, falloff) = match lamp {
                Lamp::Far { towards } => (towards, 1.0),
                Lamp::Near { position: at } => (
                    (at - position).normalize(),
                    at.length_squared() / at.distance_squared(position),
                ),
            };
            let transfer = &sh::unoccluded_transfer(normal, 4)[..16];
            let lobe: f32 =
                sh::basis(towards, 4)[..16].iter().zip(transfer).map(|(y, t)| y * t).sum();
            let seen = 0.2 * (4.0 * PI).sqrt() * transfer[0] + falloff * lobe;
            batch.push(&Sample { transfer, position, normal, rgb: [seen; 3] });
        }
        batch.take_indirect_light(0.0);
        let mut bank = Bank::default();
        bank.push(batch, 16, 0.9);
        bank.weigh(false);
        bank
    }

    fn found(bank: &Bank, near: bool) -> Option<LampField> {
        search(bank, near, None, 0)
    }

    fn search(bank: &Bank, near: bool, last: Option<&Lamp>, turn: usize) -> Option<LampField> {
        let packets = || bank.batches().flat_map(|b| &b.packets);
        let gram: Vec<_> = packets().map(|p| p.weight).collect();
        let seen: Vec<[f32; LANES]> =
            packets().map(|p| std::array::from_fn(|i| p.weight[i] * p.luminance[i])).collect();
        let design = Design { bank, gram: &gram, seen: &seen };
        let mut field = LampField::search(&design, near, last, turn)?;
        field.measure(&design, std::slice::from_ref(&seen));
        Some(field)
    }

    #[test]
    fn a_near_lamp_is_found_at_its_place() {
        let at = Vec3::new(1.2, -0.9, 1.4);
        let field = found(&lit_by(Lamp::Near { position: at }), true).unwrap();
        let Lamp::Near { position } = field.lamp else { panic!("{field:?}") };
        // the ridge and four bands of a lobe draw it a little: measured below 5 cm
        assert!(position.distance(at) < 0.1, "{position}");
        // the ridge takes about its own share
        let (ambient, irradiance) = field.channels[0];
        assert!((ambient - 0.2).abs() < 0.02 && (irradiance - 1.0).abs() < 0.1, "{field:?}");
        // followed from a wrong place, it is found again within as many frames as all places take
        let bank = lit_by(Lamp::Near { position: at });
        let mut lamp = Lamp::Far { towards: -Vec3::X };
        for turn in 0..TURNS {
            lamp = search(&bank, true, Some(&lamp), turn).unwrap().lamp;
        }
        let Lamp::Near { position } = lamp else { panic!("{lamp:?}") };
        // Of 2.05 m. Moves that gain less than their reason are left out: measured 0.29 m, most of it along
        // the line of sight.
        assert!(position.distance(at) < 0.4, "{position}");
        assert!(position.angle_between(at) < 0.1, "{position}");
    }

    #[test]
    fn the_sun_is_far_and_a_near_lamp_seen_as_far_is_turned() {
        let sun = Vec3::new(-0.6, 0.0, 0.8);
        let bank = lit_by(Lamp::Far { towards: sun });
        let angle = |field: &LampField| {
            let towards = field.lamp.seen_from(Vec3::ZERO).towards;
            towards.angle_between(sun).to_degrees()
        };
        for near in [true, false] {
            let field = found(&bank, near).unwrap();
            assert!(angle(&field) < 2.0, "{field:?}");
            let distance = field.lamp.seen_from(Vec3::ZERO).distance_m;
            assert!(distance.is_none_or(|d| d > 10.0), "{field:?}");
        }
    }

    #[test]
    fn nothing_to_see_gives_no_lamp() {
        let mut bank = Bank::default();
        assert_eq!(found(&bank, true), None);
        let mut batch = Batch::default();
        batch.clear();
        let transfer = &sh::unoccluded_transfer(Vec3::Z, 4)[..16];
        for _ in 0..40 {
            let (position, normal) = (Vec3::ONE, Vec3::Z);
            batch.push(&Sample { transfer, position, normal, rgb: [0.0; 3] });
        }
        batch.take_indirect_light(0.5);
        bank.push(batch, 16, 0.9);
        bank.weigh(true);
        assert_eq!(found(&bank, true), None, "dark");
    }

    #[test]
    fn one_place_seen_from_nowhere_else_is_lit_from_afar() {
        let mut batch = Batch::default();
        batch.clear();
        for normal in fibonacci_sphere(64) {
            let transfer = &sh::unoccluded_transfer(normal, 4)[..16];
            let seen = 0.3 + normal.x.max(0.0);
            batch.push(&Sample { transfer, position: Vec3::ONE, normal, rgb: [seen; 3] });
        }
        batch.take_indirect_light(0.0);
        let mut bank = Bank::default();
        bank.push(batch, 16, 0.9);
        bank.weigh(true);
        let field = found(&bank, true).unwrap();
        assert!(matches!(field.lamp, Lamp::Far { .. }), "{field:?}");
        // the lamp's own point: no direction, and no division by zero
        let at_lamp = LampField { lamp: Lamp::Near { position: Vec3::X }, ..field };
        assert!(at_lamp.light_at(Vec3::X, 16)[0].iter().all(|v| v.is_finite()));
    }
}
