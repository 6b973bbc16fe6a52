//! Triangle models with normals and base colour, in the axes of glTF: +y up, right-handed, metres.

use super::Texture;
use glam::{Vec2, Vec3};
use std::ops::Range;
use std::sync::Arc;

/// Coordinates beyond this are taken for broken: their products would overflow.
const MAX_COORDINATE_M: f32 = 1e9;

/// What shades a part. Only the diffuse base colour is modelled; light comes from the room.
#[derive(Clone, Debug)]
pub struct Material {
    /// Linear RGB and alpha; multiplies texture and vertex colour.
    pub base_color: [f32; 4],
    pub texture: Option<Arc<Texture>>,
    /// Where alpha is smaller, there is no surface.
    pub alpha_cutoff: Option<f32>,
}

impl Default for Material {
    fn default() -> Self {
        Self { base_color: [1.0; 4], texture: None, alpha_cutoff: None }
    }
}

#[derive(Clone, Debug)]
pub struct Part {
    /// Indices into [`Model::triangles`].
    pub triangles: Range<usize>,
    pub material: Material,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Vertex {
    pub position: Vec3,
    /// Any length but zero.
    pub normal: Vec3,
    pub uv: Vec2,
}

/// Sphere around something, metres.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BoundingSphere {
    pub centre: Vec3,
    pub radius: f32,
}

/// Immutable, so that all instances can share it and every index is known to be good.
#[derive(Clone, Debug, Default)]
pub struct Model {
    name: String,
    vertices: Vec<Vertex>,
    /// Linear RGBA, one a vertex; empty where all are white.
    colors: Vec<[f32; 4]>,
    triangles: Vec<[u32; 3]>,
    parts: Vec<Part>,
    bounds: BoundingSphere,
    dropped: usize,
}

impl Model {
    /// Checks and takes a list of parts, each with its own vertices and triangles. Triangles
    /// without area or with coordinates that are not finite are dropped and counted.
    pub fn new(name: impl Into<String>, parts: Vec<PartData>) -> Result<Self, String> {
        let mut model = Self { name: name.into(), ..Self::default() };
        let colored = parts.iter().any(|part| !part.colors.is_empty());
        for part in parts {
            model.add(part, colored)?;
        }
        model.bounds = model.bounding_sphere();
        Ok(model)
    }

    fn add(&mut self, part: PartData, colored: bool) -> Result<(), String> {
        let base = u32::try_from(self.vertices.len() + part.vertices.len())
            .map(|_| self.vertices.len() as u32)
            .map_err(|_| "more than 2^32 vertices".to_owned())?;
        if !part.colors.is_empty() && part.colors.len() != part.vertices.len() {
            return Err(format!(
                "{} colours for {} vertices",
                part.colors.len(),
                part.vertices.len()
            ));
        }
        let start = self.triangles.len();
        for triangle in &part.triangles {
            if let Some(bad) = triangle.iter().find(|&&i| i as usize >= part.vertices.len()) {
                return Err(format!(
                    "vertex index {bad} is out of range: there are {} vertices",
                    part.vertices.len()
                ));
            }
            if has_area(triangle.map(|i| part.vertices[i as usize].position)) {
                self.triangles.push(triangle.map(|i| base + i));
            } else {
                self.dropped += 1;
            }
        }
        self.vertices.extend(part.vertices.iter().map(|v| Vertex {
            normal: v.normal.normalize_or_zero(),
            uv: if v.uv.is_finite() { v.uv } else { Vec2::ZERO },
            ..*v
        }));
        if colored {
            let white = part.vertices.len() - part.colors.len();
            self.colors.extend_from_slice(&part.colors);
            self.colors.extend(std::iter::repeat_n([1.0; 4], white));
        }
        if self.triangles.len() > start {
            let triangles = start..self.triangles.len();
            self.parts.push(Part { triangles, material: part.material });
        }
        Ok(())
    }

    /// Around the centre of the bounding box of all vertices that triangles use.
    fn bounding_sphere(&self) -> BoundingSphere {
        let used = || self.triangles.iter().flatten().map(|&i| self.vertices[i as usize].position);
        let (mut min, mut max) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        used().for_each(|p| (min, max) = (min.min(p), max.max(p)));
        if self.triangles.is_empty() {
            return BoundingSphere::default();
        }
        let centre = 0.5 * (min + max);
        let radius = used().map(|p| p.distance_squared(centre)).fold(0.0, f32::max).sqrt();
        BoundingSphere { centre, radius }
    }

    pub fn name(&self) -> &str {
        &self.name
    }

    /// Normals are unit vectors, or zero where the face's own is to be used.
    pub fn vertices(&self) -> &[Vertex] {
        &self.vertices
    }

    pub fn colors(&self) -> &[[f32; 4]] {
        &self.colors
    }

    /// Counter-clockwise seen from outside.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    pub fn parts(&self) -> &[Part] {
        &self.parts
    }

    pub fn bounds(&self) -> BoundingSphere {
        self.bounds
    }

    /// Triangles without area, or with coordinates that are not finite, that were left out.
    pub fn dropped_triangles(&self) -> usize {
        self.dropped
    }
}

/// One part as it is handed to [`Model::new`].
#[derive(Clone, Debug, Default)]
pub struct PartData {
    pub vertices: Vec<Vertex>,
    /// Linear RGBA; empty, or one a vertex.
    pub colors: Vec<[f32; 4]>,
    pub triangles: Vec<[u32; 3]>,
    pub material: Material,
}

fn has_area([a, b, c]: [Vec3; 3]) -> bool {
    let small = |p: Vec3| p.abs().max_element() <= MAX_COORDINATE_M && p.is_finite();
    // f64: the squares of micrometre edges are no smaller than f32 can hold, their products are
    let (ab, ac) = ((b - a).as_dvec3(), (c - a).as_dvec3());
    small(a) && small(b) && small(c) && ab.cross(ac).length_squared() > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(points: &[[f32; 3]], triangles: &[[u32; 3]]) -> PartData {
        let vertices = points
            .iter()
            .map(|&p| Vertex { position: p.into(), normal: Vec3::Z * 3.0, uv: Vec2::ZERO })
            .collect();
        PartData { vertices, triangles: triangles.to_vec(), ..Default::default() }
    }

    #[test]
    fn broken_triangles_are_dropped_and_counted() {
        let nan = f32::NAN;
        let points = [
            [0.0; 3],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [nan, 0.0, 0.0],
            [2.0, 0.0, 0.0],
            [1e20; 3],
        ];
        let triangles = [[0, 1, 2], [0, 1, 3], [0, 1, 4], [1, 1, 2], [0, 1, 5]];
        let model = Model::new("broken", vec![part(&points, &triangles)]).unwrap();
        assert_eq!(model.triangles(), [[0, 1, 2]]);
        assert_eq!(model.dropped_triangles(), 4);
        assert_eq!(model.vertices()[0].normal, Vec3::Z);
        assert_eq!(model.bounds().centre, Vec3::new(0.5, 0.5, 0.0));
        assert!((model.bounds().radius - 0.5f32.sqrt()).abs() < 1e-6);
    }

    #[test]
    fn an_index_out_of_range_is_an_error() {
        let error = Model::new("bad", vec![part(&[[0.0; 3]; 3], &[[0, 1, 3]])]).unwrap_err();
        assert!(error.contains("index 3"), "{error}");
    }

    #[test]
    fn parts_are_joined() {
        let corner = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let mut second = part(&corner, &[[0, 1, 2]]);
        second.colors = vec![[0.5; 4]; 3];
        let empty = part(&[], &[]);
        let model = Model::new("two", vec![part(&corner, &[[2, 1, 0]]), empty, second]).unwrap();
        assert_eq!(model.triangles(), [[2, 1, 0], [3, 4, 5]]);
        assert_eq!(model.parts().len(), 2);
        assert_eq!(model.colors()[2], [1.0; 4]);
        assert_eq!(model.colors()[3], [0.5; 4]);
        assert!(Model::new("none", vec![]).unwrap().parts().is_empty());
    }
}
