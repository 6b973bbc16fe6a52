//! The stages on the GPU, one file each; the kernels are in `shaders/`, in folders of the same names.

mod dyn_geo;
mod input;
mod light_samples;
mod transfer;
mod transfer_map;

pub use dyn_geo::DynGeoPass;
pub use input::{FramePictures, InputPass};
pub use light_samples::LightSamplesPass;
pub use transfer::{GpuBuffers, GpuRadiance, MAX_VIEWS, TransferPass};
pub use transfer_map::{GpuIndirectMap, GpuTransferMap};

#[cfg(test)]
pub(crate) mod test_support;

/// Every shader of every stage, with constants that it may get: for tests that need no device.
#[cfg(test)]
pub(super) fn shaders() -> Vec<super::Shader> {
    [dyn_geo::shaders(), input::shaders().into(), light_samples::shaders(), transfer::shaders()]
        .concat()
}
