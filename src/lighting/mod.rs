//! Light from the camera image: least squares on transfer (Gruber et al. 2015, Sec. 5.2).
//!
//! ```text
//! frame, surface, transfer -> samples -> bank of frames -> lamp, albedo, least squares -> LightEstimate
//!                                            ^---- robust weights ---'  '-- change detector
//! ```

mod albedo;
mod bank;
mod change;
mod estimator;
pub mod exitant;
mod field;
mod fit;
mod lamp;
mod normal_equations;
#[cfg(feature = "gpu")]
mod picked;
mod samples;
mod solve;

#[cfg(test)]
mod tests;

#[cfg(feature = "gpu")]
pub(crate) use change::SAME_DEPTH;
pub use estimator::{LightEstimate, LightEstimator, Rejection};
pub use field::LightField;
pub use lamp::Lamp;
#[cfg(feature = "gpu")]
pub use picked::{PickedPoint, PickedSamples};
#[cfg(feature = "gpu")]
pub(crate) use samples::RANK_STEPS;
#[cfg(feature = "gpu")]
pub use samples::{Counts, most_samples, samples_per_frame};
#[cfg(all(test, feature = "gpu"))]
pub(crate) use {bank::Batch, samples::Samples, samples::Seen};

use crate::math::sh;
use glam::Vec3;

/// Incident radiance as spherical harmonics in world axes, times the scene's mean albedo
/// (albedo and light cannot be told apart from one picture).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ShLight {
    pub bands: usize,
    /// `bands * bands` coefficients, linear RGB. A one-channel estimate has three equal channels.
    pub coefficients: Vec<[f32; 3]>,
}

impl ShLight {
    pub fn luminance(&self) -> Vec<f32> {
        self.coefficients.iter().map(|&c| crate::math::color::luminance(c)).collect()
    }

    /// Unit vector towards the light, from band 1 of the luminance; `None` where that is zero.
    pub fn dominant_direction(&self) -> Option<Vec3> {
        sh::dominant_direction(&self.luminance())
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LightChannels {
    /// White light, as in the paper.
    #[default]
    Intensity,
    /// Three channels that share one factorisation.
    Rgb,
}

/// What light is believed to be where the picture does not say.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LightPrior {
    /// None at all, as plain Tikhonov regularisation has it.
    Dark,
    /// That of the one lamp at infinity and ambient light that explain the picture best.
    DistantLamp,
    /// The same with a lamp that has a place, so that its light falls off over the scene.
    #[default]
    NearLamp,
}

/// LightEst stage.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LightParams {
    pub channels: LightChannels,
    pub prior: LightPrior,
    /// Only surfaces of the model count: their normals are averages over many frames, and what
    /// shadows them is known. What lies outside the volume does not.
    pub model_only: bool,
    /// With a lamp: one albedo for each class of colour, instead of one for all.
    pub albedo_classes: bool,
    /// Directions of surface count by the square root of the number of pixels that show them.
    pub balance_normals: bool,
    /// Surfaces reflect this share of the light that reaches them from hidden directions, where other
    /// surfaces of mean brightness are: taken away before the fit. 0: nothing comes from there.
    pub hidden_radiance: f32,
    /// World point where the light is wanted; none: in the middle of the virtual objects, or without
    /// any, of what is seen.
    pub at: Option<[f64; 3]>,
    /// Tikhonov weight of what is added to the prior's light, relative to the mean eigenvalue (trace / n) of the normal equations.
    pub tikhonov: f64,
    /// The penalty of band l is multiplied by (l (l + 1) / 2)^band_power; 0 treats all bands alike.
    /// Bands 0 and 1 have the same.
    pub band_power: f64,
    /// Huber threshold in robust standard deviations of the residual; 0 is plain least squares.
    pub huber: f32,
    /// What a frame's samples count for, a frame later. Sixteen frames are remembered at most.
    pub memory: f64,
    /// The past is dropped where a quarter of the surfaces changes its brightness by this (natural
    /// logarithm), two frames long.
    pub change_threshold: f32,
    /// Pixels whose brightest channel (encoded, [0, 1]) is above are saturated; below, black.
    pub max_encoded: f32,
    pub min_encoded: f32,
    /// Pixels seen at a cosine below this have no reliable normal.
    pub min_cosine: f32,
    /// Every n-th pixel in x and y is used (not finer than the transfer).
    pub stride: usize,
    /// What the scene's mean albedo is taken to be where an absolute one is needed.
    pub mean_albedo: f32,
}

impl Default for LightParams {
    fn default() -> Self {
        Self {
            channels: LightChannels::default(),
            prior: LightPrior::default(),
            model_only: true,
            albedo_classes: true,
            balance_normals: true,
            hidden_radiance: 0.5,
            at: None,
            tikhonov: 1.0,
            band_power: 0.5,
            huber: 1.345,
            memory: 0.9,
            change_threshold: 0.2,
            max_encoded: 0.98,
            min_encoded: 0.02,
            min_cosine: 0.2,
            stride: 2,
            mean_albedo: 0.5,
        }
    }
}
