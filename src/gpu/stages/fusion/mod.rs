//! The volume V on the device, as [`crate::fusion`]: depth pictures are integrated into it and views ray-cast
//! from it without anything but counters coming back.
//!
//! What differs from the CPU: the host makes room before it knows what a picture needs, so that it does not
//! have to wait, and there is a limit to it; which slot a block gets depends on the order of atomic
//! operations, what its voxels hold does not. A ray is one invocation, not a lane of a packet.

mod download;
mod empty_space;
mod integrate;
mod pool;
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
