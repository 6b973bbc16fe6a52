//! Finds the surface that an object stands on: a robust plane around a pixel of a geometry buffer.

use super::objects::Similarity;
use crate::geometry::{GBuffer, Origin};
use crate::math::{Pose, View};
use glam::{DVec3, Vec2, Vec3};

/// Half the side of the window of pixels that the plane is fitted to.
const WINDOW_RADIUS: isize = 10;
/// Fewer surface points than this, or than this share of the window, are no support for a plane.
const MIN_POINTS: usize = 12;
const MIN_SHARE: f32 = 0.3;
/// Rounds of least squares over the inliers.
const REFINEMENTS: usize = 3;

/// Where an object is to stand, until that surface is seen.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceAnchor {
    pub pixel: Vec2,
    /// Nothing is tried before this frame.
    pub frame: usize,
    pub yaw_rad: f32,
    pub scale: f32,
    /// Instead of the surface normal; unit.
    pub up: Option<Vec3>,
    warned: bool,
}

/// Point and unit normal towards the viewer, world axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    pub position: Vec3,
    pub normal: Vec3,
}

impl SurfaceAnchor {
    pub fn new(pixel: Vec2, frame: usize, yaw_rad: f32, scale: f32, up: Option<Vec3>) -> Self {
        Self { pixel, frame, yaw_rad, scale, up, warned: false }
    }

    /// `world_from_object` once the surface is seen; the first failure is logged.
    pub(super) fn resolve(
        &mut self,
        frame: usize,
        surface: &GBuffer,
        name: &str,
    ) -> Option<Similarity> {
        if frame < self.frame {
            return None;
        }
        match surface_at(surface, self.pixel) {
            Ok(found) => {
                let up = self.up.unwrap_or(found.normal);
                log::info!("{name} stands at {} since frame {frame}", found.position);
                Some(Similarity::standing(found.position, up, self.yaw_rad, self.scale))
            }
            Err(why) => {
                if !std::mem::replace(&mut self.warned, true) {
                    let (u, v) = (self.pixel.x, self.pixel.y);
                    log::warn!(
                        "{name} cannot stand on pixel {u}, {v} of frame {frame}: {why}; \
                         the same pixel is tried in the next frames"
                    );
                }
                None
            }
        }
    }
}

/// The plane around `pixel`, met by the pixel's ray. Virtual surfaces do not count.
///
/// Every pixel of the window proposes the plane of its depth and normal; the one with most points
/// near it is refined by least squares. It must hold the surface seen at the pixel itself, so that
/// an object is not put on the table behind a cup's handle.
pub fn surface_at(surface: &GBuffer, pixel: Vec2) -> Result<SurfacePoint, &'static str> {
    let size = surface.size();
    let (x, y) = (pixel.x.round(), pixel.y.round());
    let inside = x >= 0.0 && y >= 0.0 && x < size.width as f32 && y < size.height as f32;
    if !inside {
        return Err("it lies outside the picture");
    }
    let (x, y) = (x as isize, y as isize);
    let window = Window::gather(surface, x, y);
    let centre = window.centre.ok_or("there is no depth")?;
    if window.points.len() < MIN_POINTS || (window.points.len() as f32) < MIN_SHARE * window.area {
        return Err("there is too little depth around it");
    }
    // Three standard deviations of a structured-light sensor, sigma = 1.425e-3 z^2 (Khoshelham and
    // Elberink 2012), and 1 mm for what the volume rounds off.
    let depth = surface.depth_m[(x as usize, y as usize)];
    let tolerance = f64::from(0.001 + 3.0 * 1.425e-3 * depth * depth);
    let mut plane = window.best_plane(centre, tolerance).ok_or("no plane fits around it")?;
    for _ in 0..REFINEMENTS {
        plane = window.refined(plane, tolerance).ok_or("no plane fits around it")?;
    }
    plane.meet_ray(&surface.view, pixel).ok_or("the surface is seen edge-on")
}

/// Points with `normal . p = offset`.
#[derive(Clone, Copy)]
struct Plane {
    normal: DVec3,
    offset: f64,
}

impl Plane {
    fn distance(&self, p: DVec3) -> f64 {
        (self.normal.dot(p) - self.offset).abs()
    }

    fn meet_ray(&self, view: &View, pixel: Vec2) -> Option<SurfacePoint> {
        let world_from_view = |p: Vec3| transform(&view.world_from_view, p);
        let origin = world_from_view(view.unproject(pixel, 0.0));
        let direction = world_from_view(view.unproject(pixel, 1.0)) - origin;
        let facing = self.normal.dot(direction);
        // 3 degrees from edge-on: the crossing would be anywhere along the ray
        if facing.abs() < 0.05 * direction.length() {
            return None;
        }
        let t = (self.offset - self.normal.dot(origin)) / facing;
        let normal = if facing > 0.0 { -self.normal } else { self.normal };
        (t > 0.0).then(|| SurfacePoint {
            position: (origin + direction * t).as_vec3(),
            normal: normal.as_vec3().normalize(),
        })
    }
}

struct Window {
    /// World positions and normals; the normal is zero where the buffer has none.
    points: Vec<(DVec3, DVec3)>,
    centre: Option<DVec3>,
    area: f32,
}

impl Window {
    fn gather(surface: &GBuffer, x: isize, y: isize) -> Self {
        let size = surface.size();
        let range = |c: isize, n: usize| {
            (c - WINDOW_RADIUS).max(0)..(c + WINDOW_RADIUS + 1).min(n as isize)
        };
        let mut window = Self { points: Vec::new(), centre: None, area: 0.0 };
        for v in range(y, size.height) {
            for u in range(x, size.width) {
                window.area += 1.0;
                let (px, py) = (u as usize, v as usize);
                let depth = surface.depth_m[(px, py)];
                if !(depth > 0.0) || surface.origin[(px, py)] == Origin::Virtual {
                    continue;
                }
                let in_view = surface.view.unproject(Vec2::new(u as f32, v as f32), depth);
                let point = transform(&surface.view.world_from_view, in_view);
                window.points.push((point, surface.normals.at(px, py).as_dvec3()));
                if (u, v) == (x, y) {
                    window.centre = Some(point);
                }
            }
        }
        window
    }

    fn best_plane(&self, centre: DVec3, tolerance: f64) -> Option<Plane> {
        let proposals = self.points.iter().filter_map(|&(p, n)| {
            let normal = n.try_normalize()?;
            let plane = Plane { normal, offset: normal.dot(p) };
            (plane.distance(centre) <= tolerance).then_some(plane)
        });
        let support = |plane: &Plane| {
            self.points.iter().filter(|(p, _)| plane.distance(*p) <= tolerance).count()
        };
        let (count, plane) = proposals
            .map(|plane| (support(&plane), plane))
            .reduce(|a, b| if b.0 > a.0 { b } else { a })?;
        (count >= MIN_POINTS).then_some(plane)
    }

    /// Least squares over the points near `plane`: through their mean, across their least extent.
    fn refined(&self, plane: Plane, tolerance: f64) -> Option<Plane> {
        let near = || self.points.iter().map(|p| p.0).filter(|&p| plane.distance(p) <= tolerance);
        let count = near().count();
        let mean = near().sum::<DVec3>() / count as f64;
        let mut covariance = nalgebra::Matrix3::<f64>::zeros();
        for p in near() {
            let d = p - mean;
            let d = nalgebra::Vector3::new(d.x, d.y, d.z);
            covariance += d * d.transpose();
        }
        let eigen = covariance.symmetric_eigen();
        let axis = eigen.eigenvectors.column(eigen.eigenvalues.imin());
        let normal = DVec3::new(axis[0], axis[1], axis[2]).try_normalize()?;
        (count >= MIN_POINTS).then(|| Plane { normal, offset: normal.dot(mean) })
    }
}

fn transform(world_from_view: &Pose, p: Vec3) -> DVec3 {
    let p = world_from_view * nalgebra::Point3::new(p.x, p.y, p.z).cast::<f64>();
    DVec3::new(p.x, p.y, p.z)
}
