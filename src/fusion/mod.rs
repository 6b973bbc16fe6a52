//! The volume V: truncated signed distances in 8x8x8 blocks allocated near surfaces.

/// Reconstruct stage, map part.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VolumeParams {
    pub side_m: f32,
    /// Voxels a side, a multiple of 8, from 8 to 512.
    pub resolution: usize,
    /// Truncation distance; 0 takes four voxels, at least 2 cm.
    pub truncation_m: f32,
    pub max_weight: u16,
    /// Centre of the cube in world coordinates; none places it from the first frame.
    pub centre: Option<[f64; 3]>,
    /// Keep colour beside the distance (for the mesh).
    pub color: bool,
}

impl Default for VolumeParams {
    fn default() -> Self {
        Self {
            side_m: 2.0,
            resolution: 256,
            truncation_m: 0.0,
            max_weight: 128,
            centre: None,
            color: true,
        }
    }
}

/// Surface stage: auxiliary orthographic buffers ray-cast from V (Gruber et al. 2015, Sec. 5.1).
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SurfaceParams {
    /// Pixels a side of an auxiliary buffer.
    pub auxiliary_resolution: usize,
    pub left: bool,
    pub right: bool,
    pub top: bool,
    /// The one seen from the dominant light.
    pub light: bool,
}

impl Default for SurfaceParams {
    fn default() -> Self {
        Self { auxiliary_resolution: 256, left: true, right: true, top: true, light: true }
    }
}
