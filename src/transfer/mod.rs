//! Radiance transfer in image space: SSDO visibility projected into spherical harmonics
//! (Gruber et al. 2015, Sec. 5.1 and 5.3).

/// The two readings of Eq. 9. alpha is the median angle between neighbouring directions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ChiReading {
    /// chi = 1 - cos(alpha / 2): K reaches 1 at half the neighbours' angle, as the text says.
    #[default]
    Text,
    /// chi = cos(alpha / 2), as printed: K reaches 1 only near a right angle.
    Printed,
}

/// RadTransfer stage.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TransferParams {
    /// Spherical-harmonic bands, 1 to 6.
    pub bands: usize,
    /// Directions over the whole sphere, 4 to 1024.
    pub directions: usize,
    /// Samples lie at up to this distance from the surface.
    pub radius_m: f32,
    /// Transfer is computed on every n-th pixel in x and y (1, 2, 4, 8).
    pub subsampling: usize,
    pub chi: ChiReading,
    /// Samples must lie this far behind a surface to count as hidden.
    pub bias_m: f32,
    /// Distances are jittered over tiles of n x n pixels.
    pub jitter_tile: usize,
    pub seed: u32,
}

impl Default for TransferParams {
    fn default() -> Self {
        Self {
            bands: 4,
            directions: 32,
            radius_m: 0.6,
            subsampling: 1,
            chi: ChiReading::default(),
            bias_m: 0.01,
            jitter_tile: 2,
            seed: 1,
        }
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
    pub fn pixel(&self, i: usize, j: usize, image: crate::image::Size) -> (usize, usize) {
        let half = self.step / 2;
        ((i * self.step + half).min(image.width - 1), (j * self.step + half).min(image.height - 1))
    }
}

/// Light of one bounce on the same grid as [`TransferMap`]: reflected radiance for albedo 1.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct IndirectMap {
    pub step: usize,
    pub grid: crate::image::Size,
    /// Row-major grid points, linear RGB; zero where there is no surface.
    pub rgb: Vec<[f32; 3]>,
}
