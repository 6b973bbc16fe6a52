//! Rays through a reconstructed surface.

use crate::math::bvh::Ray;
use crate::mesh::TriangleMesh;
use crate::synth::mesh::{Mesh, MeshData};
use glam::{Vec3, Vec3A};

/// A triangle mesh that answers whether a ray meets it.
#[derive(Clone, Debug)]
pub struct SurfaceRays {
    mesh: Mesh,
}

impl SurfaceRays {
    /// Triangles with a corner that does not exist, or is not finite, are left out.
    pub fn new(mesh: &TriangleMesh) -> Self {
        let corner = |i: u32| mesh.positions.get(i as usize).map(|&p| Vec3A::from_array(p));
        let sound = |t: &&[u32; 3]| t.iter().all(|&i| corner(i).is_some_and(|p| p.is_finite()));
        let data = MeshData {
            positions: mesh.positions.iter().map(|&p| Vec3A::from_array(p)).collect(),
            triangles: mesh.triangles.iter().filter(sound).copied().collect(),
            ..MeshData::default()
        };
        Self { mesh: Mesh::new(data) }
    }

    /// `direction` is of unit length; infinity looks everywhere.
    pub fn occluded(&self, point: Vec3, direction: Vec3, max_distance_m: f32) -> bool {
        let ray = Ray::new(point.into(), direction.into());
        self.mesh.is_hit(&ray, max_distance_m)
    }
}
