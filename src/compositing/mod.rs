//! Differential rendering (Gruber et al. 2015, Sec. 5.4).
//!
//! ```text
//! transfer, light -> shading grid R, R' -> smoothed -> up-sampled -> pixels -> 8-bit sRGB
//! ```
//!
//! - R and R' are the reflected light of the real and of the real + virtual scene, for a surface of
//!   the scene's mean albedo (the light is known times that albedo).
//! - A real pixel is multiplied by R'/R. Eq. 13 as printed is kept as [`Compositor::Difference`]:
//!   its tone mapper compresses both terms, so that even full darkness takes only T(R) of the pixel.
//! - A virtual pixel shows its own albedo under R', never the camera's colour.
//! - A real pixel that no virtual object influences keeps the camera's three bytes.

mod encode;
mod filter_gauss;
mod grid;
mod pixels;
mod planes;
mod smooth;
mod stage;
mod upsample;

#[cfg(test)]
pub(crate) mod test_support;
#[cfg(test)]
mod tests;

#[cfg(feature = "gpu")]
pub(crate) use encode::SHOULDER;
pub(crate) use encode::SRGB;
#[cfg(feature = "gpu")]
pub(crate) use filter_gauss::gaussian;
#[cfg(feature = "gpu")]
pub(crate) use grid::{Lamp, MAX_VISIBILITY};
#[cfg(feature = "gpu")]
pub(crate) use pixels::MAX_RATIO;
#[cfg(feature = "gpu")]
pub(crate) use smooth::{Likeness, PixelSteps};
#[cfg(feature = "gpu")]
pub(crate) use stage::log_average_step;
pub use stage::{ComposeInput, CompositingStage, ShadingBuffers};
#[cfg(feature = "gpu")]
pub(crate) use upsample::{Between, MIN_WEIGHT, between};

use crate::image::{Image, Size};

/// What the rasteriser knows of virtual objects, pixel by pixel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VirtualLayer {
    /// Linear albedo of virtual pixels.
    pub albedo: Image<[f32; 3]>,
    /// Visible share of the pixel that virtual objects cover, 0 to 1.
    pub coverage: Image<f32>,
}

impl VirtualLayer {
    /// No virtual object.
    pub fn empty(size: Size) -> Self {
        Self { albedo: Image::new(size, [0.0; 3]), coverage: Image::new(size, 0.0) }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Compositor {
    /// Camera image times R'/R in linear light.
    #[default]
    Ratio,
    /// Eq. 13 as printed: I_c (1 + T(R') - T(R)), tone mapped with one common exposure.
    Difference,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Upsampling {
    /// Bicubic, then Gaussian, as in the paper.
    BicubicGauss,
    /// Follows depth and normal edges (Kopf et al. 2007).
    #[default]
    JointBilateral,
}

/// Rendering stage.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CompositingParams {
    pub compositor: Compositor,
    pub upsampling: Upsampling,
    /// Radius of the Gaussian after bicubic up-sampling, pixels.
    pub gauss_radius: usize,
    /// Neighbours lend their shading up to this distance from the pixel's tangent plane, relative
    /// to depth.
    pub depth_tolerance: f32,
    /// And in proportion to this power of the cosine between the normals.
    pub normal_exponent: f32,
    /// Key of the tone mapper in [`Compositor::Difference`]: what the scene's mean becomes before
    /// compression (0.18 is Reinhard's middle grey).
    pub key: f32,
    /// Soften the edge of virtual objects by one pixel.
    pub antialias: bool,
}

impl Default for CompositingParams {
    fn default() -> Self {
        Self {
            compositor: Compositor::default(),
            upsampling: Upsampling::default(),
            gauss_radius: 8,
            depth_tolerance: 0.02,
            normal_exponent: 8.0,
            key: 0.18,
            antialias: true,
        }
    }
}
