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
/// Cosine between the plane's normal and that of a point that may lie on it (26 degrees): keeps the
/// sides of a box from tilting its top.
const MIN_NORMAL_COSINE: f64 = 0.9;
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

    /// Whether a point and its normal, where it has one, may belong to the plane.
    fn holds(&self, (p, n): (DVec3, DVec3), tolerance: f64) -> bool {
        let turned = n != DVec3::ZERO && self.normal.dot(n).abs() < MIN_NORMAL_COSINE;
        self.distance(p) <= tolerance && !turned
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
                if depth <= 0.0 || surface.origin[(px, py)] == Origin::Virtual {
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
            self.points.iter().filter(|&&point| plane.holds(point, tolerance)).count()
        };
        let (count, plane) = proposals
            .map(|plane| (support(&plane), plane))
            .reduce(|a, b| if b.0 > a.0 { b } else { a })?;
        (count >= MIN_POINTS).then_some(plane)
    }

    /// Least squares over the points near `plane`: through their mean, across their least extent.
    fn refined(&self, plane: Plane, tolerance: f64) -> Option<Plane> {
        let near = || {
            let held = self.points.iter().filter(|&&point| plane.holds(point, tolerance));
            held.map(|point| point.0)
        };
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Orthographic, Pinhole, Projection, random::Rng};
    use crate::scene::analytic::{AnalyticScene, Shape};
    use crate::scene::{Model, Placement, VirtualObject, VirtualScene};
    use std::sync::Arc;

    fn views() -> [View; 2] {
        let world_from_view = Pose::new(
            nalgebra::Vector3::new(0.1, -1.1, 0.9),
            nalgebra::Vector3::new(-2.3, 0.0, 0.1),
        );
        let pinhole = Pinhole { width: 160, height: 120, fx: 131.0, fy: 131.0, cx: 79.5, cy: 59.5 };
        let ortho =
            Orthographic { width: 160, height: 120, pixels_per_m: 100.0, cx: 79.5, cy: 59.5 };
        [Projection::Perspective(pinhole), Projection::Orthographic(ortho)]
            .map(|projection| View { projection, world_from_view })
    }

    /// Where the exact ray of a pixel that lies between pixels meets the scene.
    fn exact(scene: &AnalyticScene, view: &View, pixel: Vec2) -> SurfacePoint {
        let origin = transform(&view.world_from_view, view.unproject(pixel, 0.0)).as_vec3();
        let ahead = transform(&view.world_from_view, view.unproject(pixel, 1.0)).as_vec3();
        let (t, normal) = scene.hit(origin, ahead - origin).unwrap();
        SurfacePoint { position: origin + (ahead - origin) * t, normal }
    }

    #[test]
    fn floors_and_tilted_planes_are_found_through_noise_and_clutter() {
        let tilted = Vec3::new(0.4, -0.3, 1.0).normalize();
        for (normal, view) in [Vec3::Z, tilted].into_iter().flat_map(|n| views().map(|v| (n, v))) {
            let floor = Shape::Plane { normal, offset: 0.0 };
            let alone = AnalyticScene::new([floor]);
            let pixel = Vec2::new(83.3, 64.8);
            let expected = exact(&alone, &view, pixel);
            // A ball stands in a third of the window.
            let mut beside = expected.position;
            beside += view.world_from_view_f32().transform_vector3(Vec3::X) * 0.16;
            let ball = Shape::Sphere { centre: beside, radius: 0.13 };
            let mut surface = AnalyticScene::new([floor, ball]).render(&view);
            let found = surface_at(&surface, pixel).unwrap();
            // The foot of the ball lies within the tolerance of the plane.
            assert!(found.position.distance(expected.position) < 3e-4, "{found:?} {expected:?}");
            assert!(found.normal.dot(expected.normal) > 1.0 - 1e-5);
            let clear = surface_at(&alone.render(&view), pixel).unwrap();
            // f32 depth: 1e-7 of 1.5 m, through a least-squares fit
            assert!(clear.position.distance(expected.position) < 2e-6, "{clear:?} {expected:?}");
            assert!(clear.normal.dot(expected.normal) > 1.0 - 1e-6);

            let mut rng = Rng::new(&[23]);
            for y in 0..120 {
                for x in 0..160 {
                    let hole = rng.uniform() < 0.2;
                    let depth = &mut surface.depth_m[(x, y)];
                    *depth = if hole { 0.0 } else { *depth * (1.0 + 0.001 * rng.normal()) };
                    let bend = 0.1 * Vec3::new(rng.normal(), rng.normal(), rng.normal());
                    let noisy = (surface.normals.at(x, y) + bend).normalize();
                    surface.normals.set(x, y, noisy);
                }
            }
            surface.depth_m[(83, 65)] = expected_depth(&view, expected.position);
            let found = surface_at(&surface, pixel).unwrap();
            // 1.5 mm of noise over 200 points on 0.2 m: 0.1 mm and 0.1 degrees; five of each, and the
            // ball's foot, which lies within the tolerance of the plane
            assert!(found.position.distance(expected.position) < 2e-3, "{found:?} {expected:?}");
            assert!(found.normal.dot(expected.normal) > 0.02f32.cos(), "{found:?} {expected:?}");
        }
    }

    fn expected_depth(view: &View, position: Vec3) -> f32 {
        view.view_from_world_f32().transform_point3(position).z
    }

    #[test]
    fn the_surface_of_the_pixel_itself_wins_over_a_larger_one_behind() {
        let view = views()[0];
        let floor = Shape::Plane { normal: Vec3::Z, offset: 0.0 };
        let corner = exact(&AnalyticScene::new([floor]), &view, Vec2::new(80.0, 60.0)).position;
        // A small block; the pixel lies on its top, the window mostly on the floor.
        let half = Vec3::new(0.06, 0.06, 0.1);
        let block = Shape::Box { min: corner - half, max: corner + half };
        let scene = AnalyticScene::new([floor, block]);
        let surface = scene.render(&view);
        let top = (0..120)
            .flat_map(|y| (0..160).map(move |x| (x, y)))
            .find(|&(x, y)| {
                let p = view.unproject(Vec2::new(x as f32, y as f32), surface.depth_m[(x, y)]);
                (transform(&view.world_from_view, p).z - 0.1).abs() < 1e-4
            })
            .unwrap();
        let found =
            surface_at(&surface, Vec2::new(top.0 as f32 + 2.0, top.1 as f32 + 2.0)).unwrap();
        assert!((found.position.z - 0.1).abs() < 1e-4 && found.normal.z > 0.999, "{found:?}");
    }

    #[test]
    fn missing_depth_is_said_and_tried_again() {
        let view = views()[0];
        let pixel = Vec2::new(80.0, 60.0);
        let floor = AnalyticScene::new([Shape::Plane { normal: Vec3::Z, offset: 0.0 }]);
        let (seen, nothing) = (floor.render(&view), GBuffer::empty(view));
        assert!(surface_at(&nothing, pixel).is_err());
        assert!(surface_at(&seen, Vec2::new(160.0, 3.0)).is_err());
        let mut lonely = GBuffer::empty(view);
        lonely.depth_m[(80, 60)] = 1.0;
        assert!(surface_at(&lonely, pixel).is_err());
        let mut virtual_only = seen.clone();
        virtual_only.origin.fill(Origin::Virtual);
        assert!(surface_at(&virtual_only, pixel).is_err());

        let anchor = SurfaceAnchor::new(pixel, 3, 0.0, 2.0, None);
        let object = VirtualObject {
            model: Arc::new(Model::default()),
            placement: Placement::Pending(anchor),
        };
        let mut scene = VirtualScene::from_objects([object]);
        assert_eq!(scene.resolve(2, &seen), 0, "too early");
        assert_eq!(scene.resolve(3, &nothing), 0);
        assert_eq!((scene.resolve(4, &seen), scene.pending()), (1, 0));
        let placed = scene.objects[0].world_from_object().unwrap();
        assert!((placed.rotation * Vec3::Y - Vec3::Z).length() < 1e-5 && placed.scale == 2.0);
        assert!(placed.translation.z.abs() < 1e-5);
        assert_eq!(scene.resolve(5, &seen), 0, "stays where it is");
    }
}
