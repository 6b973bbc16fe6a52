//! What surfaces do to light: a diffuse base with an albedo pattern and, optionally, a clear coat
//! with GGX highlights (Walter et al. 2007) over it.

use super::sampler::{Sampler, sin_cos_turns};
use crate::image::Image;
use crate::math::random::{hash, unit_f32};
use glam::{Vec2, Vec3A};
use std::f32::consts::{FRAC_1_PI, PI};
use std::sync::Arc;

/// Diffuse albedo, linear RGB. Solid patterns live in the object's axes, lengths in metres.
#[derive(Clone, Debug)]
pub enum Albedo {
    Constant(Vec3A),
    /// Cubes of side `cell`.
    Checker {
        colors: [Vec3A; 2],
        cell: f32,
    },
    /// Layers along `axis`: of each `period`, the `share` first is of the first colour.
    Stripes {
        colors: [Vec3A; 2],
        axis: usize,
        period: f32,
        share: f32,
    },
    /// Fibres along x, like planed wood: noise of this cell size, stretched.
    Grain {
        colors: [Vec3A; 2],
        cell: f32,
    },
    /// Linear RGB picture over the mesh's texture coordinates.
    Picture(Arc<Image<[f32; 3]>>),
}

#[derive(Clone, Debug)]
pub struct Material {
    pub albedo: Albedo,
    pub coat: Option<Coat>,
    /// Radiance that the surface gives off by itself, both sides.
    pub emission: Vec3A,
}

#[derive(Clone, Copy, Debug)]
pub struct Coat {
    /// Reflectance at normal incidence; 0.04 is glass or varnish.
    pub reflectance: f32,
    /// GGX alpha is its square.
    pub roughness: f32,
}

impl Material {
    pub fn diffuse(r: f32, g: f32, b: f32) -> Self {
        Self::of(Albedo::Constant(Vec3A::new(r, g, b)))
    }

    pub fn of(albedo: Albedo) -> Self {
        Self { albedo, coat: None, emission: Vec3A::ZERO }
    }

    /// The same under varnish.
    pub fn coated(self, roughness: f32) -> Self {
        Self { coat: Some(Coat { reflectance: 0.04, roughness }), ..self }
    }

    pub fn surface(&self, point: Vec3A, uv: Vec2) -> Bsdf {
        Bsdf { albedo: self.albedo.at(point, uv), coat: self.coat }
    }
}

impl Albedo {
    /// `point` in the object's axes.
    fn at(&self, point: Vec3A, uv: Vec2) -> Vec3A {
        match *self {
            Albedo::Constant(color) => color,
            Albedo::Checker { colors, cell } => {
                // Shifted, so that faces at round coordinates do not lie on a boundary.
                let cells = (point / cell + Vec3A::splat(0.37)).floor();
                let odd = (cells.x + cells.y + cells.z).rem_euclid(2.0) >= 1.0;
                colors[usize::from(odd)]
            }
            Albedo::Stripes { colors, axis, period, share } => {
                let phase = (point[axis] / period + 0.13).rem_euclid(1.0);
                colors[usize::from(phase >= share)]
            }
            Albedo::Grain { colors, cell } => {
                let p = point * Vec3A::new(0.06, 1.0, 1.0) / cell;
                let fine = value_noise(p * 3.1, 17);
                let mix = (0.7 * value_noise(p, 5) + 0.3 * fine).clamp(0.0, 1.0);
                colors[0].lerp(colors[1], mix)
            }
            Albedo::Picture(ref picture) => bilinear(picture, uv),
        }
    }
}

/// Smooth noise in [0, 1] on a unit lattice.
pub fn value_noise(point: Vec3A, seed: u32) -> f32 {
    let base = point.floor();
    let f = point - base;
    let w = f * f * (Vec3A::splat(3.0) - f * 2.0);
    let cell = base.as_ivec3();
    let layer = |dz: i32| hash(seed ^ (cell.z + dz) as u32);
    let line = |dy: i32, dz: i32| hash(layer(dz) ^ (cell.y + dy) as u32);
    let corner = |dx, dy, dz| unit_f32(hash(line(dy, dz) ^ (cell.x + dx) as u32));
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    let edge = |dy, dz| mix(corner(0, dy, dz), corner(1, dy, dz), w.x);
    mix(mix(edge(0, 0), edge(1, 0), w.y), mix(edge(0, 1), edge(1, 1), w.y), w.z)
}

/// Repeats in both directions, as glTF samplers do by default.
fn bilinear(picture: &Image<[f32; 3]>, uv: Vec2) -> Vec3A {
    let (width, height) = (picture.width() as i64, picture.height() as i64);
    let (x, y) = (uv.x * width as f32 - 0.5, uv.y * height as f32 - 0.5);
    let (x0, y0) = (x.floor(), y.floor());
    let texel = |dx: i64, dy: i64| {
        let column = (x0 as i64 + dx).rem_euclid(width) as usize;
        let row = (y0 as i64 + dy).rem_euclid(height) as usize;
        Vec3A::from_array(picture[(column, row)])
    };
    let top = texel(0, 0).lerp(texel(1, 0), x - x0);
    let bottom = texel(0, 1).lerp(texel(1, 1), x - x0);
    top.lerp(bottom, y - y0)
}

/// Reflection at one point. Directions are unit, away from the surface, in axes with the normal
/// along +z.
#[derive(Clone, Copy, Debug)]
pub struct Bsdf {
    pub albedo: Vec3A,
    pub coat: Option<Coat>,
}

/// A sampled direction; `weight` = f cos / pdf.
#[derive(Clone, Copy, Debug)]
pub struct Scattered {
    pub direction: Vec3A,
    pub weight: Vec3A,
    pub pdf: f32,
}

impl Bsdf {
    /// Reflected share f (without cosine) and the density with which [`Self::sample`] finds `to`.
    pub fn value_and_pdf(&self, from: Vec3A, to: Vec3A) -> (Vec3A, f32) {
        if from.z <= 0.0 || to.z <= 0.0 {
            return (Vec3A::ZERO, 0.0);
        }
        let diffuse = self.albedo * FRAC_1_PI;
        let diffuse_pdf = to.z * FRAC_1_PI;
        let Some(coat) = self.coat else { return (diffuse, diffuse_pdf) };
        // Light passes the coat twice; what it reflects does not reach the base.
        let passes = (1.0 - coat.fresnel(from.z)) * (1.0 - coat.fresnel(to.z));
        let (lobe, lobe_pdf) = coat.lobe(from, to);
        let share = self.coat_share(&coat, from);
        (diffuse * passes + Vec3A::splat(lobe), share * lobe_pdf + (1.0 - share) * diffuse_pdf)
    }

    /// `None` where the sampled direction leads into the surface.
    pub fn sample(&self, from: Vec3A, sampler: &mut Sampler) -> Option<Scattered> {
        let point = sampler.pair();
        let to = match self.coat {
            Some(coat) if sampler.single() < self.coat_share(&coat, from) => {
                let half = coat.sample_half(point);
                half * (2.0 * from.dot(half)) - from
            }
            _ => cosine_hemisphere(point),
        };
        let (value, pdf) = self.value_and_pdf(from, to);
        (pdf > 0.0).then(|| Scattered { direction: to, weight: value * (to.z / pdf), pdf })
    }

    /// The same with a dull coat, for surfaces that a path sees by reflection: their highlights
    /// light other surfaces by caustics too rare to sample, which would be left as single bright
    /// pixels (path space regularisation, Kaplanyan and Dachsbacher 2013).
    pub fn regularised(mut self) -> Self {
        if let Some(coat) = &mut self.coat {
            coat.roughness = coat.roughness.max(0.75);
        }
        self
    }

    /// Probability of sampling the coat rather than the base.
    fn coat_share(&self, coat: &Coat, from: Vec3A) -> f32 {
        let coat_weight = coat.fresnel(from.z);
        let base = self.albedo.max_element() * (1.0 - coat_weight);
        (coat_weight / (coat_weight + base)).clamp(0.1, 0.9)
    }
}

impl Coat {
    /// Schlick 1994.
    fn fresnel(&self, cosine: f32) -> f32 {
        let m = (1.0 - cosine).clamp(0.0, 1.0);
        self.reflectance + (1.0 - self.reflectance) * m * m * m * m * m
    }

    fn alpha_squared(&self) -> f32 {
        self.roughness.max(0.03).powi(4)
    }

    /// D F G / (4 cos cos) with the height-correlated Smith term (Heitz 2014), and its density.
    fn lobe(&self, from: Vec3A, to: Vec3A) -> (f32, f32) {
        let a2 = self.alpha_squared();
        let half = (from + to).normalize();
        let base = half.z * half.z * (a2 - 1.0) + 1.0;
        let d = a2 / (PI * base * base);
        let masked = |a: Vec3A, b: Vec3A| a.z * (b.z * b.z * (1.0 - a2) + a2).sqrt();
        let visible = 0.5 / (masked(from, to) + masked(to, from));
        let cosine = from.dot(half).max(1e-6);
        (d * visible * self.fresnel(cosine), d * half.z / (4.0 * cosine))
    }

    /// Half vector with density D cos.
    fn sample_half(&self, point: Vec2) -> Vec3A {
        let a2 = self.alpha_squared();
        let z2 = (1.0 - point.x) / (1.0 + (a2 - 1.0) * point.x);
        let (sin, cos) = sin_cos_turns(point.y);
        let r = (1.0 - z2).max(0.0).sqrt();
        Vec3A::new(r * cos, r * sin, z2.sqrt())
    }
}

fn cosine_hemisphere(point: Vec2) -> Vec3A {
    let r = point.x.sqrt();
    let (sin, cos) = sin_cos_turns(point.y);
    Vec3A::new(r * cos, r * sin, (1.0 - point.x).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The share of uniform light that is reflected, by the sampler's weights and by quadrature of
    /// the function itself: a wrong density makes them differ.
    #[test]
    fn sampling_agrees_with_quadrature_and_creates_no_energy() {
        for roughness in [0.2, 0.45, 0.9] {
            let coat = Some(Coat { reflectance: 0.04, roughness });
            for (albedo, slant) in [(0.0, 0.3f32), (0.8, 0.3), (1.0, 1.3)] {
                let bsdf = Bsdf { albedo: Vec3A::splat(albedo), coat };
                let from = Vec3A::new(slant.sin(), 0.0, slant.cos());
                let n = 1 << 15;
                let sampled = (0..n)
                    .filter_map(|i| bsdf.sample(from, &mut Sampler::new(&[9], i)))
                    .map(|s| f64::from(s.weight.x))
                    .sum::<f64>()
                    / f64::from(n);
                let steps = 1200;
                let mut integral = 0.0;
                for i in 0..steps {
                    // cos^2 is uniform, so each cell has the same projected solid angle
                    let r = ((i as f32 + 0.5) / steps as f32).sqrt();
                    for j in 0..steps {
                        let (sin, cos) = sin_cos_turns((j as f32 + 0.5) / steps as f32);
                        let to = Vec3A::new(r * cos, r * sin, (1.0 - r * r).sqrt());
                        integral += f64::from(bsdf.value_and_pdf(from, to).0.x);
                    }
                }
                integral *= std::f64::consts::PI / f64::from(steps * steps);
                // (0, 2)-points bring the sampled mean to about 3e-4; narrow lobes are the worst
                assert!((sampled - integral).abs() < 3e-3, "{sampled} {integral} {roughness}");
                assert!(integral <= 1.0 + 1e-3, "{integral}");
            }
        }
    }

    #[test]
    fn reflection_is_reciprocal() {
        let bsdf = Bsdf {
            albedo: Vec3A::splat(0.5),
            coat: Some(Coat { reflectance: 0.04, roughness: 0.4 }),
        };
        let a = Vec3A::new(0.6, 0.0, 0.8);
        let b = Vec3A::new(-0.3, 0.4, 0.8).normalize();
        let (ab, ba) = (bsdf.value_and_pdf(a, b).0.x, bsdf.value_and_pdf(b, a).0.x);
        assert!((ab - ba).abs() < 1e-6 * ab.max(1.0));
    }

    #[test]
    fn patterns_alternate() {
        let colors = [Vec3A::ZERO, Vec3A::ONE];
        let checker = Albedo::Checker { colors, cell: 0.1 };
        let stripes = Albedo::Stripes { colors, axis: 1, period: 0.1, share: 0.5 };
        let p = Vec3A::new(0.01, 0.01, 0.01);
        assert_ne!(checker.at(p, Vec2::ZERO), checker.at(p + Vec3A::X * 0.1, Vec2::ZERO));
        assert_eq!(checker.at(p, Vec2::ZERO), checker.at(p + Vec3A::X * 0.2, Vec2::ZERO));
        assert_ne!(stripes.at(p, Vec2::ZERO), stripes.at(p + Vec3A::Y * 0.05, Vec2::ZERO));
        assert_eq!(stripes.at(p, Vec2::ZERO), stripes.at(p + Vec3A::X * 0.05, Vec2::ZERO));
    }
}
