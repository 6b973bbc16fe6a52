//! Indexed triangle meshes.

/// Vertices and triangles; `normals` and `colors` are empty or as long as `positions`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleMesh {
    /// Metres.
    pub positions: Vec<[f32; 3]>,
    pub normals: Vec<[f32; 3]>,
    /// 8-bit sRGB.
    pub colors: Vec<[u8; 3]>,
    /// Counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}
