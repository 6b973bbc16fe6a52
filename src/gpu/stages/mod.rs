//! The stages on the GPU, one file each; the kernels are in `shaders/`, in folders of the same names.

mod input;

pub use input::{FramePictures, InputPass};

#[cfg(test)]
pub(crate) mod test_support;

/// Every shader of every stage, with constants that it may get: for tests that need no device.
#[cfg(test)]
pub(super) fn shaders() -> Vec<super::Shader> {
    [input::shaders()].into_iter().flatten().collect()
}
