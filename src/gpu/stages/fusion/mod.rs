//! The volume V on the device, as [`crate::fusion`]: depth pictures are integrated into it and views ray-cast
//! from it without anything but counters coming back.
//!
//! What differs from the CPU: memory for all blocks that there may be is taken at the start; which slot
//! of it a block gets depends on the order of atomic operations, what its voxels hold does not. A
//! ray is one invocation, not a lane of a packet.

mod download;
mod empty_space;
mod integrate;
mod raycast;
mod shaders;
mod surface;
#[cfg(test)]
mod tests;
mod uniforms;
mod volume;

pub use empty_space::EmptySpacePass;
pub use raycast::RayCaster;
#[cfg(test)]
pub(super) use shaders::shaders;
pub(super) use shaders::with_walk;
pub use surface::SurfacePass;
pub use volume::GpuVolume;
