//! The volume V: truncated signed distances in 8x8x8 blocks allocated near surfaces, and every
//! picture and mesh taken from it.
//!
//! Distances are positive in free space, in units of the truncation distance. They are projective
//! (measured along the view's z axis), as in Newcombe et al., "KinectFusion", 2011, Eq. 6-12.

pub(crate) mod allocate;
mod auxiliary;
pub(crate) mod block;
pub(crate) mod crossings;
pub(crate) mod empty_space;
pub(crate) mod integrate;
mod lattice;
mod marching_cubes;
mod mesh;
mod occlusion;
pub(crate) mod packet;
mod packet_normals;
mod placement;
pub(crate) mod raycast;
pub(crate) mod rays;
mod sample;
pub(crate) mod schedule;
#[cfg(feature = "gpu")]
pub(crate) mod stored;
mod surface;
pub(crate) mod tiles;
mod volume;

#[cfg(test)]
pub(crate) mod tests;

pub use auxiliary::AuxiliaryRig;
pub(crate) use empty_space::EmptySpace;
pub use lattice::Lattice;
pub(crate) use occlusion::Occlusion;
pub use placement::place_centre;
pub use schedule::Shown;
pub use surface::SurfaceStage;
pub use volume::{FusionError, TsdfVolume, Voxel};

/// Reconstruct stage, map part.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VolumeParams {
    pub side_m: f32,
    /// Voxels a side, a multiple of 8, from 8 to 512.
    pub resolution: usize,
    /// Truncation distance; 0 takes four voxels, at least 2 cm. At least a voxel's diagonal, at
    /// most the side.
    pub truncation_m: f32,
    /// Frames in the running average, from 1 to 1024.
    pub max_weight: u16,
    /// A voxel seen free (a ray passed it by more than the truncation distance) forgets what it
    /// knew beyond this weight, so that moved objects vanish sooner than surfaces are averaged.
    pub free_weight: u16,
    /// Centre of the cube in world coordinates; none places it from the first frame.
    pub centre: Option<[f64; 3]>,
    /// Keep colour beside the distance (for the mesh).
    pub color: bool,
    /// Voxels seen in fewer frames give no triangles.
    pub mesh_min_weight: u16,
}

impl Default for VolumeParams {
    fn default() -> Self {
        Self {
            side_m: 2.0,
            resolution: 256,
            truncation_m: 0.0,
            max_weight: 128,
            free_weight: 32,
            centre: None,
            color: true,
            mesh_min_weight: 2,
        }
    }
}

/// Surface stage: auxiliary orthographic buffers ray-cast from V (Gruber et al. 2015, Sec. 5.1).
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SurfaceParams {
    /// Pixels a side of an auxiliary buffer.
    pub auxiliary_resolution: usize,
    /// The paper's; off by default, as composed frames are no nearer the truth with it (`kinlight
    /// study composite`): what it shows of a room seen from the front are mostly silhouettes.
    pub left: bool,
    /// As [`Self::left`].
    pub right: bool,
    pub top: bool,
    /// The one seen from the dominant light.
    pub light: bool,
    /// How many out-of-date auxiliary buffers are redone in a frame, the stalest first; 0 redoes
    /// all of them.
    pub refresh_per_frame: usize,
    /// In the first updates after a start the volume fills quickly: all buffers are redone.
    pub warm_up_updates: u64,
    /// The light's buffer keeps its view until the light moved by more than this.
    pub light_tolerance_deg: f32,
}

impl Default for SurfaceParams {
    fn default() -> Self {
        Self {
            auxiliary_resolution: 256,
            left: false,
            right: false,
            top: true,
            light: true,
            refresh_per_frame: 1,
            warm_up_updates: 10,
            light_tolerance_deg: 2.0,
        }
    }
}
