//! The path tracer: next-event estimation and sampled directions, joined by multiple importance
//! sampling with the power heuristic (Veach 1997).

use super::light::{AreaLight, Environment, LightSample};
use super::material::Bsdf;
use super::sampler::Sampler;
use super::scene::Placed;
use super::shape::{Shape, ShapeHit};
use crate::image::Image;
use crate::math::bvh::{Bvh, Ray};
use crate::math::{Pinhole, Pose, affine_from_pose};
use glam::{Affine3A, Vec2, Vec3, Vec3A};

/// A scene at one moment.
#[derive(Debug)]
pub struct World {
    objects: Vec<Placed>,
    bvh: Bvh,
    lights: Vec<AreaLight>,
    environment: Environment,
}

/// A surface point as a ray finds it, in world axes.
#[derive(Clone, Copy, Debug)]
struct Surface {
    point: Vec3A,
    /// Unit normals towards where the ray came from: of the geometry, and smooth.
    geometric_normal: Vec3A,
    normal: Vec3A,
    bsdf: Bsdf,
    emission: Vec3A,
}

/// What a ray meets first.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// In units of the ray's direction.
    pub t: f32,
    /// Index into the world's objects.
    pub object: usize,
    /// Unit, towards where the ray came from.
    pub normal: Vec3A,
}

/// Rays start this far off the surface they leave: 20 times the f32 step at 4 m.
const OFFSET_M: f32 = 1e-5;

impl World {
    pub fn new(objects: Vec<Placed>, lights: Vec<AreaLight>, environment: Environment) -> Self {
        let bounds: Vec<_> = objects.iter().map(|o| o.bounds).collect();
        Self { bvh: Bvh::build(&bounds), objects, lights, environment }
    }

    /// Nearest object and where it is hit.
    pub fn hit(&self, ray: &Ray) -> Option<(usize, ShapeHit)> {
        let mut best = None;
        self.bvh.traverse(ray, f32::INFINITY, |item, t_max| {
            match self.hit_object(item as usize, ray, t_max) {
                Some(hit) => best.insert((item as usize, hit)).1.t,
                None => t_max,
            }
        });
        best
    }

    fn hit_object(&self, index: usize, ray: &Ray, t_max: f32) -> Option<ShapeHit> {
        let object = &self.objects[index];
        let origin = object.object_from_world.transform_point3a(ray.origin);
        let direction = object.object_from_world.transform_vector3a(ray.direction);
        object.shape.hit(&Ray::new(origin, direction), t_max)
    }

    /// Whether anything stands between `origin` and the point `t_max` along `direction`.
    pub fn occluded(&self, origin: Vec3A, direction: Vec3A, t_max: f32) -> bool {
        let ray = Ray::new(origin, direction);
        let mut blocked = false;
        self.bvh.traverse(&ray, t_max, |item, t_max| {
            if self.hit_object(item as usize, &ray, t_max).is_some() {
                blocked = true;
                return -1.0;
            }
            t_max
        });
        blocked
    }

    /// The nearest surface along a ray, with its shading normal.
    pub fn seen(&self, ray: &Ray) -> Option<Seen> {
        let (object, hit) = self.hit(ray)?;
        Some(Seen { t: hit.t, object, normal: self.surface(ray, (object, hit)).normal })
    }

    fn surface(&self, ray: &Ray, (index, hit): (usize, ShapeHit)) -> Surface {
        let object = &self.objects[index];
        let point = ray.at(hit.t);
        let point_in_object = object.object_from_world.transform_point3a(point);
        let (smooth, uv) = match &object.shape {
            Shape::Mesh(mesh) => mesh.surface(hit.triangle, hit.weights),
            _ => (hit.normal, Vec2::ZERO),
        };
        let to_world = |n: Vec3A| object.world_from_object.transform_vector3a(n).normalize();
        let mut geometric_normal = to_world(hit.normal);
        if geometric_normal.dot(ray.direction) > 0.0 {
            geometric_normal = -geometric_normal;
        }
        let mut normal = to_world(smooth);
        if normal.dot(geometric_normal) < 0.0 {
            normal = -normal;
        }
        if normal.dot(ray.direction) >= 0.0 {
            normal = geometric_normal; // smooth normals may face away near silhouettes
        }
        Surface {
            point,
            geometric_normal,
            normal,
            bsdf: object.material.surface(point_in_object, uv),
            emission: object.material.emission,
        }
    }

    /// Radiance that arrives along a ray with unit direction, after up to `bounces` scatterings.
    /// Light sources themselves are not seen at the first step, except through `environment`.
    pub fn radiance(&self, mut ray: Ray, bounces: u32, sampler: &mut Sampler) -> Vec3A {
        let mut sum = Vec3A::ZERO;
        let mut throughput = Vec3A::ONE;
        let mut scattered_pdf = None;
        for bounce in 0..=bounces {
            let hit = self.hit(&ray);
            let t_hit = hit.map_or(f32::INFINITY, |(_, h)| h.t);
            sum += throughput * self.emitted(&ray, t_hit, scattered_pdf);
            let Some(hit) = hit else { break };
            let mut surface = self.surface(&ray, hit);
            if bounce > 0 {
                surface.bsdf = surface.bsdf.regularised();
            }
            sum += throughput * surface.emission;
            if bounce == bounces {
                break;
            }
            let frame = Frame::new(surface.normal);
            let from = frame.local(-ray.direction);
            sum += throughput * self.direct(&surface, &frame, from, sampler);

            let Some(next) = surface.bsdf.sample(from, sampler) else { break };
            let direction = frame.world(next.direction);
            if direction.dot(surface.geometric_normal) <= 0.0 {
                break;
            }
            throughput *= next.weight;
            // Russian roulette: paths that carry little are ended, the others stand for them.
            if bounce > 0 {
                let survival = throughput.max_element().min(0.95);
                if sampler.single() >= survival {
                    break;
                }
                throughput /= survival;
            }
            scattered_pdf = Some(next.pdf);
            ray = Ray::new(surface.point + surface.geometric_normal * OFFSET_M, direction);
        }
        sum
    }

    /// Light sources that a scattered ray meets before `t_hit`, weighted against sampling them.
    fn emitted(&self, ray: &Ray, t_hit: f32, scattered_pdf: Option<f32>) -> Vec3A {
        let mut sum = Vec3A::ZERO;
        if let Some(pdf) = scattered_pdf {
            for light in &self.lights {
                if let Some(seen) = light.hit(ray.origin, ray.direction)
                    && seen.distance < t_hit
                {
                    sum +=
                        seen.radiance * power_heuristic(pdf, seen.pdf * self.light_probability());
                }
            }
        }
        if t_hit == f32::INFINITY {
            let weight = match (&self.environment, scattered_pdf) {
                (Environment::LatLong(map), Some(pdf)) => {
                    power_heuristic(pdf, map.pdf(ray.direction) * self.light_probability())
                }
                _ => 1.0,
            };
            sum += self.environment.radiance(ray.direction) * weight;
        }
        sum
    }

    /// Sources that next-event estimation chooses from, all with the same probability.
    fn sampled_lights(&self) -> usize {
        self.lights.len() + usize::from(matches!(self.environment, Environment::LatLong(_)))
    }

    fn light_probability(&self) -> f32 {
        1.0 / self.sampled_lights() as f32
    }

    fn sample_light(&self, point: Vec3A, sampler: &mut Sampler) -> Option<LightSample> {
        let count = self.sampled_lights();
        let position = sampler.pair();
        let choice = if count > 1 { (sampler.single() * count as f32) as usize } else { 0 };
        match (self.lights.get(choice), &self.environment) {
            (Some(light), _) => light.sample(point, position),
            (None, Environment::LatLong(map)) => Some(map.sample(position)),
            (None, Environment::Uniform(_)) => None,
        }
    }

    /// Light that comes straight from a sampled source.
    fn direct(
        &self,
        surface: &Surface,
        frame: &Frame,
        from: Vec3A,
        sampler: &mut Sampler,
    ) -> Vec3A {
        let start = surface.point + surface.geometric_normal * OFFSET_M;
        let Some(light) = self.sample_light(start, sampler) else { return Vec3A::ZERO };
        let to = frame.local(light.direction);
        let (value, scatter_pdf) = surface.bsdf.value_and_pdf(from, to);
        let pdf = light.pdf * self.light_probability();
        let unlit = to.z <= 0.0 || light.direction.dot(surface.geometric_normal) <= 0.0;
        if unlit || pdf <= 0.0 || self.occluded(start, light.direction, light.distance) {
            return Vec3A::ZERO;
        }
        light.radiance * value * (to.z / pdf * power_heuristic(pdf, scatter_pdf))
    }
}

/// Weight of a sample with density `pdf` that another technique finds with density `other`.
fn power_heuristic(pdf: f32, other: f32) -> f32 {
    // as a ratio, so that large densities do not overflow
    let ratio = other / pdf;
    1.0 / (1.0 + ratio * ratio)
}

/// Axes with +z along a unit normal (Duff et al. 2017).
struct Frame {
    x: Vec3A,
    y: Vec3A,
    z: Vec3A,
}

impl Frame {
    fn new(n: Vec3A) -> Self {
        let sign = 1f32.copysign(n.z);
        let a = -1.0 / (sign + n.z);
        let b = n.x * n.y * a;
        Self {
            x: Vec3A::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
            y: Vec3A::new(b, sign + n.y * n.y * a, -n.y),
            z: n,
        }
    }

    fn local(&self, v: Vec3A) -> Vec3A {
        Vec3A::new(v.dot(self.x), v.dot(self.y), v.dot(self.z))
    }

    fn world(&self, v: Vec3A) -> Vec3A {
        self.x * v.x + self.y * v.y + self.z * v.z
    }
}

/// What [`render_radiance`] needs beside the world.
#[derive(Clone, Copy, Debug)]
pub struct Shot {
    pub camera: Pinhole,
    pub world_from_camera: Pose,
    pub samples: u32,
    pub bounces: u32,
    pub seed: u32,
    pub frame: u32,
}

impl Shot {
    /// Through a pixel, with a direction of unit depth: distances along it are z-depths.
    fn ray(&self, world_from_camera: &Affine3A, x: f32, y: f32) -> Ray {
        let c = &self.camera;
        let in_camera = Vec3::new((x - c.cx) / c.fx, (y - c.cy) / c.fy, 1.0);
        let direction = world_from_camera.transform_vector3(in_camera);
        Ray::new(world_from_camera.translation, direction.into())
    }
}

/// Mean radiance of each pixel's square, linear RGB. The same for any number of threads.
pub fn render_radiance(world: &World, shot: &Shot) -> Image<[f32; 3]> {
    let mut out = Image::new(shot.camera.size(), [0.0; 3]);
    let world_from_camera = affine_from_pose(&shot.world_from_camera);
    use rayon::prelude::*;
    out.par_rows_mut().for_each(|(y, row)| {
        for (x, pixel) in row.iter_mut().enumerate() {
            let words = [shot.seed, shot.frame, y as u32, x as u32];
            let mut sum = Vec3A::ZERO;
            for index in 0..shot.samples {
                let mut sampler = Sampler::new(&words, index);
                let at = sampler.pair() - Vec2::splat(0.5);
                let ray = shot.ray(&world_from_camera, x as f32 + at.x, y as f32 + at.y);
                let ray = Ray::new(ray.origin, ray.direction.normalize());
                sum += world.radiance(ray, shot.bounces, &mut sampler);
            }
            *pixel = (sum / shot.samples as f32).to_array();
        }
    });
    out
}

/// What is seen through the pixel centres.
#[derive(Clone, Debug)]
pub struct CentreHits {
    /// z-depth in metres; missing = 0.0.
    pub depth_m: Image<f32>,
    /// Cosine between the geometric normal and the direction to the camera.
    pub cosine: Image<f32>,
    /// Index into the world's objects; `u32::MAX` where nothing is hit.
    pub object: Image<u32>,
}

pub fn render_centres(world: &World, shot: &Shot) -> CentreHits {
    let size = shot.camera.size();
    let world_from_camera = affine_from_pose(&shot.world_from_camera);
    let mut hits = Image::new(size, (0.0f32, 0.0f32, u32::MAX));
    use rayon::prelude::*;
    hits.par_rows_mut().for_each(|(y, row)| {
        for (x, out) in row.iter_mut().enumerate() {
            let ray = shot.ray(&world_from_camera, x as f32, y as f32);
            if let Some((index, hit)) = world.hit(&ray) {
                let normal = world.objects[index].world_from_object.transform_vector3a(hit.normal);
                let cosine = normal.normalize().dot(ray.direction.normalize()).abs();
                *out = (hit.t, cosine, index as u32);
            }
        }
    });
    let plane = |pick: fn(&(f32, f32, u32)) -> f32| {
        Image::from_vec(size, hits.as_slice().iter().map(pick).collect())
    };
    CentreHits {
        depth_m: plane(|h| h.0),
        cosine: plane(|h| h.1),
        object: Image::from_vec(size, hits.as_slice().iter().map(|h| h.2).collect()),
    }
}
