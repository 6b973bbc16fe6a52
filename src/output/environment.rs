//! `environment.hdr`: the light as a latitude-longitude Radiance picture.

use super::{OutputError, atomic_write, from_encoder};
use crate::image::{Image, Size};
use crate::lighting::ShLight;
use crate::math::sh;
use glam::DVec3;
use image::codecs::hdr::HdrEncoder;
use rayon::prelude::*;
use std::path::Path;

/// How directions lie in a latitude-longitude picture.
///
/// The picture is what one sees standing in the scene and turning around (not mirrored): the top
/// row is up, the centre column is `forward`, directions to the left of it lie left in the picture,
/// and the seam between its left and right rim is `-forward`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Panorama {
    up: DVec3,
    forward: DVec3,
    left: DVec3,
}

impl Panorama {
    /// World z up, x in the middle, y a quarter of the width left of it, the seam at -x.
    pub fn z_up() -> Self {
        Self { up: DVec3::Z, forward: DVec3::X, left: DVec3::Y }
    }

    /// Another up direction. The middle is the first of the axes x, y, z that is at least 45 degrees
    /// away from it, brought to the horizon. `None` where `up` is zero or not finite.
    pub fn with_up(up: glam::Vec3) -> Option<Self> {
        let up = up.as_dvec3().try_normalize()?;
        let far_from_up = |axis: &DVec3| axis.dot(up).abs() < 0.71;
        let axis = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().find(far_from_up)?;
        let forward = (axis - up * axis.dot(up)).try_normalize()?;
        Some(Self { up, forward, left: up.cross(forward) })
    }

    /// World direction seen at a pixel centre, unit.
    pub fn direction(&self, x: usize, y: usize, size: Size) -> DVec3 {
        use std::f64::consts::PI;
        let from_up = PI * (y as f64 + 0.5) / size.height as f64;
        let to_left = PI - 2.0 * PI * (x as f64 + 0.5) / size.width as f64;
        let level = self.forward * to_left.cos() + self.left * to_left.sin();
        self.up * from_up.cos() + level * from_up.sin()
    }

    /// The light as a picture of `2 height` x `height` pixels: linear RGB radiance, times the scene's
    /// mean albedo as every estimated light. Spherical harmonics of few bands swing below zero
    /// opposite a strong light; there the picture is clamped to 0.
    pub fn render(&self, light: &ShLight, height: usize) -> Image<[f32; 3]> {
        let size = Size::new(2 * height, height);
        let mut out = Image::new(size, [0.0; 3]);
        out.par_rows_mut().for_each(|(y, row)| {
            for (x, out) in row.iter_mut().enumerate() {
                *out = radiance(light, self.direction(x, y, size)).map(|v| v.max(0.0) as f32);
            }
        });
        out
    }
}

/// Writes [`Panorama::render`] as a Radiance RGBE file.
pub fn write_environment(
    path: &Path,
    light: &ShLight,
    panorama: Panorama,
    height: usize,
) -> Result<(), OutputError> {
    let bands = 1..=sh::MAX_BANDS;
    if !bands.contains(&light.bands) || light.coefficients.len() != light.bands * light.bands {
        let (count, bands) = (light.coefficients.len(), light.bands);
        let problem = format!("a light of {count} coefficients in {bands} bands");
        return Err(OutputError::content(path, problem));
    }
    if height == 0 || light.coefficients.as_flattened().iter().any(|c| !c.is_finite()) {
        return Err(OutputError::content(path, "an empty picture, or a light that is not finite"));
    }
    let picture = panorama.render(light, height);
    let pixels: Vec<_> = picture.as_slice().iter().map(|&rgb| image::Rgb(rgb)).collect();
    atomic_write(path, |w| {
        HdrEncoder::new(w).encode(&pixels, picture.width(), picture.height()).map_err(from_encoder)
    })
}

fn radiance(light: &ShLight, direction: DVec3) -> [f64; 3] {
    let mut basis = [0.0; sh::MAX_COEFFICIENTS];
    sh::basis_f64(direction, light.bands, &mut basis);
    let mut sum = [0.0; 3];
    for (y, coefficient) in basis.iter().zip(&light.coefficients) {
        for k in 0..3 {
            sum[k] += y * f64::from(coefficient[k]);
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn named_directions_lie_where_the_documentation_says() {
        let size = Size::new(64, 32);
        let p = Panorama::z_up();
        let near = |x: usize, y: usize, d: DVec3| p.direction(x, y, size).dot(d) > 0.99;
        assert!(near(10, 0, DVec3::Z) && near(50, 31, -DVec3::Z));
        assert!(near(32, 16, DVec3::X), "{}", p.direction(32, 16, size));
        assert!(near(16, 16, DVec3::Y) && near(48, 16, -DVec3::Y));
        assert!(near(0, 16, -DVec3::X) && near(63, 16, -DVec3::X));
    }

    #[test]
    fn any_up_axis_gives_a_right_handed_frame() {
        assert_eq!(Panorama::with_up(Vec3::Z), Some(Panorama::z_up()));
        for up in [Vec3::Y, -Vec3::Y, Vec3::X, Vec3::new(1.0, 1.0, 1.0), Vec3::new(3.0, 3.0, 0.0)] {
            let p = Panorama::with_up(up).unwrap();
            assert!(p.forward.cross(p.left).dot(p.up) > 1.0 - 1e-12);
            assert!(p.up.dot(up.as_dvec3().normalize()) > 1.0 - 1e-12);
        }
        assert_eq!(Panorama::with_up(Vec3::ZERO), None);
        assert_eq!(Panorama::with_up(Vec3::splat(f32::NAN)), None);
    }

    #[test]
    fn the_file_shows_the_light() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("environment.hdr");
        // ambient 1 plus a swing along +y, in red only
        let mut coefficients = vec![[1.0 / 0.282_094_8; 3], [0.0; 3], [0.0; 3], [0.0; 3]];
        coefficients[1][0] = 3.0 / 0.488_602_5;
        let light = ShLight { bands: 2, coefficients };
        write_environment(&path, &light, Panorama::z_up(), 32).unwrap();
        let back = image::open(&path).unwrap().to_rgb32f();
        assert_eq!(back.dimensions(), (64, 32));
        let p = Panorama::z_up();
        for (x, y, pixel) in back.enumerate_pixels() {
            let d = p.direction(x as usize, y as usize, Size::new(64, 32));
            let red = (1.0 + 3.0 * d.y).max(0.0) as f32;
            // RGBE keeps 8 bits of the largest channel
            let step = red.max(1.0) / 128.0;
            assert!((pixel[0] - red).abs() <= step, "{} against {red}", pixel[0]);
            assert!((pixel[1] - 1.0).abs() <= step && (pixel[2] - 1.0).abs() <= step);
        }
        assert!(back.pixels().any(|p| p[0] == 0.0), "clamped opposite the light");
    }

    #[test]
    fn broken_lights_are_refused() {
        let path = Path::new("environment.hdr");
        let write = |bands, coefficients| {
            write_environment(path, &ShLight { bands, coefficients }, Panorama::z_up(), 8)
        };
        assert!(write(2, vec![[1.0; 3]]).is_err());
        assert!(write(0, vec![]).is_err());
        assert!(write(1, vec![[f32::NAN; 3]]).is_err());
        assert!(!path.exists());
    }
}
