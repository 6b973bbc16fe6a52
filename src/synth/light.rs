//! Area lights and the light from far away.

use crate::image::{Image, Size};
use crate::math::sh::{self, MAX_COEFFICIENTS};
use glam::{DVec3, Vec2, Vec3A};
use std::f64::consts::{PI, TAU};

/// A rectangle that shines to one side. It is a light alone: it hides nothing and cameras do not
/// see it.
#[derive(Clone, Copy, Debug)]
pub struct AreaLight {
    centre: Vec3A,
    half_u: Vec3A,
    half_v: Vec3A,
    normal: Vec3A,
    area: f32,
    radiance: Vec3A,
}

/// A point on a light as seen from a surface point.
#[derive(Clone, Copy, Debug)]
pub struct LightSample {
    /// Unit, towards the light.
    pub direction: Vec3A,
    pub distance: f32,
    pub radiance: Vec3A,
    /// Density over solid angle.
    pub pdf: f32,
}

impl AreaLight {
    /// `half_u` and `half_v` are half of each side, at right angles; light leaves along
    /// `half_u x half_v`. Linear RGB radiance in the scene's units.
    pub fn new(centre: Vec3A, half_u: Vec3A, half_v: Vec3A, radiance: Vec3A) -> Self {
        let cross = half_u.cross(half_v);
        let (normal, area) = (cross.normalize(), 4.0 * cross.length());
        Self { centre, half_u, half_v, normal, area, radiance }
    }

    /// Square of this side at `centre` that faces `target`.
    pub fn facing(centre: Vec3A, target: Vec3A, side: f32, radiance: Vec3A) -> Self {
        let normal = (target - centre).normalize();
        let (u, v) = normal.any_orthonormal_pair();
        // the pair's handedness is not promised
        let v = if u.cross(v).dot(normal) < 0.0 { -v } else { v };
        Self::new(centre, u * (side * 0.5), v * (side * 0.5), radiance)
    }

    pub fn centre(&self) -> Vec3A {
        self.centre
    }

    /// Half of each side.
    pub fn half_sides(&self) -> [Vec3A; 2] {
        [self.half_u, self.half_v]
    }

    pub fn radiance(&self) -> Vec3A {
        self.radiance
    }

    /// `None` where the point lies behind the light.
    pub fn sample(&self, from: Vec3A, point: Vec2) -> Option<LightSample> {
        let (u, v) = (2.0 * point.x - 1.0, 2.0 * point.y - 1.0);
        let towards = self.centre + self.half_u * u + self.half_v * v - from;
        self.seen(towards)
    }

    fn seen(&self, towards: Vec3A) -> Option<LightSample> {
        let distance_squared = towards.length_squared();
        let distance = distance_squared.sqrt();
        let direction = towards / distance;
        let cosine = -direction.dot(self.normal);
        (cosine > 0.0 && distance > 0.0).then(|| LightSample {
            direction,
            distance,
            radiance: self.radiance,
            pdf: distance_squared / (cosine * self.area),
        })
    }

    /// What a ray with unit direction sees of the light.
    pub fn hit(&self, origin: Vec3A, direction: Vec3A) -> Option<LightSample> {
        let facing = direction.dot(self.normal);
        if facing >= 0.0 {
            return None;
        }
        let t = (self.centre - origin).dot(self.normal) / facing;
        let offset = origin + direction * t - self.centre;
        let inside = |half: Vec3A| offset.dot(half).abs() <= half.length_squared();
        (t > 0.0 && inside(self.half_u) && inside(self.half_v))
            .then(|| self.seen(direction * t))
            .flatten()
    }

    /// `n` x `n` equal patches of the light as seen from a point: direction, distance and solid
    /// angle of each, by the midpoint rule.
    pub fn patches(&self, from: DVec3, n: usize) -> impl Iterator<Item = (DVec3, f64, f64)> {
        let [centre, u, v] = [self.centre, self.half_u, self.half_v].map(|a| a.as_dvec3());
        let normal = u.cross(v).normalize();
        let area = 4.0 * u.cross(v).length() / (n * n) as f64;
        let at = move |i: usize| (2 * i + 1) as f64 / n as f64 - 1.0;
        (0..n * n).map(move |k| {
            let towards = centre + u * at(k % n) + v * at(k / n) - from;
            let distance = towards.length();
            let direction = towards / distance;
            let cosine = (-direction.dot(normal)).max(0.0);
            (direction, distance, area * cosine / (distance * distance))
        })
    }
}

/// Light from infinitely far away.
#[derive(Clone, Debug)]
pub enum Environment {
    Uniform(Vec3A),
    LatLong(LatLong),
}

/// Lat-long picture in linear RGB: the top row looks along +z, column 0 begins at -x, and columns
/// turn clockwise seen from above (the picture as seen from inside); the middle column is +x.
#[derive(Clone, Debug)]
pub struct LatLong {
    picture: Image<[f32; 3]>,
    /// Running sums of luminance times solid angle, one a pixel and a zero before; ends at 1.
    cumulative: Vec<f32>,
}

impl LatLong {
    /// Values that are not finite and positive become black. An empty picture is refused.
    pub fn new(mut picture: Image<[f32; 3]>) -> Option<Self> {
        if picture.size().pixels() == 0 {
            return None;
        }
        for value in picture.as_mut_slice().iter_mut().flatten() {
            *value = if value.is_finite() { value.max(0.0) } else { 0.0 };
        }
        let size = picture.size();
        let weight = |y: usize, x: usize| {
            // A little everywhere, so that a black picture can be sampled too.
            let luminance = crate::math::color::luminance(picture[(x, y)]) + 1e-6;
            f64::from(luminance) * pixel_solid_angle(size, y)
        };
        let mut sum = 0.0;
        let sums: Vec<f64> = (0..size.height)
            .flat_map(|y| (0..size.width).map(move |x| (y, x)))
            .map(|(y, x)| {
                sum += weight(y, x);
                sum
            })
            .collect();
        let cumulative =
            std::iter::once(0.0).chain(sums.iter().map(|s| (s / sum) as f32)).collect();
        Some(Self { picture, cumulative })
    }

    pub fn radiance(&self, direction: Vec3A) -> Vec3A {
        let (x, y) = self.pixel(direction);
        Vec3A::from_array(self.picture[(x, y)])
    }

    fn pixel(&self, d: Vec3A) -> (usize, usize) {
        let size = self.picture.size();
        let u = 0.5 - d.y.atan2(d.x) / std::f32::consts::TAU;
        let v = d.z.clamp(-1.0, 1.0).acos() / std::f32::consts::PI;
        let x = ((u * size.width as f32) as usize).min(size.width - 1);
        let y = ((v * size.height as f32) as usize).min(size.height - 1);
        (x, y)
    }

    fn density(&self, x: usize, y: usize) -> f32 {
        let i = y * self.picture.width() + x;
        let probability = self.cumulative[i + 1] - self.cumulative[i];
        probability / pixel_solid_angle(self.picture.size(), y) as f32
    }

    pub fn pdf(&self, direction: Vec3A) -> f32 {
        let (x, y) = self.pixel(direction);
        self.density(x, y)
    }

    pub fn sample(&self, point: Vec2) -> LightSample {
        let size = self.picture.size();
        let i = self.cumulative.partition_point(|&c| c <= point.x).clamp(1, size.pixels()) - 1;
        let (x, y) = (i % size.width, i / size.width);
        let span = (self.cumulative[i + 1] - self.cumulative[i]).max(f32::MIN_POSITIVE);
        let u = (x as f32 + ((point.x - self.cumulative[i]) / span).clamp(0.0, 0.999))
            / size.width as f32;
        let (top, bottom) = row_heights(size, y);
        let z = (top + (bottom - top) * f64::from(point.y)) as f32;
        let (sin, cos) = super::sampler::sin_cos_turns(u);
        let r = (1.0 - z * z).max(0.0).sqrt();
        LightSample {
            // u = 0 is -x; angles fall as u grows
            direction: Vec3A::new(-r * cos, r * sin, z),
            distance: f32::INFINITY,
            radiance: Vec3A::from_array(self.picture[(x, y)]),
            pdf: self.density(x, y),
        }
    }
}

/// z of the upper and lower border of a row.
fn row_heights(size: Size, y: usize) -> (f64, f64) {
    let z = |row: usize| (PI * row as f64 / size.height as f64).cos();
    (z(y), z(y + 1))
}

fn pixel_solid_angle(size: Size, y: usize) -> f64 {
    let (top, bottom) = row_heights(size, y);
    TAU / size.width as f64 * (top - bottom)
}

/// Spherical harmonics of incident radiance, one [R, G, B] a coefficient, 4 bands.
pub type Sh = [[f64; 3]; 16];

pub const BANDS: usize = 4;

pub fn add_direction(out: &mut Sh, direction: DVec3, radiance_times_angle: [f64; 3]) {
    let mut basis = [0.0; MAX_COEFFICIENTS];
    sh::basis_f64(direction, BANDS, &mut basis);
    for (coefficient, y) in out.iter_mut().zip(basis) {
        for (c, radiance) in coefficient.iter_mut().zip(radiance_times_angle) {
            *c += y * radiance;
        }
    }
}

/// Light of one area light at a point, nothing in between.
pub fn area_light_sh(light: &AreaLight, point: DVec3) -> Sh {
    let mut out = Sh::default();
    // 128 x 128: the midpoint rule's error falls with the square, far below 1e-6 from 1 m away
    for (direction, _, angle) in light.patches(point, 128) {
        let radiance = light.radiance.as_dvec3().to_array().map(|r| r * angle);
        add_direction(&mut out, direction, radiance);
    }
    out
}

impl Environment {
    pub fn radiance(&self, direction: Vec3A) -> Vec3A {
        match self {
            Environment::Uniform(radiance) => *radiance,
            Environment::LatLong(map) => map.radiance(direction),
        }
    }

    pub fn sh(&self) -> Sh {
        let mut out = Sh::default();
        match self {
            Environment::Uniform(radiance) => {
                out[0] = radiance.as_dvec3().to_array().map(|r| r * 2.0 * PI.sqrt());
            }
            Environment::LatLong(map) => {
                let size = map.picture.size();
                for y in 0..size.height {
                    let (top, bottom) = row_heights(size, y);
                    let z = 0.5 * (top + bottom);
                    let r = (1.0 - z * z).sqrt();
                    for x in 0..size.width {
                        let angle = PI - TAU * (x as f64 + 0.5) / size.width as f64;
                        let direction = DVec3::new(r * angle.cos(), r * angle.sin(), z);
                        let solid = pixel_solid_angle(size, y);
                        let rgb = map.picture[(x, y)].map(|v| f64::from(v) * solid);
                        add_direction(&mut out, direction, rgb);
                    }
                }
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Rng;

    fn map() -> LatLong {
        let size = Size::new(24, 12);
        let value = |i: usize| {
            let (x, y) = (i % 24, i / 24);
            let spot = if x == 7 && y == 3 { 40.0 } else { 0.0 };
            [0.2 + 0.02 * x as f32, 0.3 + 0.01 * y as f32, 0.1 + spot]
        };
        let picture = Image::from_vec(size, (0..size.pixels()).map(value).collect());
        LatLong::new(picture).expect("a picture")
    }

    #[test]
    fn lat_long_samples_match_their_density_and_give_the_integral() {
        let map = map();
        let mut rng = Rng::new(&[31]);
        let n = 40_000;
        let mut sum = DVec3::ZERO;
        for _ in 0..n {
            let sample = map.sample(Vec2::new(rng.uniform(), rng.uniform()));
            assert!((sample.direction.length() - 1.0).abs() < 1e-5);
            sum += (sample.radiance / sample.pdf).as_dvec3();
            // On a pixel's border rounding may choose the neighbour.
            let (again, pdf) = (map.radiance(sample.direction), map.pdf(sample.direction));
            if again == sample.radiance {
                assert!((pdf / sample.pdf - 1.0).abs() < 1e-4);
            }
        }
        let integral = Environment::LatLong(map).sh()[0].map(|c| c * 2.0 * PI.sqrt());
        let found = (sum / f64::from(n)).to_array();
        for (f, e) in found.iter().zip(integral) {
            // samples follow luminance; the channels' own spread over 40000 is below 1 %
            assert!((f / e - 1.0).abs() < 0.03, "{found:?} {integral:?}");
        }
    }

    #[test]
    fn a_spot_in_the_picture_is_where_the_harmonics_say() {
        let map = map();
        let (u, v) = (7.5 / 24.0, 3.5 / 12.0);
        let (azimuth, polar) = (PI - TAU * u, PI * v);
        let towards =
            DVec3::new(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos());
        assert!(map.radiance(towards.as_vec3a()).z > 40.0);
        let [_, y, z, x, ..] = Environment::LatLong(map).sh().map(|c| c[2]);
        // blue is even but for the spot, whose pixel is 15 degrees wide
        assert!(DVec3::new(x, y, z).normalize().dot(towards) > 0.999);
    }

    #[test]
    fn empty_pictures_are_refused_and_broken_values_are_black() {
        assert!(LatLong::new(Image::default()).is_none());
        let broken = Image::new(Size::new(2, 1), [f32::NAN, f32::INFINITY, -1.0]);
        let map = LatLong::new(broken).expect("a picture");
        let sample = map.sample(Vec2::new(0.999_999, 0.5));
        assert_eq!(sample.radiance, Vec3A::ZERO);
        assert!(sample.pdf.is_finite() && sample.pdf > 0.0);
    }
}
