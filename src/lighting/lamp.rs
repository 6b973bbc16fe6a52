//! One lamp and ambient light: the simplest light that rooms have, fitted to the same normal
//! equations as the full one.
//!
//! A picture says little about high bands (a clamped cosine passes a quarter of band 2 and nothing
//! of band 3) and nothing about light from where no surface faces. Believing that light is *small*
//! there turns the dominant direction towards the surfaces that happen to be in view and leaves
//! virtual objects without shadows. Believing that it is that of a lamp does neither.

use super::normal_equations::NormalEquations;
use crate::math::sh;
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// Directions of the first search; the nearest is within 4 degrees of any.
const DIRECTIONS: usize = 1024;
/// Rounds of halving the step around the best direction: below 0.1 degrees.
const REFINEMENTS: usize = 6;

/// Ridge on the coefficients, relative to the mean eigenvalue: where directions fit alike (all
/// surfaces face one way) the lamp is the weakest of them, not one at grazing incidence as strong as
/// can be.
pub const RIDGE: f64 = 0.01;

/// Non-negative ambient radiance and irradiance of a distant lamp, for every channel.
#[derive(Clone, Debug, PartialEq)]
pub struct LampFit {
    pub towards_light: DVec3,
    /// `(ambient radiance, irradiance of a surface that faces the lamp)` a channel.
    pub channels: Vec<(f64, f64)>,
}

impl LampFit {
    /// The best fit in the least-squares sense over the directions within `reach_rad` of `around`;
    /// `None` where the equations are empty or dark.
    pub fn new(equations: &NormalEquations, around: DVec3, reach_rad: f64) -> Option<Self> {
        let mut search = Search::new(equations)?;
        let least_cosine = reach_rad.cos();
        let golden = PI * (3.0 - 5f64.sqrt());
        let mut best = (0.0, around);
        search.improve(around, &mut best);
        for i in 0..DIRECTIONS {
            let z = 1.0 - (2 * i + 1) as f64 / DIRECTIONS as f64;
            let (sin, cos) = (golden * i as f64).sin_cos();
            let r = (1.0 - z * z).sqrt();
            let direction = DVec3::new(r * cos, r * sin, z);
            if direction.dot(around) >= least_cosine {
                search.improve(direction, &mut best);
            }
        }
        let mut step = (4.0 * PI / DIRECTIONS as f64).sqrt();
        for _ in 0..REFINEMENTS {
            let (x, y) = best.1.any_orthonormal_pair();
            let centre = best.1;
            for k in 0..8 {
                let (sin, cos) = (TAU * f64::from(k) / 8.0).sin_cos();
                let direction = (centre + step * (cos * x + sin * y)).normalize();
                search.improve(within(direction, around, reach_rad), &mut best);
            }
            step *= 0.5;
        }
        (best.0 > 0.0).then(|| Self { towards_light: best.1, channels: search.amounts(best.1) })
    }

    /// `n` SH coefficients a channel.
    pub fn light(&self, n: usize) -> Vec<Vec<f64>> {
        let lamp = basis(self.towards_light, n);
        let light = |&(ambient, irradiance): &(f64, f64)| {
            let mut light: Vec<f64> = lamp[..n].iter().map(|y| irradiance * y).collect();
            light[0] += ambient * (4.0 * PI).sqrt();
            light
        };
        self.channels.iter().map(light).collect()
    }
}

/// `direction`, or the nearest that is not farther than `reach_rad` from `around`.
fn within(direction: DVec3, around: DVec3, reach_rad: f64) -> DVec3 {
    if direction.angle_between(around) <= reach_rad {
        return direction;
    }
    let aside = (direction - direction.dot(around) * around).normalize_or_zero();
    (reach_rad.cos() * around + reach_rad.sin() * aside).normalize()
}

fn basis(direction: DVec3, n: usize) -> [f64; sh::MAX_COEFFICIENTS] {
    let mut out = [0.0; sh::MAX_COEFFICIENTS];
    sh::basis_f64(direction, n.isqrt(), &mut out);
    out
}

/// Least squares in two unknowns a channel, for any direction of the lamp.
struct Search<'a> {
    equations: &'a NormalEquations,
    /// N times the coefficients of unit ambient radiance.
    ambient_row: Vec<f64>,
    ridge: f64,
}

impl<'a> Search<'a> {
    fn new(equations: &'a NormalEquations) -> Option<Self> {
        let n = equations.n;
        let unit = (4.0 * PI).sqrt();
        let ambient_row: Vec<f64> = (0..n).map(|i| unit * equations.gram[i * n]).collect();
        let ridge = RIDGE * equations.mean_eigenvalue();
        (n >= 4 && ambient_row[0] > 0.0).then_some(Self { equations, ambient_row, ridge })
    }

    /// What the best non-negative pair of amounts takes off the squared residual, over all
    /// channels.
    fn gain(&self, direction: DVec3) -> f64 {
        let system = self.system(direction);
        let gain = |rhs: [f64; 2]| {
            let (a, e) = system.solve(rhs);
            2.0 * (a * rhs[0] + e * rhs[1]) - system.quadratic(a, e)
        };
        self.right_sides(direction).map(gain).sum()
    }

    fn amounts(&self, direction: DVec3) -> Vec<(f64, f64)> {
        let system = self.system(direction);
        self.right_sides(direction).map(|rhs| system.solve(rhs)).collect()
    }

    fn improve(&mut self, direction: DVec3, best: &mut (f64, DVec3)) {
        let gain = self.gain(direction);
        if gain > best.0 {
            *best = (gain, direction);
        }
    }

    fn system(&self, direction: DVec3) -> Pair {
        let n = self.equations.n;
        let lamp = basis(direction, n);
        let row = |i: usize| {
            let row = &self.equations.gram[i * n..(i + 1) * n];
            row.iter().zip(&lamp).map(|(g, y)| g * y).sum::<f64>()
        };
        Pair {
            aa: (4.0 * PI).sqrt() * self.ambient_row[0] + 4.0 * PI * self.ridge,
            ae: self.ambient_row.iter().zip(&lamp).map(|(g, y)| g * y).sum::<f64>()
                + (4.0 * PI).sqrt() * lamp[0] * self.ridge,
            ee: (0..n).map(|i| lamp[i] * (row(i) + self.ridge * lamp[i])).sum(),
        }
    }

    fn right_sides(&self, direction: DVec3) -> impl Iterator<Item = [f64; 2]> + '_ {
        let lamp = basis(direction, self.equations.n);
        self.equations.rhs.iter().map(move |b| {
            [(4.0 * PI).sqrt() * b[0], b.iter().zip(&lamp).map(|(b, y)| b * y).sum::<f64>()]
        })
    }
}

/// The symmetric 2x2 system of ambient and lamp.
#[derive(Clone, Copy)]
struct Pair {
    aa: f64,
    ae: f64,
    ee: f64,
}

impl Pair {
    fn quadratic(&self, a: f64, e: f64) -> f64 {
        self.aa * a * a + 2.0 * self.ae * a * e + self.ee * e * e
    }

    /// Non-negative least squares.
    fn solve(&self, [ra, re]: [f64; 2]) -> (f64, f64) {
        let determinant = self.aa * self.ee - self.ae * self.ae;
        if determinant > 1e-12 * self.aa * self.ee {
            let a = (ra * self.ee - re * self.ae) / determinant;
            let e = (re * self.aa - ra * self.ae) / determinant;
            if a >= 0.0 && e >= 0.0 {
                return (a, e);
            }
        }
        // One of the two is zero: the better of each alone.
        let a = (ra / self.aa).max(0.0);
        let e = if self.ee > 0.0 { (re / self.ee).max(0.0) } else { 0.0 };
        if a * ra >= e * re { (a, 0.0) } else { (0.0, e) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Equations of unoccluded surfaces of many normals in the half space `normal . up > 0`.
    fn seen(light: &[f64], up: DVec3) -> NormalEquations {
        let n = light.len();
        let mut equations = NormalEquations::default();
        equations.reset(n, 1);
        let golden = PI * (3.0 - 5f64.sqrt());
        for i in 0..400 {
            let z = 1.0 - (2 * i + 1) as f64 / 400.0;
            let (sin, cos) = (golden * f64::from(i)).sin_cos();
            let r = (1.0 - z * z).sqrt();
            let normal = DVec3::new(r * cos, r * sin, z);
            if normal.dot(up) < 0.0 {
                continue;
            }
            let row = sh::unoccluded_transfer(normal.as_vec3(), n.isqrt());
            let shade: f64 = row.iter().zip(light).map(|(t, l)| f64::from(*t) * l).sum();
            for a in 0..n {
                for b in 0..n {
                    equations.gram[a * n + b] += f64::from(row[a]) * f64::from(row[b]);
                }
                equations.rhs[0][a] += f64::from(row[a]) * shade;
            }
        }
        equations
    }

    #[test]
    fn lamp_and_ambient_are_found_from_half_of_all_normals() {
        for towards_light in [DVec3::new(0.48, -0.6, 0.64), DVec3::new(-0.8, 0.6, 0.0)] {
            let truth = LampFit { towards_light, channels: vec![(0.2, 1.5)] };
            let found = LampFit::new(&seen(&truth.light(16)[0], DVec3::Z), DVec3::X, PI).unwrap();
            let angle = found.towards_light.angle_between(towards_light).to_degrees();
            // the ridge draws the lamp towards where more of the surfaces face: measured 0.1 and, for the one
            // that none of them faces, 1.1
            assert!(angle < 1.5, "{angle}");
            // the ridge takes about its own share, 1 %; measured 2.4 % with the turn
            assert!((found.channels[0].0 / 0.2 - 1.0).abs() < 0.03, "{found:?}");
            assert!((found.channels[0].1 / 1.5 - 1.0).abs() < 0.03, "{found:?}");
        }
    }

    #[test]
    fn amounts_are_never_negative_and_darkness_has_no_lamp() {
        let mut dark_above = vec![0.0; 16];
        dark_above[0] = 1.0;
        dark_above[2] = -1.0;
        let found = LampFit::new(&seen(&dark_above, DVec3::Z), DVec3::Z, PI).unwrap();
        assert!(found.channels.iter().all(|&(a, e)| a >= 0.0 && e >= 0.0), "{found:?}");
        assert_eq!(LampFit::new(&seen(&[0.0; 16], DVec3::Z), DVec3::Z, PI), None);
    }
}
