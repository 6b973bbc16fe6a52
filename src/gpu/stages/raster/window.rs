//! The pixels that an object may be seen in.

use crate::gpu::Window;
use crate::math::View;
use crate::scene::BoundingSphere;
use std::ops::Range;

/// Nearer than this to the view plane, a sphere may be seen anywhere.
const CLEARANCE_M: f64 = 0.01;
/// For samples beside the pixel's centre, and for rounding.
const MARGIN_PX: f64 = 2.0;

/// A rectangle around everything that is seen of a sphere; never too small.
pub fn window_of_sphere(view: &View, sphere: &BoundingSphere) -> Window {
    let centre = view.view_from_world_f32().transform_point3(sphere.centre).as_dvec3();
    let radius = f64::from(sphere.radius) * 1.0001;
    let (scale, offset) = view.scale_and_centre();
    let (scale, offset) = (scale.as_dvec2(), offset.as_dvec2());
    let size = view.size();
    let pixels = |at: f64, scale: f64, offset: f64, count: usize| -> Range<usize> {
        let (low, high) = if !view.is_perspective() {
            (at - radius, at + radius)
        } else if centre.z > radius + CLEARANCE_M {
            tangents(at, centre.z, radius)
        } else {
            return 0..count;
        };
        let (a, b) = (low * scale + offset, high * scale + offset);
        // casts saturate
        let first = (a.min(b) - MARGIN_PX).floor() as usize;
        let end = (a.max(b) + MARGIN_PX).ceil() as usize;
        first.min(count)..end.min(count)
    };
    Window {
        columns: pixels(centre.x, scale.x, offset.x, size.width),
        rows: pixels(centre.y, scale.y, offset.y, size.height),
    }
}

/// Slopes x / z of the two lines through the origin that touch a circle.
fn tangents(x: f64, z: f64, radius: f64) -> (f64, f64) {
    let squared = z * z - radius * radius;
    let reach = radius * (x * x + squared).sqrt();
    ((x * z - reach) / squared, (x * z + reach) / squared)
}

/// The smallest window around both; an empty one counts for nothing.
pub fn hull(a: Window, b: Window) -> Window {
    if a.is_empty() || b.is_empty() {
        return if a.is_empty() { b } else { a };
    }
    let around = |a: &Range<usize>, b: &Range<usize>| a.start.min(b.start)..a.end.max(b.end);
    Window { columns: around(&a.columns, &b.columns), rows: around(&a.rows, &b.rows) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Rng;
    use crate::scene::raster::tests::{moved, ortho, pinhole};
    use glam::{Vec2, Vec3};

    #[test]
    fn every_point_of_a_sphere_that_is_seen_lies_in_its_window() {
        let mut rng = Rng::new(&[41]);
        for view in [pinhole(67, 43), moved(pinhole(160, 120)), moved(ortho(67, 43, 30.0))] {
            let world_from_view = view.world_from_view_f32();
            let (mut seen, mut cut) = (0, 0);
            for _ in 0..200 {
                let place = Vec3::new(rng.normal(), rng.normal(), 3.0 * rng.uniform());
                let centre = world_from_view.transform_point3(place);
                let sphere = BoundingSphere { centre, radius: rng.uniform() };
                let window = window_of_sphere(&view, &sphere);
                cut += usize::from(window.size().pixels() < view.size().pixels());
                for _ in 0..50 {
                    let direction = Vec3::new(rng.normal(), rng.normal(), rng.normal()).normalize();
                    let point = place + direction * sphere.radius;
                    let Some(Vec2 { x, y }) = view.project(point) else { continue };
                    let [x, y] = [x, y].map(|c| c.round());
                    let size = view.size();
                    let inside = x >= 0.0 && x < size.width as f32 && y >= 0.0;
                    if inside && y < size.height as f32 {
                        seen += 1;
                        assert!(window.columns.contains(&(x as usize)), "{x} {window:?}");
                        assert!(window.rows.contains(&(y as usize)), "{y} {window:?}");
                    }
                }
            }
            assert!(seen > 300 && cut > 100, "{seen} {cut}");
        }
    }

    #[test]
    fn a_window_is_not_much_larger_than_what_is_seen() {
        // at 10 m a sphere of 0.1 m is 0.01 * 55 pixels in radius
        let sphere = BoundingSphere { centre: Vec3::new(0.0, 0.0, 10.0), radius: 0.1 };
        let window = window_of_sphere(&pinhole(67, 43), &sphere);
        assert!(window.size().width <= 8 && window.size().height <= 8, "{window:?}");
        let beside = BoundingSphere { centre: Vec3::new(9.0, 0.0, 1.0), radius: 0.1 };
        assert!(window_of_sphere(&pinhole(67, 43), &beside).is_empty());
        assert_eq!(hull(Window::default(), window.clone()), window);
    }
}
