//! Differential rendering (Gruber et al. 2015, Sec. 5.4).

use crate::image::Image;

/// What virtual objects look like in a view, before light.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VirtualLayer {
    /// Linear RGB of virtual pixels.
    pub albedo: Image<[f32; 3]>,
    /// Visible share of the pixel covered by virtual objects, 0..1.
    pub coverage: Image<f32>,
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
    /// Joint bilateral: depth tolerance relative to depth, and exponent on the normals' cosine.
    pub depth_tolerance: f32,
    pub normal_exponent: f32,
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
            antialias: true,
        }
    }
}
