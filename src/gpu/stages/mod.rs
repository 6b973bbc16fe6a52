//! The stages on the GPU, one file or folder each; the kernels are in `shaders/`, in folders of the same names.

// In the order of the data flow.
mod input;

mod tracking;

mod fusion;

mod dyn_geo;

mod transfer;
mod transfer_map;
mod transfer_traced;

mod light_samples;

mod exitant;
mod raster;
mod virtual_layer;

mod compositing;

#[cfg(test)]
pub(crate) mod test_support;

pub use compositing::{CompositingPass, GpuComposeInput, GpuPicture, PictureReadBack};
pub use dyn_geo::DynGeoPass;
pub use exitant::ExitantPass;
pub use fusion::{EmptySpacePass, GpuVolume, RayCaster, SurfacePass};
pub use input::{FramePictures, InputPass};
pub use light_samples::LightSamplesPass;
pub use raster::{Drawn, RasterPass};
pub use tracking::{GpuTracker, RenderModel, TrackedFrame};
pub use transfer::{GpuBuffers, GpuRadiance, MAX_VIEWS, TransferPass};
pub use transfer_map::{GpuIndirectMap, GpuTransferMap};
pub use transfer_traced::TracedTransferPass;
pub use virtual_layer::GpuVirtualLayer;

/// Every shader of every stage, with constants that it may get: for tests that need no device.
#[cfg(test)]
pub(super) fn shaders() -> Vec<super::Shader> {
    [
        input::shaders().into(),
        tracking::shaders(),
        fusion::shaders(),
        dyn_geo::shaders(),
        transfer::shaders(),
        transfer_traced::shaders(),
        light_samples::shaders(),
        vec![exitant::SHADER],
        raster::shaders(),
        compositing::shaders(),
    ]
    .concat()
}

/// Those that draw, each with functions `vertex_main` and `fragment_main`.
#[cfg(test)]
pub(super) fn drawing_shaders() -> Vec<super::Shader> {
    raster::drawing_shaders()
}
