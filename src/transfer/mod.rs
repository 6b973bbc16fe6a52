//! Radiance transfer in image space: SSDO visibility projected into spherical harmonics
//! (Gruber et al. 2015, Sec. 5.1 and 5.3); and, to compare with, by rays ([`RayTracedTransfer`]).
//!
//! For a surface point x with normal n, each direction w_j with n.w_j > 0 has a sample y_j = x + r_j w_j.
//! It is looked up in every geometry buffer; where it lies behind the surface s_j seen there, w_j
//! is hidden by as much as s_j fits the direction (K, Eq. 8; the least K of all buffers counts).
//! With c_j = max(0, n.w_j), the transfer is
//!
//! ```text
//! T = T_unoccluded(n) - sum_j (1 - K_j) c_j Y(w_j) / sum_j c_j
//! ```
//!
//! and not sum_j K_j c_j Y(w_j) dw / pi (Eq. 6). Both have the same limit, but here the finite set
//! of directions (error of a lobe: 2.6 % for N = 32, 10 % for 16) enters with what is hidden alone: open
//! surfaces are exact, and dividing by sum c_j, which stands for pi / dw, keeps the shading in a white
//! furnace within [0, 1].
//!
//! Decisions beyond the paper: "closer than x" compares s_j with y_j, as its Figure 5 does; a surface
//! below the horizon of x hides nothing; depth is taken where a pixel's plane is farthest
//! inside the pixel, so that planes never hide themselves; x is lifted by the bias.

use crate::image::Size;
use crate::math::sh::{MAX_BANDS, coefficients};
use batch::Grid;
pub(crate) use batch::grid_pixel;

mod batch;
mod bounce;
mod directions;
mod hull;
mod limits;
mod occluder;
mod pyramid;
mod radiance_transfer;
pub mod reference;
mod samples;
mod stage;
#[cfg(test)]
pub(crate) mod test_support;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod time_tests;
pub(crate) mod traced;
#[cfg(test)]
mod truth_tests;
#[cfg(test)]
mod virtual_tests;

pub use directions::DirectionSet;
pub use radiance_transfer::{Buffers, Radiance, RadianceTransfer};
pub use stage::{MergedScene, RealScene, TransferStage};
pub use traced::RayTracedTransfer;

/// How visibility is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TransferMethod {
    /// Samples looked up in geometry buffers: [`RadianceTransfer`].
    #[default]
    ImageSpace,
    /// Rays through the volume: [`RayTracedTransfer`]. It has no bounce.
    RayTraced,
}

/// How far a surface may lie from a sample's direction and still hide it, as the chi of Eq. 8. alpha is
/// the median angle between neighbouring directions.
///
/// 1 - K falls from 1 on the direction itself to 0 where 1 - t.w = chi. Relative L2 error against
/// traced transfer (N = 32, radius 0.8 m, five buffers; a wall / a desk; without any occlusion it is
/// 0.54 / 0.25):
///
/// | | one sample | three samples | six samples |
/// | --- | --- | --- | --- |
/// | `Text` | 0.51 / 0.21 | 0.47 / 0.16 | 0.42 / 0.13 |
/// | `Neighbour` | 0.50 / 0.19 | 0.44 / 0.13 | 0.41 / 0.12 |
/// | `Printed` | 0.49 / 0.19 | 0.44 / 0.18 | 0.41 / 0.20 |
///
/// With the text's cone a surface between two directions hides neither, and the narrower the cones
/// (the larger N), the less is found. The printed one counts surfaces almost a right angle
/// away, and more samples make it darker than the truth. Falling to 0 at the neighbours interpolates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ChiReading {
    /// chi = 1 - cos(alpha / 2): K reaches 1 at half the neighbours' angle, as the text says.
    Text,
    /// chi = 1 - cos(alpha): K reaches 1 at the neighbouring direction.
    #[default]
    Neighbour,
    /// chi = cos(alpha / 2), as printed: K reaches 1 only near a right angle.
    Printed,
}

/// RadTransfer stage.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TransferParams {
    pub method: TransferMethod,
    /// Spherical-harmonic bands, 1 to 6.
    pub bands: usize,
    /// Directions over the whole sphere, 4 to 1024.
    pub directions: usize,
    /// Samples along each direction, 1 (the paper's) to 16, each in its part of the radius. The surface
    /// that fits the direction best counts.
    pub samples: usize,
    /// Samples lie at this distance from the surface at least, and at most.
    pub nearest_m: f32,
    pub radius_m: f32,
    /// Transfer is computed on every n-th pixel in x and y, 1 to 64.
    pub subsampling: usize,
    pub chi: ChiReading,
    /// Points are lifted by this, and samples must lie this far behind a surface to count as hidden.
    pub bias_m: f32,
    /// Distances are jittered over tiles of n x n grid points.
    pub jitter_tile: usize,
    pub seed: u32,
    /// Ray-traced: surfaces further away hide nothing. The paper gives no length; by default rays
    /// look as far as image-space samples.
    pub ray_length_m: f32,
    /// Ray-traced and subsampled: gives every pixel its transfer, interpolated between the grid's
    /// points, or traced where depth or normals have an edge.
    pub refine: bool,
    /// An edge lies between points further than this from each other's tangent plane,
    pub refine_depth_m: f32,
    /// or with normals further apart than this, below 90.
    pub refine_angle_deg: f32,
}

impl Default for TransferParams {
    fn default() -> Self {
        Self {
            method: TransferMethod::default(),
            bands: 4,
            directions: 32,
            samples: 3,
            nearest_m: 0.025,
            radius_m: 0.8,
            subsampling: 1,
            chi: ChiReading::default(),
            bias_m: 0.01,
            jitter_tile: 2,
            seed: 1,
            ray_length_m: 0.8,
            refine: false,
            refine_depth_m: 0.02,
            refine_angle_deg: 15.0,
        }
    }
}

/// Longer is no distance in a room; squares of what is longer would leave f32.
const MAX_LENGTH_M: f32 = 1000.0;
const LENGTH: &str = "above 0, at most 1000";

/// A parameter outside its range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{field} is {value}; it must be {allowed}")]
pub struct TransferError {
    pub field: &'static str,
    pub value: String,
    pub allowed: &'static str,
}

fn allowed(
    ok: bool,
    field: &'static str,
    value: &dyn std::fmt::Display,
    allowed: &'static str,
) -> Result<(), TransferError> {
    if ok { Ok(()) } else { Err(TransferError { field, value: value.to_string(), allowed }) }
}

impl TransferParams {
    /// The first parameter that is out of range.
    pub fn check(&self) -> Result<(), TransferError> {
        let length = |v: f32| v > 0.0 && v <= MAX_LENGTH_M;
        allowed((1..=MAX_BANDS).contains(&self.bands), "transfer.bands", &self.bands, "1 to 6")?;
        allowed(
            (4..=1024).contains(&self.directions),
            "transfer.directions",
            &self.directions,
            "4 to 1024",
        )?;
        allowed((1..=16).contains(&self.samples), "transfer.samples", &self.samples, "1 to 16")?;
        allowed(length(self.radius_m), "transfer.radius_m", &self.radius_m, LENGTH)?;
        allowed(
            length(self.nearest_m) && self.nearest_m <= self.radius_m,
            "transfer.nearest_m",
            &self.nearest_m,
            "positive, at most radius_m",
        )?;
        allowed(
            (1..=64).contains(&self.subsampling),
            "transfer.subsampling",
            &self.subsampling,
            "1 to 64",
        )?;
        allowed(
            (0.0..=MAX_LENGTH_M).contains(&self.bias_m),
            "transfer.bias_m",
            &self.bias_m,
            "0 to 1000",
        )?;
        allowed(
            (1..=16).contains(&self.jitter_tile),
            "transfer.jitter_tile",
            &self.jitter_tile,
            "1 to 16",
        )?;
        allowed(length(self.ray_length_m), "transfer.ray_length_m", &self.ray_length_m, LENGTH)?;
        allowed(
            length(self.refine_depth_m),
            "transfer.refine_depth_m",
            &self.refine_depth_m,
            LENGTH,
        )?;
        allowed(
            self.refine_angle_deg > 0.0 && self.refine_angle_deg < 90.0,
            "transfer.refine_angle_deg",
            &self.refine_angle_deg,
            "above 0, below 90",
        )
    }

    /// Whether pixels between the grid's points get transfer too.
    pub(crate) fn refines(&self) -> bool {
        self.refine && self.subsampling > 1
    }

    /// Ray-traced transfer is given on every n-th pixel in x and y.
    pub(crate) fn result_step(&self) -> usize {
        if self.refines() { 1 } else { self.subsampling }
    }

    /// The grid that ray-traced transfer is given on.
    fn results(&self, image: Size) -> Grid {
        Grid::new(image, self.result_step(), 1)
    }
}

/// Indirect bounce (Gruber et al. 2015, Eq. 10-12).
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BounceParams {
    pub enabled: bool,
    /// Scales the bounce; 1 is physical.
    pub strength: f32,
}

impl Default for BounceParams {
    fn default() -> Self {
        Self { enabled: true, strength: 1.0 }
    }
}

impl BounceParams {
    /// The first parameter that is out of range.
    pub fn check(&self) -> Result<(), TransferError> {
        let ok = (0.0..=1000.0).contains(&self.strength);
        allowed(ok, "bounce.strength", &self.strength, "0 to 1000")
    }

    /// The first parameter that is out of range or does not go with the transfer.
    pub fn check_with(&self, transfer: &TransferParams) -> Result<(), TransferError> {
        self.check()?;
        let ok = !self.enabled || transfer.method == TransferMethod::ImageSpace;
        allowed(ok, "bounce.enabled", &self.enabled, "false with transfer.method = ray-traced")
    }
}

/// Transfer of a regular grid of pixels: `bands * bands` coefficients a grid point.
///
/// Grid point (i, j) stands at pixel (i * step + step / 2, j * step + step / 2), clamped to the image.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TransferMap {
    pub bands: usize,
    pub step: usize,
    pub grid: crate::image::Size,
    /// Row-major grid points, coefficients contiguous; all zero where there is no surface.
    pub coefficients: Vec<f32>,
}

impl TransferMap {
    pub fn at(&self, i: usize, j: usize) -> &[f32] {
        let n = self.bands * self.bands;
        let start = (j * self.grid.width + i) * n;
        &self.coefficients[start..start + n]
    }

    /// The pixel of a grid point in an image of this size.
    pub fn pixel(&self, i: usize, j: usize, image: Size) -> (usize, usize) {
        (grid_pixel(self.step, i, image.width), grid_pixel(self.step, j, image.height))
    }

    fn reshape(&mut self, bands: usize, grid: &Grid) {
        (self.bands, self.step, self.grid) = (bands, grid.step, grid.size());
        self.coefficients.resize(self.grid.pixels() * coefficients(bands), 0.0);
    }

    fn fits(&self, bands: usize, grid: &Grid) -> bool {
        (self.bands, self.step, self.grid) == (bands, grid.step, grid.size())
            && self.coefficients.len() == self.grid.pixels() * coefficients(bands)
    }
}

/// Light of one bounce on the same grid as [`TransferMap`]: reflected radiance for albedo 1.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct IndirectMap {
    pub step: usize,
    pub grid: Size,
    /// Row-major grid points, linear RGB; zero where there is no surface.
    pub rgb: Vec<[f32; 3]>,
}

impl IndirectMap {
    pub fn at(&self, i: usize, j: usize) -> [f32; 3] {
        self.rgb[j * self.grid.width + i]
    }

    /// The pixel of a grid point in an image of this size.
    pub fn pixel(&self, i: usize, j: usize, image: Size) -> (usize, usize) {
        (grid_pixel(self.step, i, image.width), grid_pixel(self.step, j, image.height))
    }

    fn reshape(&mut self, grid: &Grid) {
        (self.step, self.grid) = (grid.step, grid.size());
        self.rgb.resize(self.grid.pixels(), [0.0; 3]);
    }
}
