//! The stages on the GPU, one file or folder each; the kernels are in `shaders/`, in folders of the same names.

mod dyn_geo;
mod input;
mod tracking;

pub use dyn_geo::DynGeoPass;
pub use input::{FramePictures, InputPass};
pub use tracking::{GpuTracker, RenderModel};

#[cfg(test)]
pub(crate) mod test_support;

/// Every shader of every stage, with constants that it may get: for tests that need no device.
#[cfg(test)]
pub(super) fn shaders() -> Vec<super::Shader> {
    [dyn_geo::shaders(), input::shaders().into(), tracking::shaders()].concat()
}
