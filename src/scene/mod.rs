//! Virtual objects: loading, placing, rasterising into geometry buffers; and analytic scenes whose
//! buffers are known exactly.

pub mod analytic;

mod anchor;
mod error;
mod file;
mod gltf;
mod model;
mod objects;
pub(crate) mod raster;
mod rays;
mod texture;

pub use anchor::{SurfaceAnchor, SurfacePoint, surface_at};
pub use error::SceneError;
pub use file::{ObjectSpec, SceneFile};
pub use model::{BoundingSphere, Material, Model, Part, PartData, Vertex};
pub use objects::{Placement, Similarity, VirtualObject, VirtualScene};
pub use raster::{DrawReport, Rasteriser};
pub use rays::SceneRays;
#[cfg(feature = "gpu")]
pub(crate) use rays::corners as triangle_corners;
#[cfg(feature = "gpu")]
pub(crate) use texture::MAX_TAPS as TEXTURE_TAPS;
pub use texture::{Texture, Wrap};
