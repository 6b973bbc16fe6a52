//! What the pixels of a geometry buffer radiate: the source of the indirect bounce.

use super::ShLight;
use crate::compositing::VirtualLayer;
use crate::geometry::{GBuffer, Origin};
use crate::image::Image;
use crate::math::sh;
use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;

/// The light of one direction, as the paper's bounce takes it (Gruber et al. 2015, Eq. 10): the
/// directional light whose band 1 equals that of the estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DominantLight {
    pub towards_light: Vec3,
    /// Irradiance on a surface that faces the light, linear RGB; times the scene's mean albedo.
    pub irradiance: [f32; 3],
}

impl DominantLight {
    /// `None` where band 1 is zero. A directional light of irradiance E has coefficients E Y(w).
    pub fn of(light: &ShLight) -> Option<Self> {
        let towards_light = light.dominant_direction()?;
        let basis = sh::basis(towards_light, 2);
        let squared: f32 = basis[1..4].iter().map(|y| y * y).sum();
        let irradiance = std::array::from_fn(|channel| {
            let along: f32 = (1..4).map(|i| light.coefficients[i][channel] * basis[i]).sum();
            (along / squared).max(0.0)
        });
        Some(Self { towards_light, irradiance })
    }
}

/// Outgoing linear radiance of every pixel of `buffer`.
///
/// Real surfaces radiate what the camera saw of them (`camera_color`, of the same size, or none for
/// a view that has no colour: then they are dark, and only virtual surfaces bounce into the
/// picture). Virtual surfaces reflect the dominant light diffusely by their albedo.
pub fn exitant_radiance(
    buffer: &GBuffer,
    layer: &VirtualLayer,
    camera_color: Option<&Image<[f32; 3]>>,
    light: Option<DominantLight>,
    mean_albedo: f32,
    out: &mut Image<[f32; 3]>,
) {
    let size = buffer.size();
    out.reshape(size, [0.0; 3]);
    let all = (0..size.width, 0..size.height);
    exitant_radiance_within(all, buffer, layer, camera_color, light, mean_albedo, out);
}

/// As [`exitant_radiance`], for these columns and rows; the rest of `out`, which must have the size of
/// `buffer`, stays.
pub fn exitant_radiance_within(
    (columns, rows): (Range<usize>, Range<usize>),
    buffer: &GBuffer,
    layer: &VirtualLayer,
    camera_color: Option<&Image<[f32; 3]>>,
    light: Option<DominantLight>,
    mean_albedo: f32,
    out: &mut Image<[f32; 3]>,
) {
    assert_eq!(out.size(), buffer.size(), "radiance of the buffer");
    let scale = std::f32::consts::FRAC_1_PI / mean_albedo;
    out.par_rows_mut().skip(rows.start).take(rows.len()).with_min_len(16).for_each(|(y, row)| {
        let origins = buffer.origin.row(y);
        for x in columns.clone() {
            row[x] = match (origins[x], camera_color, light) {
                (Origin::Virtual, _, Some(light)) => {
                    let cosine = buffer.normals.at(x, y).dot(light.towards_light).max(0.0);
                    let albedo = layer.albedo[(x, y)];
                    std::array::from_fn(|c| albedo[c] * light.irradiance[c] * cosine * scale)
                }
                (Origin::Model | Origin::Sensor, Some(color), _) => color[(x, y)],
                _ => [0.0; 3],
            };
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_directional_light_is_found_again() {
        let towards = Vec3::new(0.6, -0.48, 0.64);
        let basis = sh::basis(towards, 4);
        let light = ShLight {
            bands: 4,
            coefficients: basis[..16].iter().map(|y| [3.0 * y, 2.0 * y, 0.0]).collect(),
        };
        let found = DominantLight::of(&light).unwrap();
        assert!(found.towards_light.dot(towards) > 0.999_999);
        // one rounding per term of three
        assert!(
            (found.irradiance[0] - 3.0).abs() < 1e-5 && (found.irradiance[1] - 2.0).abs() < 1e-5
        );
        assert!(
            DominantLight::of(&ShLight {
                bands: 2,
                coefficients: vec![[1.0; 3], [0.0; 3], [0.0; 3], [0.0; 3]]
            })
            .is_none()
        );
    }
}
