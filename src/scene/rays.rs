//! Rays against the triangles of virtual objects.

use super::model::{BoundingSphere, Model};
use super::objects::VirtualScene;
use crate::math::bvh::{Aabb, Bvh, Ray, hit_triangle};
use glam::{Affine3A, Vec3, Vec3A};
use std::sync::Arc;

/// The objects of a scene that have a place, ready for rays. Hierarchies are built once a model and
/// kept while an object shows it.
///
/// Every triangle stops a ray from both sides; cut-outs of a texture (alpha) do so too.
#[derive(Debug, Default)]
pub struct SceneRays {
    models: Vec<(Arc<Model>, Bvh)>,
    instances: Vec<Instance>,
}

/// An object that has a place.
#[derive(Debug)]
pub(crate) struct Instance {
    /// Index of its model.
    pub model: usize,
    pub object_from_world: Affine3A,
    /// World-space sphere around it.
    pub bounds: BoundingSphere,
}

impl SceneRays {
    /// Takes in where objects stand now.
    pub fn update(&mut self, scene: &VirtualScene) {
        self.models.retain(|(model, _)| scene.objects.iter().any(|o| Arc::ptr_eq(&o.model, model)));
        self.instances.clear();
        for object in &scene.objects {
            let (Some(pose), Some(bounds)) = (object.world_from_object(), object.bounds()) else {
                continue;
            };
            let known = self.models.iter().position(|(model, _)| Arc::ptr_eq(model, &object.model));
            let model = known.unwrap_or_else(|| {
                self.models.push((object.model.clone(), hierarchy(&object.model)));
                self.models.len() - 1
            });
            let object_from_world = pose.affine().inverse();
            // Slab tests over boxes grown for rounding: so grows the sphere that stands before them.
            let bounds = BoundingSphere { radius: bounds.radius * 1.001 + 1e-5, ..bounds };
            self.instances.push(Instance { model, object_from_world, bounds });
        }
    }

    /// Models that objects show.
    #[cfg(feature = "gpu")]
    pub(crate) fn models(&self) -> &[(Arc<Model>, Bvh)] {
        &self.models
    }

    #[cfg(feature = "gpu")]
    pub(crate) fn instances(&self) -> &[Instance] {
        &self.instances
    }

    pub fn is_empty(&self) -> bool {
        self.instances.is_empty()
    }

    /// World-space spheres around the objects.
    pub fn bounds(&self) -> impl Iterator<Item = BoundingSphere> + '_ {
        self.instances.iter().map(|instance| instance.bounds)
    }

    /// Whether a triangle lies on the ray from `origin`, nearer than `reach_m`; `direction` is a unit
    /// vector in world axes.
    pub fn meets(&self, origin: Vec3, direction: Vec3, reach_m: f32) -> bool {
        self.instances.iter().any(|instance| {
            near_sphere(&instance.bounds, origin, direction, reach_m)
                && self.meets_instance(instance, origin, direction, reach_m)
        })
    }

    fn meets_instance(
        &self,
        instance: &Instance,
        origin: Vec3,
        direction: Vec3,
        reach_m: f32,
    ) -> bool {
        let (model, bvh) = &self.models[instance.model];
        // The direction keeps its length in world units, so that distances along it stay metres.
        let ray = Ray::new(
            instance.object_from_world.transform_point3a(origin.into()),
            instance.object_from_world.transform_vector3a(direction.into()),
        );
        let mut hit = false;
        bvh.traverse(&ray, reach_m, |triangle, t_max| {
            hit |= hit_triangle(&ray, corners(model, triangle as usize), t_max).is_some();
            if hit { -1.0 } else { t_max }
        });
        hit
    }
}

/// Whether a ray passes through a sphere before its end.
#[inline]
fn near_sphere(sphere: &BoundingSphere, origin: Vec3, direction: Vec3, reach_m: f32) -> bool {
    let to_centre = sphere.centre - origin;
    let along = to_centre.dot(direction);
    let nearest = along.clamp(0.0, reach_m);
    (to_centre - direction * nearest).length_squared() <= sphere.radius * sphere.radius
}

fn hierarchy(model: &Model) -> Bvh {
    let boxes: Vec<Aabb> =
        (0..model.triangles().len()).map(|t| Aabb::of_points(corners(model, t))).collect();
    Bvh::build(&boxes)
}

pub(crate) fn corners(model: &Model, triangle: usize) -> [Vec3A; 3] {
    model.triangles()[triangle].map(|i| model.vertices()[i as usize].position.into())
}

#[cfg(test)]
mod tests {
    use super::super::{PartData, Similarity, Vertex, VirtualObject};
    use super::*;

    /// A square of 2 m in its own x and y.
    fn square() -> Arc<Model> {
        let corners = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]];
        let vertices = corners.map(|p| Vertex { position: p.into(), ..Vertex::default() }).to_vec();
        let part =
            PartData { vertices, triangles: vec![[0, 1, 2], [0, 2, 3]], ..Default::default() };
        Arc::new(Model::new("square", vec![part]).unwrap())
    }

    #[test]
    fn a_placed_square_stops_rays_within_reach_from_both_sides() {
        let model = square();
        let pose = Similarity {
            rotation: glam::Quat::from_rotation_y(std::f32::consts::FRAC_PI_2),
            scale: 0.25,
            translation: Vec3::new(3.0, 0.0, 0.0),
        };
        // stands at x = 3 with y and z within a quarter metre
        let scene = VirtualScene::from_objects([VirtualObject::placed(model, pose)]);
        let mut rays = SceneRays::default();
        assert!(rays.is_empty() && !rays.meets(Vec3::ZERO, Vec3::X, 10.0));
        rays.update(&scene);
        assert!(rays.meets(Vec3::ZERO, Vec3::X, 3.01) && !rays.meets(Vec3::ZERO, Vec3::X, 2.99));
        assert!(rays.meets(Vec3::X * 4.0, -Vec3::X, 1.01));
        assert!(!rays.meets(Vec3::ZERO, -Vec3::X, 10.0));
        for (y, z, hit) in [(0.24, -0.24, true), (0.26, 0.0, false), (0.0, -0.26, false)] {
            assert_eq!(rays.meets(Vec3::new(0.0, y, z), Vec3::X, 5.0), hit, "{y} {z}");
        }
        rays.update(&VirtualScene::default());
        assert!(rays.is_empty() && rays.models.is_empty());
    }
}
