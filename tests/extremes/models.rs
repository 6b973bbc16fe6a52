//! Virtual objects.

use glam::{Vec2, Vec3};
use kinlight::scene::{Model, PartData, Similarity, Vertex, VirtualObject, VirtualScene};
use std::sync::Arc;

/// A closed box of 20 cm on its origin, +y up, with `n * n` squares of two triangles a face.
pub fn boxed(n: usize) -> Arc<Model> {
    let mut part = PartData::default();
    for axis in [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z] {
        let u = axis.any_orthonormal_vector();
        let v = axis.cross(u);
        let first = part.vertices.len() as u32;
        for i in 0..=n {
            for j in 0..=n {
                let [a, b] = [i, j].map(|k| 2.0 * k as f32 / n as f32 - 1.0);
                let position = 0.1 * (axis + a * u + b * v) + Vec3::Y * 0.1;
                part.vertices.push(Vertex { position, normal: axis, uv: Vec2::ZERO });
            }
        }
        let at = |i: usize, j: usize| first + (i * (n + 1) + j) as u32;
        for (i, j) in (0..n * n).map(|k| (k / n, k % n)) {
            let corners = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            part.triangles.push([corners[0], corners[1], corners[2]]);
            part.triangles.push([corners[0], corners[2], corners[3]]);
        }
    }
    Arc::new(Model::new("box", vec![part]).expect("corners of its own"))
}

/// These corners, as one triangle after the other.
pub fn triangles(corners: &[[f32; 3]]) -> Result<Model, String> {
    let vertices = corners.iter().map(|&p| Vertex { position: p.into(), ..Vertex::default() });
    let triangles = (0..corners.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
    let (vertices, triangles) = (vertices.collect(), triangles.collect());
    Model::new("triangles", vec![PartData { vertices, triangles, ..PartData::default() }])
}

/// One of them, standing upright there.
pub fn standing(model: &Arc<Model>, at: Vec3, scale: f32) -> VirtualScene {
    VirtualScene::from_objects([placed(model, at, scale)])
}

pub fn placed(model: &Arc<Model>, at: Vec3, scale: f32) -> VirtualObject {
    VirtualObject::placed(model.clone(), Similarity::standing(at, Vec3::Z, 0.3, scale))
}

/// A box on the floor of the corner.
pub fn on_floor() -> VirtualScene {
    standing(&boxed(1), Vec3::new(0.45, -0.45, 0.0), 1.0)
}
