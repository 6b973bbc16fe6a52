//! The stages on the GPU, one file each; the kernels are in `shaders/`, in folders of the same names.

mod dyn_geo;
mod exitant;
mod input;
mod raster;
mod virtual_layer;

pub use dyn_geo::DynGeoPass;
pub use exitant::ExitantPass;
pub use input::{FramePictures, InputPass};
pub use raster::{Drawn, RasterPass};
pub use virtual_layer::GpuVirtualLayer;

#[cfg(test)]
pub(crate) mod test_support;

/// Every shader of every stage, with constants that it may get: for tests that need no device.
#[cfg(test)]
pub(super) fn shaders() -> Vec<super::Shader> {
    [dyn_geo::shaders(), exitant::shaders().into(), input::shaders().into(), raster::shaders()]
        .concat()
}

/// Those that draw, each with functions `vertex_main` and `fragment_main`.
#[cfg(test)]
pub(super) fn drawing_shaders() -> Vec<super::Shader> {
    raster::drawing_shaders()
}
