//! Shapes in their own axes, met by rays with exact formulas.

use super::mesh::Mesh;
use crate::math::bvh::{Aabb, Ray};
use glam::{Vec2, Vec3A};
use std::sync::Arc;

/// Lengths in metres.
#[derive(Clone, Debug)]
pub enum Shape {
    /// Around the origin.
    Ellipsoid {
        radii: Vec3A,
    },
    /// Around the origin.
    Box {
        half: Vec3A,
    },
    /// In the plane z = 0 around the origin, seen from both sides.
    Quad {
        half: Vec2,
    },
    /// Closed cylinder or truncated cone about +z, from z = 0 to `height`.
    Frustum {
        bottom_radius: f32,
        top_radius: f32,
        height: f32,
    },
    Mesh(Arc<Mesh>),
}

/// Where a ray meets a shape, in the shape's axes.
#[derive(Clone, Copy, Debug)]
pub struct ShapeHit {
    pub t: f32,
    /// Unit geometric normal, outwards.
    pub normal: Vec3A,
    /// Triangle and barycentric weights of its second and third corner; of meshes only.
    pub triangle: u32,
    pub weights: Vec2,
}

impl ShapeHit {
    fn new(t: f32, normal: Vec3A) -> Self {
        Self { t, normal, triangle: 0, weights: Vec2::ZERO }
    }
}

impl Shape {
    pub fn sphere(radius: f32) -> Self {
        Self::Ellipsoid { radii: Vec3A::splat(radius) }
    }

    pub fn cylinder(radius: f32, height: f32) -> Self {
        Self::Frustum { bottom_radius: radius, top_radius: radius, height }
    }

    /// Box with these full side lengths.
    pub fn block(x: f32, y: f32, z: f32) -> Self {
        Self::Box { half: Vec3A::new(x, y, z) * 0.5 }
    }

    pub fn bounds(&self) -> Aabb {
        match *self {
            Shape::Ellipsoid { radii: half } | Shape::Box { half } => {
                Aabb { min: -half, max: half }
            }
            Shape::Quad { half } => {
                let half = Vec3A::new(half.x, half.y, 0.0);
                Aabb { min: -half, max: half }
            }
            Shape::Frustum { bottom_radius, top_radius, height } => {
                let r = bottom_radius.max(top_radius);
                Aabb { min: Vec3A::new(-r, -r, 0.0), max: Vec3A::new(r, r, height) }
            }
            Shape::Mesh(ref mesh) => mesh.bounds(),
        }
    }

    /// The nearest hit with 0 < t < `t_max`, from outside or inside.
    pub fn hit(&self, ray: &Ray, t_max: f32) -> Option<ShapeHit> {
        match *self {
            Shape::Ellipsoid { radii } => hit_ellipsoid(ray, radii, t_max),
            Shape::Box { half } => hit_box(ray, half, t_max),
            Shape::Quad { half } => {
                let t = -ray.origin.z / ray.direction.z;
                let p = ray.at(t);
                (t > 0.0 && t < t_max && p.x.abs() <= half.x && p.y.abs() <= half.y)
                    .then(|| ShapeHit::new(t, Vec3A::Z))
            }
            Shape::Frustum { bottom_radius, top_radius, height } => {
                hit_frustum(ray, bottom_radius, top_radius, height, t_max)
            }
            Shape::Mesh(ref mesh) => mesh.hit(ray, t_max).map(|hit| ShapeHit {
                t: hit.t,
                normal: mesh.face_normal(hit.triangle),
                triangle: hit.triangle,
                weights: hit.weights,
            }),
        }
    }
}

fn hit_ellipsoid(ray: &Ray, radii: Vec3A, t_max: f32) -> Option<ShapeHit> {
    // In the axes where it is the unit sphere. The discriminant is taken from the ray's nearest
    // point to the centre, which does not cancel for far origins (Haines et al. 2019).
    let (o, d) = (ray.origin / radii, ray.direction / radii);
    let a = d.length_squared();
    let middle = -o.dot(d) / a;
    let offset_squared = (o + d * middle).length_squared();
    if offset_squared > 1.0 {
        return None;
    }
    let half_chord = ((1.0 - offset_squared) / a).sqrt();
    let near = middle - half_chord;
    let t = if near > 0.0 { near } else { middle + half_chord };
    (t > 0.0 && t < t_max).then(|| ShapeHit::new(t, (ray.at(t) / (radii * radii)).normalize()))
}

fn hit_box(ray: &Ray, half: Vec3A, t_max: f32) -> Option<ShapeHit> {
    let (a, b) = ((-half - ray.origin) / ray.direction, (half - ray.origin) / ray.direction);
    let (enter, exit) = (a.min(b), a.max(b));
    let (near, far) = (enter.max_element(), exit.min_element());
    if near > far {
        return None;
    }
    let (t, slabs) = if near > 0.0 { (near, enter) } else { (far, exit) };
    if !(t > 0.0 && t < t_max) {
        return None;
    }
    let axis = slabs.to_array().iter().position(|&v| v == t)?;
    let mut normal = Vec3A::ZERO;
    let sign = ray.direction[axis].signum();
    normal[axis] = if near > 0.0 { -sign } else { sign };
    Some(ShapeHit::new(t, normal))
}

fn hit_frustum(ray: &Ray, bottom: f32, top: f32, height: f32, t_max: f32) -> Option<ShapeHit> {
    let (o, d) = (ray.origin, ray.direction);
    let slope = (top - bottom) / height;
    let mut best: Option<ShapeHit> = None;
    let mut offer = |t: f32, normal: Vec3A| {
        if t > 0.0 && t < best.map_or(t_max, |h| h.t) {
            best = Some(ShapeHit::new(t, normal));
        }
    };
    for (z, radius, normal) in [(0.0, bottom, -Vec3A::Z), (height, top, Vec3A::Z)] {
        let t = (z - o.z) / d.z;
        let p = ray.at(t);
        if p.x * p.x + p.y * p.y <= radius * radius {
            offer(t, normal);
        }
    }
    // Side: x^2 + y^2 = (bottom + slope z)^2.
    let (r, dr) = (bottom + slope * o.z, slope * d.z);
    let a = d.x * d.x + d.y * d.y - dr * dr;
    let b = o.x * d.x + o.y * d.y - r * dr;
    let c = o.x * o.x + o.y * o.y - r * r;
    let discriminant = b * b - a * c;
    if discriminant >= 0.0 && a != 0.0 {
        let q = -(b + b.signum() * discriminant.sqrt());
        for t in [q / a, c / q] {
            let p = ray.at(t);
            if p.z >= 0.0 && p.z <= height && bottom + slope * p.z >= 0.0 {
                let outwards = Vec3A::new(p.x, p.y, 0.0).normalize_or_zero();
                offer(t, (outwards - Vec3A::Z * slope).normalize());
            }
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Rng;

    /// Signed value that is zero on the surface, from each shape's definition.
    fn implicit(shape: &Shape, p: Vec3A) -> f32 {
        match *shape {
            Shape::Ellipsoid { radii } => (p / radii).length() - 1.0,
            Shape::Box { half } => (p.abs() - half).max_element(),
            Shape::Frustum { bottom_radius, top_radius, height } => {
                let r = bottom_radius + (top_radius - bottom_radius) * p.z / height;
                (p.x.hypot(p.y) - r).max(p.z - height).max(-p.z)
            }
            _ => unreachable!("not tested here"),
        }
    }

    #[test]
    fn hits_lie_on_the_surface_and_nothing_lies_before_them() {
        let shapes = [
            Shape::Ellipsoid { radii: Vec3A::new(0.5, 0.2, 0.3) },
            Shape::block(0.4, 0.8, 0.6),
            Shape::cylinder(0.3, 0.7),
            Shape::Frustum { bottom_radius: 0.4, top_radius: 0.0, height: 0.6 },
            Shape::Frustum { bottom_radius: 0.1, top_radius: 0.5, height: 0.4 },
        ];
        let mut rng = Rng::new(&[11]);
        let mut point =
            || Vec3A::new(rng.uniform(), rng.uniform(), rng.uniform()) * 2.4 - Vec3A::splat(1.2);
        for shape in &shapes {
            let (mut hits, mut misses) = (0, 0);
            for _ in 0..3000 {
                let ray = Ray::new(point(), point());
                let outside = implicit(shape, ray.origin) > 0.0;
                let end = match shape.hit(&ray, f32::INFINITY) {
                    Some(hit) => {
                        hits += 1;
                        let p = ray.at(hit.t);
                        // f32 rounding of metre-sized coordinates, through one root
                        assert!(implicit(shape, p).abs() < 2e-5, "{shape:?} {p}");
                        assert!((hit.normal.length() - 1.0).abs() < 1e-5);
                        assert_eq!(hit.normal.dot(ray.direction) < 0.0, outside, "{shape:?} {p}");
                        hit.t
                    }
                    None => {
                        misses += 1;
                        assert!(outside, "a ray cannot leave {shape:?} unseen");
                        3.0
                    }
                };
                for k in 1..60 {
                    let value = implicit(shape, ray.at(end * k as f32 / 60.0));
                    assert!(value.abs() < 2e-5 || (value > 0.0) == outside, "{shape:?} missed");
                }
            }
            assert!(hits > 100 && misses > 100, "{hits} {misses}");
        }
    }
}
