//! Scenes of planes, spheres and boxes with exact depth and normals, for tests and benchmarks.

use crate::geometry::{GBuffer, Origin};
use crate::math::View;
use glam::{Vec2, Vec3};

#[derive(Clone, Copy, Debug)]
pub enum Shape {
    /// Points with `normal . p = offset`; seen from the side that the unit normal points to.
    Plane {
        normal: Vec3,
        offset: f32,
    },
    Sphere {
        centre: Vec3,
        radius: f32,
    },
    /// Axis-aligned box.
    Box {
        min: Vec3,
        max: Vec3,
    },
}

#[derive(Clone, Debug, Default)]
pub struct AnalyticScene {
    pub shapes: Vec<Shape>,
}

impl AnalyticScene {
    pub fn new(shapes: impl Into<Vec<Shape>>) -> Self {
        Self { shapes: shapes.into() }
    }

    /// A floor at z = 0, a wall, a box and a ball within 2 m around the origin: all six motions of
    /// a camera that sees it are observable.
    pub fn corner() -> Self {
        Self::new([
            Shape::Plane { normal: Vec3::Z, offset: 0.0 },
            Shape::Plane { normal: -Vec3::Y, offset: -0.9 },
            Shape::Plane { normal: Vec3::X, offset: -0.9 },
            Shape::Box { min: Vec3::new(-0.4, -0.1, 0.0), max: Vec3::new(-0.1, 0.25, 0.3) },
            Shape::Sphere { centre: Vec3::new(0.3, 0.1, 0.22), radius: 0.22 },
        ])
    }

    /// Nearest hit along a ray: distance in units of `direction`'s length, and unit normal.
    pub fn hit(&self, origin: Vec3, direction: Vec3) -> Option<(f32, Vec3)> {
        self.shapes
            .iter()
            .filter_map(|shape| shape.hit(origin, direction))
            .min_by(|a, b| a.0.total_cmp(&b.0))
    }

    pub fn render(&self, view: &View) -> GBuffer {
        let mut out = GBuffer::empty(*view);
        let world_from_view = view.world_from_view_f32();
        let size = view.size();
        for y in 0..size.height {
            for x in 0..size.width {
                let pixel = Vec2::new(x as f32, y as f32);
                // A step of 1 along this direction is 1 m of depth, so t is depth itself.
                let (near, far) = (view.unproject(pixel, 0.0), view.unproject(pixel, 1.0));
                let origin = world_from_view.transform_point3(near);
                let direction = world_from_view.transform_vector3(far - near);
                if let Some((depth, normal)) = self.hit(origin, direction) {
                    out.depth_m[(x, y)] = depth;
                    out.normals.set(x, y, normal);
                    out.origin[(x, y)] = Origin::Model;
                }
            }
        }
        out
    }
}

impl Shape {
    fn hit(&self, origin: Vec3, direction: Vec3) -> Option<(f32, Vec3)> {
        match *self {
            Shape::Plane { normal, offset } => {
                let facing = normal.dot(direction);
                let t = (offset - normal.dot(origin)) / facing;
                (facing < 0.0 && t > 0.0).then_some((t, normal))
            }
            Shape::Sphere { centre, radius } => {
                let (o, d) = (origin.as_dvec3() - centre.as_dvec3(), direction.as_dvec3());
                let (a, b) = (d.length_squared(), o.dot(d));
                let c = o.length_squared() - f64::from(radius).powi(2);
                let root = (b * b - a * c).sqrt(); // NaN where missed
                let t = (-b - root) / a;
                (t > 0.0).then(|| (t as f32, ((o + d * t) / f64::from(radius)).as_vec3()))
            }
            Shape::Box { min, max } => {
                let (t0, t1) = ((min - origin) / direction, (max - origin) / direction);
                let enter = t0.min(t1);
                let t = enter.max_element();
                let axis = enter.to_array().iter().position(|&v| v == t)?;
                let mut normal = Vec3::ZERO;
                normal[axis] = -direction[axis].signum();
                (t > 0.0 && t <= t0.max(t1).min_element()).then_some((t, normal))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Orthographic, Pinhole, Pose, Projection};

    #[test]
    fn depth_is_z_not_ray_length() {
        let wall = AnalyticScene::new([Shape::Plane { normal: -Vec3::Z, offset: -2.0 }]);
        let camera = Pinhole { width: 64, height: 48, fx: 50.0, fy: 50.0, cx: 31.5, cy: 23.5 };
        let ortho = Orthographic { width: 8, height: 8, pixels_per_m: 4.0, cx: 3.5, cy: 3.5 };
        for projection in [Projection::Perspective(camera), Projection::Orthographic(ortho)] {
            let out = wall.render(&View { projection, world_from_view: Pose::identity() });
            assert!(out.depth_m.as_slice().iter().all(|d| (d - 2.0).abs() < 1e-6));
            assert_eq!(out.normals.at(3, 5), -Vec3::Z);
        }
    }
}
