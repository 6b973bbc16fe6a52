//! Vertices and triangles of one glTF primitive, moved to the axes of the model.

use super::accessor::Buffers;
use super::budget;
use super::materials::MaterialSource;
use crate::scene::model::{PartData, Vertex};
use glam::{DMat3, DMat4, DVec3, Vec2, Vec3};
use gltf::mesh::{Mode, Semantic};
use gltf::{Node, Primitive};

pub struct Reader<'a> {
    buffers: &'a Buffers,
    world_from_node: &'a [Option<DMat4>],
    /// Primitives of points or lines.
    pub skipped_modes: usize,
}

impl<'a> Reader<'a> {
    pub fn new(buffers: &'a Buffers, world_from_node: &'a [Option<DMat4>]) -> Self {
        Self { buffers, world_from_node, skipped_modes: 0 }
    }

    /// `None` for points and lines.
    pub fn read(
        &mut self,
        node: &Node,
        primitive: &Primitive,
        source: MaterialSource,
    ) -> Result<Option<PartData>, String> {
        let budget = &self.buffers.budget;
        budget.take(1, budget::PRIMITIVE)?;
        if matches!(primitive.mode(), Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip)
        {
            self.skipped_modes += 1;
            return Ok(None);
        }
        let vertices = primitive.get(&Semantic::Positions).map_or(0, |a| a.count());
        budget.take(vertices, budget::VERTEX)?;
        // Strips and fans have a triangle for each index.
        let corners = primitive.indices().map_or(vertices, |a| a.count());
        budget.take(corners, budget::TRIANGLE)?;
        let positions = self.floats::<3>(primitive, Semantic::Positions)?.ok_or("no POSITION")?;
        let count = positions.len();
        let list = self.vertex_list(primitive, count)?;
        let mut triangles = triangulate(&list, primitive.mode());
        let normals = same_length(self.floats(primitive, Semantic::Normals)?, count, "NORMAL")?;
        let set = Semantic::TexCoords(source.tex_coord);
        let uvs: Option<Vec<[f32; 2]>> =
            same_length(self.floats(primitive, set)?, count, "TEXCOORD")?;
        let colors = same_length(self.colors(primitive)?, count, "COLOR_0")?.unwrap_or_default();

        let placement = self.placement(node, primitive, count)?;
        if placement.mirrored() {
            triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        let vertices = (0..count)
            .map(|i| {
                // Zero stands for the face's own normal: without NORMAL, shading is flat.
                let normal = normals.as_ref().map_or(Vec3::ZERO, |n| Vec3::from(n[i]));
                let (position, normal) = placement.apply(i, positions[i].into(), normal);
                let uv = uvs.as_ref().map_or(Vec2::ZERO, |uv| Vec2::from(uv[i]));
                let uv = source.uv_transform.map_or(uv, |transform| transform.apply(uv));
                Vertex { position, normal, uv }
            })
            .collect();
        Ok(Some(PartData { vertices, colors, triangles, material: source.material }))
    }

    fn floats<const N: usize>(
        &self,
        primitive: &Primitive,
        semantic: Semantic,
    ) -> Result<Option<Vec<[f32; N]>>, String> {
        primitive.get(&semantic).map(|a| self.buffers.floats(&a)).transpose()
    }

    fn colors(&self, primitive: &Primitive) -> Result<Option<Vec<[f32; 4]>>, String> {
        let Some(accessor) = primitive.get(&Semantic::Colors(0)) else { return Ok(None) };
        if accessor.dimensions().multiplicity() == 4 {
            return self.buffers.floats(&accessor).map(Some);
        }
        let rgb: Vec<[f32; 3]> = self.buffers.floats(&accessor)?;
        Ok(Some(rgb.into_iter().map(|[r, g, b]| [r, g, b, 1.0]).collect()))
    }

    fn vertex_list(&self, primitive: &Primitive, vertices: usize) -> Result<Vec<u32>, String> {
        let Some(accessor) = primitive.indices() else {
            return Ok((0..vertices as u32).collect());
        };
        let list: Vec<[u32; 1]> = self.buffers.integers(&accessor)?;
        match list.iter().flatten().find(|&&i| i as usize >= vertices) {
            Some(i) => Err(format!("index {i} is out of range: there are {vertices} vertices")),
            None => Ok(list.into_iter().flatten().collect()),
        }
    }

    fn placement(
        &self,
        node: &Node,
        primitive: &Primitive,
        count: usize,
    ) -> Result<Placement, String> {
        let joints = primitive.get(&Semantic::Joints(0));
        let weights = primitive.get(&Semantic::Weights(0));
        if let (Some(skin), Some(joints), Some(weights)) = (node.skin(), joints, weights) {
            let vertex_joints = self.buffers.integers(&joints)?;
            let vertex_weights = self.buffers.floats(&weights)?;
            let vertex_joints = same_length(Some(vertex_joints), count, "JOINTS_0")?;
            let vertex_weights = same_length(Some(vertex_weights), count, "WEIGHTS_0")?;
            let matrices = self.joint_matrices(&skin)?;
            let influences: Vec<_> = vertex_joints
                .into_iter()
                .flatten()
                .zip(vertex_weights.into_iter().flatten())
                .collect();
            let used = influences.iter().flat_map(|(j, w)| j.iter().zip(w));
            if let Some((j, _)) = used.into_iter().find(|&(&j, _)| j as usize >= matrices.len()) {
                return Err(format!("joint {j} is out of range: there are {}", matrices.len()));
            }
            return Ok(Placement::Skinned { matrices, influences });
        }
        // Only nodes that a scene shows come here.
        Ok(Placement::Rigid(self.world_from_node[node.index()].unwrap_or(DMat4::IDENTITY)))
    }

    /// Rest pose: joints where their nodes' own transforms put them.
    fn joint_matrices(&self, skin: &gltf::Skin) -> Result<Vec<DMat4>, String> {
        self.buffers.budget.take(skin.joints().count(), budget::JOINT)?;
        let inverse_bind: Option<Vec<[f32; 16]>> =
            skin.inverse_bind_matrices().map(|a| self.buffers.floats(&a)).transpose()?;
        skin.joints()
            .enumerate()
            .map(|(i, joint)| {
                let world = self.world_from_node[joint.index()]
                    .ok_or_else(|| format!("joint node {} is in no scene", joint.index()))?;
                let Some(list) = &inverse_bind else { return Ok(world) };
                let inverse = list.get(i).ok_or("fewer inverse bind matrices than joints")?;
                Ok(world * glam::Mat4::from_cols_array(inverse).as_dmat4())
            })
            .collect()
    }
}

enum Placement {
    Rigid(DMat4),
    /// The spec lets joints replace the transform of the node itself.
    Skinned {
        matrices: Vec<DMat4>,
        influences: Vec<([u32; 4], [f32; 4])>,
    },
}

impl Placement {
    fn mirrored(&self) -> bool {
        match self {
            Self::Rigid(matrix) => matrix.determinant() < 0.0,
            Self::Skinned { matrices, .. } => matrices.iter().all(|m| m.determinant() < 0.0),
        }
    }

    fn apply(&self, vertex: usize, position: Vec3, normal: Vec3) -> (Vec3, Vec3) {
        let matrix = match self {
            Self::Rigid(matrix) => *matrix,
            Self::Skinned { matrices, influences } => {
                let (joints, weights) = influences[vertex];
                let total: f64 = weights.iter().map(|&w| f64::from(w)).sum();
                let sum = joints
                    .iter()
                    .zip(weights)
                    .fold(DMat4::ZERO, |sum, (&j, w)| sum + matrices[j as usize] * f64::from(w));
                sum * total.recip()
            }
        };
        let position = matrix.transform_point3(position.as_dvec3()).as_vec3();
        (position, (normal_matrix(&matrix) * normal.as_dvec3()).normalize_or_zero().as_vec3())
    }
}

/// Inverse transpose up to a positive factor: the cofactor matrix times the determinant's sign,
/// which exists for flattened nodes too.
fn normal_matrix(matrix: &DMat4) -> DMat3 {
    let [x, y, z]: [DVec3; 3] = [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(|c| c.truncate());
    let sign = x.cross(y).dot(z).signum();
    DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y)) * sign
}

fn same_length<T>(
    list: Option<Vec<T>>,
    count: usize,
    name: &str,
) -> Result<Option<Vec<T>>, String> {
    match list {
        Some(list) if list.len() != count => {
            Err(format!("{} {name} values for {count} positions", list.len()))
        }
        list => Ok(list),
    }
}

/// Strips and fans keep the winding of their first triangle.
fn triangulate(list: &[u32], mode: Mode) -> Vec<[u32; 3]> {
    match mode {
        Mode::TriangleStrip => list
            .windows(3)
            .enumerate()
            .map(|(i, w)| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] })
            .collect(),
        Mode::TriangleFan => {
            list.get(1..).unwrap_or_default().windows(2).map(|w| [list[0], w[0], w[1]]).collect()
        }
        _ => list.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
    }
}
