//! Triangle meshes with smooth normals and texture coordinates, and how lathe work is made.

use super::sampler::sin_cos_turns;
use crate::math::bvh::{Aabb, Bvh, Ray, hit_triangle};
use glam::{Vec2, Vec3A};

/// Corners, triangles counter-clockwise seen from outside.
#[derive(Clone, Debug, Default)]
pub struct MeshData {
    /// Metres.
    pub positions: Vec<Vec3A>,
    /// Unit vectors, one a position.
    pub normals: Vec<Vec3A>,
    /// One a position; v points down the picture, as in glTF.
    pub uvs: Vec<Vec2>,
    pub triangles: Vec<[u32; 3]>,
}

impl MeshData {
    /// Appends a grid of `rows` x `columns` corners; neighbours are joined by two triangles each.
    pub fn add_grid(
        &mut self,
        rows: usize,
        columns: usize,
        corner: impl Fn(usize, usize) -> (Vec3A, Vec3A, Vec2),
    ) {
        let first = self.positions.len();
        for row in 0..rows {
            for column in 0..columns {
                let (position, normal, uv) = corner(row, column);
                self.positions.push(position);
                self.normals.push(normal);
                self.uvs.push(uv);
            }
        }
        for row in 1..rows {
            for column in 1..columns {
                let at = |r: usize, c: usize| (first + r * columns + c) as u32;
                let [a, b] = [at(row - 1, column - 1), at(row - 1, column)];
                let [c, d] = [at(row, column - 1), at(row, column)];
                self.add_triangle([a, b, d]);
                self.add_triangle([a, d, c]);
            }
        }
    }

    /// Skips triangles without area: the poles of grids have them.
    fn add_triangle(&mut self, triangle: [u32; 3]) {
        let [a, b, c] = triangle.map(|i| self.positions[i as usize]);
        if (b - a).cross(c - a).length_squared() > 1e-20 {
            self.triangles.push(triangle);
        }
    }

    /// Turns a profile of (radius, height) points about `+z`, from the bottom up with the outside
    /// on the right; normals are smooth except where two equal points follow each other.
    pub fn lathe(profile: &[Vec2], around: usize) -> Self {
        let mut mesh = Self::default();
        let pieces = profile.chunk_by(|a, b| a != b).filter(|piece| piece.len() > 1);
        for piece in pieces {
            mesh.add_grid(piece.len(), around + 1, |row, column| {
                let turn = column as f32 / around as f32;
                let (sin, cos) = sin_cos_turns(turn);
                let before = piece[row.saturating_sub(1)];
                let after = piece[(row + 1).min(piece.len() - 1)];
                let along = (after - before).normalize_or_zero();
                let point = piece[row];
                (
                    Vec3A::new(point.x * cos, point.x * sin, point.y),
                    Vec3A::new(along.y * cos, along.y * sin, -along.x),
                    Vec2::new(turn, row as f32 / (piece.len() - 1) as f32),
                )
            });
        }
        mesh
    }

    /// A ring about +z: a tube of `thickness` radius around a circle of `radius`.
    pub fn torus(radius: f32, thickness: f32, around: usize, across: usize) -> Self {
        let mut mesh = Self::default();
        mesh.add_grid(across + 1, around + 1, |row, column| {
            let (u, v) = (column as f32 / around as f32, row as f32 / across as f32);
            let (sin_u, cos_u) = sin_cos_turns(u);
            let (sin_v, cos_v) = sin_cos_turns(v);
            let normal = Vec3A::new(cos_u * cos_v, sin_u * cos_v, sin_v);
            (Vec3A::new(cos_u, sin_u, 0.0) * radius + normal * thickness, normal, Vec2::new(u, v))
        });
        mesh
    }
}

/// A mesh ready for rays.
#[derive(Clone, Debug)]
pub struct Mesh {
    data: MeshData,
    bvh: Bvh,
}

#[derive(Clone, Copy, Debug)]
pub struct MeshHit {
    pub t: f32,
    pub triangle: u32,
    pub weights: Vec2,
}

impl Mesh {
    pub fn new(data: MeshData) -> Self {
        let bounds: Vec<Aabb> = data
            .triangles
            .iter()
            .map(|t| Aabb::of_points(t.map(|i| data.positions[i as usize])))
            .collect();
        Self { bvh: Bvh::build(&bounds), data }
    }

    pub fn bounds(&self) -> Aabb {
        self.bvh.bounds()
    }

    fn corners(&self, triangle: u32) -> [Vec3A; 3] {
        self.data.triangles[triangle as usize].map(|i| self.data.positions[i as usize])
    }

    pub fn hit(&self, ray: &Ray, t_max: f32) -> Option<MeshHit> {
        let mut best = None;
        self.bvh.traverse(ray, t_max, |triangle, t_max| {
            match hit_triangle(ray, self.corners(triangle), t_max) {
                Some((t, weights)) => best.insert(MeshHit { t, triangle, weights }).t,
                None => t_max,
            }
        });
        best
    }

    /// Whether a ray meets any triangle before `t_max`.
    pub fn is_hit(&self, ray: &Ray, t_max: f32) -> bool {
        let mut found = false;
        self.bvh.traverse(ray, t_max, |triangle, t_max| {
            found = found || hit_triangle(ray, self.corners(triangle), t_max).is_some();
            if found { -1.0 } else { t_max }
        });
        found
    }

    pub fn face_normal(&self, triangle: u32) -> Vec3A {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(c - a).normalize_or_zero()
    }

    /// Interpolated unit normal and texture coordinates.
    pub fn surface(&self, triangle: u32, weights: Vec2) -> (Vec3A, Vec2) {
        let [a, b, c] = self.data.triangles[triangle as usize].map(|i| i as usize);
        let first = 1.0 - weights.x - weights.y;
        let normal = self.data.normals[a] * first
            + self.data.normals[b] * weights.x
            + self.data.normals[c] * weights.y;
        let uv =
            self.data.uvs[a] * first + self.data.uvs[b] * weights.x + self.data.uvs[c] * weights.y;
        (normal.try_normalize().unwrap_or_else(|| self.face_normal(triangle)), uv)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::PI;

    #[test]
    fn a_turned_half_circle_is_a_sphere_with_outward_normals() {
        let profile: Vec<Vec2> = (0..=64)
            .map(|i| (PI * (i as f32 / 64.0 - 0.5)).sin_cos())
            .map(|(sin, cos)| Vec2::new(cos.max(0.0), sin))
            .collect();
        let mesh = Mesh::new(MeshData::lathe(&profile, 96));
        for (x, y) in [(0.0, 0.1), (0.3, -0.4), (-0.5, 0.6)] {
            let ray = Ray::new(Vec3A::new(x, y, -3.0), Vec3A::Z);
            let hit = mesh.hit(&ray, 9.0).expect("the sphere is in the way");
            let p = ray.at(hit.t);
            // sagitta of the facets: 1 - cos(pi / 64) and steeper at slant
            assert!((p.length() - 1.0).abs() < 5e-3, "{p}");
            let (normal, _) = mesh.surface(hit.triangle, hit.weights);
            assert!(normal.dot(p) > 0.998 && mesh.face_normal(hit.triangle).dot(p) > 0.99);
        }
    }

    #[test]
    fn torus_faces_look_outwards() {
        let mesh = Mesh::new(MeshData::torus(1.0, 0.25, 64, 32));
        let ray = Ray::new(Vec3A::new(1.01, 0.02, 2.0), -Vec3A::Z);
        let hit = mesh.hit(&ray, 9.0).expect("the ring is below");
        assert!((hit.t - 1.75).abs() < 5e-3);
        assert!(mesh.face_normal(hit.triangle).z > 0.99);
    }
}
