//! The stages on the GPU, one file each; the kernels are in `shaders/`, in folders of the same names.

mod compositing;
mod dyn_geo;
mod fusion;
mod input;
mod transfer_map;
mod exitant;
mod input;
mod raster;
mod virtual_layer;
mod light_samples;
mod transfer;
mod transfer_map;

pub use compositing::{
    CompositingPass, GpuComposeInput, GpuPicture, GpuVirtualLayer, PictureReadBack,
};
pub use dyn_geo::DynGeoPass;
pub use fusion::{EmptySpacePass, GpuVolume, RayCaster, SurfacePass};
pub use input::{FramePictures, InputPass};
pub use transfer_map::{GpuIndirectMap, GpuTransferMap};
pub use exitant::ExitantPass;
pub use input::{FramePictures, InputPass};
pub use raster::{Drawn, RasterPass};
pub use virtual_layer::GpuVirtualLayer;
pub use light_samples::LightSamplesPass;
pub use transfer::{GpuBuffers, GpuRadiance, MAX_VIEWS, TransferPass};
pub use transfer_map::{GpuIndirectMap, GpuTransferMap};

#[cfg(test)]
pub(crate) mod test_support;

/// Every shader of every stage, with constants that it may get: for tests that need no device.
#[cfg(test)]
pub(super) fn shaders() -> Vec<super::Shader> {
    [compositing::shaders(), dyn_geo::shaders(), fusion::shaders(), input::shaders().into()].concat()
    [dyn_geo::shaders(), exitant::shaders().into(), input::shaders().into(), raster::shaders()]
        .concat()
}

/// Those that draw, each with functions `vertex_main` and `fragment_main`.
#[cfg(test)]
pub(super) fn drawing_shaders() -> Vec<super::Shader> {
    raster::drawing_shaders()
    [dyn_geo::shaders(), input::shaders().into(), light_samples::shaders(), transfer::shaders()]
        .concat()
}
