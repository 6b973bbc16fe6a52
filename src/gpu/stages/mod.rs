//! The stages on the GPU, one file each; the kernels are in `shaders/`, in folders of the same names.

mod compositing;
mod dyn_geo;
mod fusion;
mod input;
mod transfer_map;

pub use compositing::{
    CompositingPass, GpuComposeInput, GpuPicture, GpuVirtualLayer, PictureReadBack,
};
pub use dyn_geo::DynGeoPass;
pub use fusion::{EmptySpacePass, GpuVolume, RayCaster, SurfacePass};
pub use input::{FramePictures, InputPass};
pub use transfer_map::{GpuIndirectMap, GpuTransferMap};

#[cfg(test)]
pub(crate) mod test_support;

/// Every shader of every stage, with constants that it may get: for tests that need no device.
#[cfg(test)]
pub(super) fn shaders() -> Vec<super::Shader> {
    [compositing::shaders(), dyn_geo::shaders(), fusion::shaders(), input::shaders().into()].concat()
}
