//! Light that depends on the place.

use super::ShLight;
use super::lamp::{Lamp, LampField};
use glam::Vec3;

/// The light of a lamp with a place, and light that is the same everywhere.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightField {
    pub(super) lamp: Option<LampField>,
    /// What comes on top of the lamp.
    pub(super) rest: ShLight,
}

impl LightField {
    pub fn uniform(light: ShLight) -> Self {
        Self { lamp: None, rest: light }
    }

    /// In the world of the surfaces that it was found from.
    pub fn lamp(&self) -> Option<Lamp> {
        self.lamp.as_ref().map(|field| field.lamp)
    }

    /// The light at a point; without one, in the middle of the surfaces that it was found from.
    pub fn at(&self, point: Option<Vec3>) -> ShLight {
        let Some(field) = &self.lamp else { return self.rest.clone() };
        let n = self.rest.coefficients.len();
        let lamp = field.light_at(point.unwrap_or(field.centre), n);
        let coefficients = (0..n)
            .map(|i| {
                let channel = |c: usize| lamp[c.min(lamp.len() - 1)][i] as f32;
                std::array::from_fn(|c| self.rest.coefficients[i][c] + channel(c))
            })
            .collect();
        ShLight { bands: self.rest.bands, coefficients }
    }

    /// Moves everything by an offset.
    pub fn translated(mut self, offset: Vec3) -> Self {
        if let Some(field) = &mut self.lamp {
            field.centre += offset;
            if let Lamp::Near { position } = &mut field.lamp {
                *position += offset;
            }
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_near_lamp_falls_off_with_the_square_and_shows_its_parallax() {
        let lamp = LampField {
            lamp: Lamp::Near { position: Vec3::new(0.0, 0.0, 2.0) },
            centre: Vec3::ZERO,
            channels: vec![(0.0, 1.0)],
        };
        let rest = ShLight { bands: 2, coefficients: vec![[0.0; 3]; 4] };
        let field = LightField { lamp: Some(lamp), rest };
        let (centre, half_way) = (field.at(None), field.at(Some(Vec3::Z)));
        for (a, b) in centre.coefficients.iter().zip(&half_way.coefficients) {
            assert!((4.0 * a[0] - b[0]).abs() < 1e-6);
        }
        let aside = field.at(Some(Vec3::new(2.0, 0.0, 0.0))).dominant_direction().unwrap();
        assert!(aside.distance(Vec3::new(-1.0, 0.0, 1.0).normalize()) < 1e-6);
        let moved = field.clone().translated(Vec3::new(1.0, 2.0, 3.0));
        assert_eq!(moved.at(Some(Vec3::new(1.0, 2.0, 4.0))), half_way);
        assert_eq!(LightField::uniform(centre.clone()).at(Some(Vec3::Z)), centre);
    }
}
