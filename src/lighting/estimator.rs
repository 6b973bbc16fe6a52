//! The light from frame to frame: memory, robustness, and what to do with frames that show nothing.

use super::bank::{Bank, Batch};
use super::change::LastPicture;
use super::field::LightField;
use super::fit::{Deviating, Fit};
#[cfg(feature = "gpu")]
use super::picked::PickedSamples;
use super::samples::{Counts, Samples, Seen};
use super::solve::{Spectrum, spectrum};
use super::{LightParams, ShLight};
use crate::capture::RgbdFrame;
use crate::geometry::GBuffer;
use crate::math::{View, sh};
use crate::transfer::TransferMap;
use glam::Vec3;

/// Samples that are needed for each coefficient.
const SAMPLES_PER_COEFFICIENT: usize = 4;

/// Pictures change by noise alone: only more than this many times as much counts.
const ABOVE_USUAL: f32 = 3.0;

/// Why a frame brought no new light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Rejection {
    #[error("too few pixels show a surface")]
    NoSurface,
    #[error("too few pixels are bright enough")]
    TooDark,
    #[error("too many pixels are saturated")]
    Saturated,
    #[error("too many surfaces are seen at grazing angles")]
    Grazing,
    #[error("surfaces are brighter or darker than before; waiting for the next frame to confirm")]
    Unconfirmed,
    #[error("the solution is not finite")]
    NotFinite,
}

/// The light of a frame, and how far it can be trusted.
#[derive(Clone, Debug, PartialEq)]
pub struct LightEstimate {
    /// Times the scene's mean albedo. The last good one where `rejection` is set; before any good
    /// frame a neutral rig: ambient, and weak light from above the camera.
    pub light: ShLight,
    /// Condition number of the accumulated normal equations, without the prior; at most 1e16.
    pub condition: f64,
    /// Their numerical rank.
    pub rank: usize,
    /// Root mean square of the residual, relative to that of the image.
    pub residual: f64,
    /// Standard deviation of each coefficient of the luminance: noise, what is not seen of the lamp, and
    /// light beside it that is held back or not seen, believed to be of the size that it has where it is. Takes
    /// errors for independent from sample to sample, and albedo for uniform within its classes.
    pub deviation: Vec<f32>,
    /// The same at any other point.
    pub field: LightField,
    /// Usable pixels; the light is fitted to an even selection of them.
    pub pixels: usize,
    /// `None` for a light from this frame.
    pub rejection: Option<Rejection>,
    /// Frames since the light was last renewed; 0 for a light from this frame.
    pub age_frames: usize,
    /// This frame showed another light than those before: they were dropped.
    pub changed: bool,
}

impl LightEstimate {
    /// A light that is known, and so comes from no pixel.
    pub fn given(light: ShLight) -> Self {
        Self {
            condition: 1.0,
            rank: light.coefficients.len(),
            residual: 0.0,
            deviation: vec![0.0; light.coefficients.len()],
            pixels: 0,
            rejection: None,
            age_frames: 0,
            changed: false,
            field: LightField::uniform(light.clone()),
            light,
        }
    }

    pub fn valid(&self) -> bool {
        self.rejection.is_none()
    }
}

/// LightEst stage.
#[derive(Clone, Debug)]
pub struct LightEstimator {
    params: LightParams,
    samples: Samples,
    bank: Bank,
    fit: Fit,
    last: Option<LightEstimate>,
    before: LastPicture,
    /// Change from picture to picture in recent frames.
    usual_change: f32,
    /// The last frame did not fit the past.
    suspect: bool,
}

impl LightEstimator {
    pub fn new(params: &LightParams) -> Self {
        Self {
            params: params.clone(),
            samples: Samples::default(),
            bank: Bank::default(),
            fit: Fit::default(),
            last: None,
            before: LastPicture::default(),
            usual_change: 0.0,
            suspect: false,
        }
    }

    /// Forgets all frames.
    pub fn reset(&mut self) {
        self.forget();
        self.last = None;
        self.suspect = false;
    }

    fn forget(&mut self) {
        self.bank.clear();
        self.fit.forget();
        self.before.forget();
        self.usual_change = 0.0;
    }

    /// Takes other settings, and other bands, from the next frame on. What was learnt is kept where
    /// bands and channels stay; the last light is kept in any case, cut off or with zeros added.
    pub fn reconfigure(&mut self, params: &LightParams, bands: usize) {
        self.params = params.clone();
        if let Some(last) = &mut self.last {
            last.light.bands = bands;
            last.light.coefficients.resize(sh::coefficients(bands), [0.0; 3]);
            last.field = LightField::uniform(last.light.clone());
            let unknown = last.deviation.iter().copied().fold(0.0, f32::max);
            last.deviation.resize(sh::coefficients(bands), unknown);
        }
    }

    /// Takes in one frame. `surface` and `frame` have one size, and `transfer` belongs to `surface`.
    ///
    /// The light is that at the point `at`, in the world of the surfaces; without one, in the middle of what
    /// is seen. It depends on the place where a lamp is near.
    pub fn estimate(
        &mut self,
        frame: &RgbdFrame,
        surface: &GBuffer,
        transfer: &TransferMap,
        at: Option<Vec3>,
    ) -> LightEstimate {
        let seen = Seen { frame, surface, transfer };
        let estimate = match self.renew(&seen, at) {
            Ok(estimate) => estimate,
            Err(rejection) => self.keep(rejection, &surface.view, transfer.bands),
        };
        self.last = Some(estimate.clone());
        estimate
    }

    /// As [`Self::estimate`], for samples that were picked elsewhere. Whoever picks them keeps the picture of each
    /// frame whose estimate is valid; the brightness of samples `then` is that in the last one. An estimator takes
    /// either kind of frames.
    #[cfg(feature = "gpu")]
    pub fn estimate_picked(&mut self, picked: &PickedSamples, at: Option<Vec3>) -> LightEstimate {
        let estimate = match self.renew_from_picked(picked, at) {
            Ok(estimate) => estimate,
            Err(rejection) => self.keep(rejection, &picked.view, picked.bands),
        };
        self.last = Some(estimate.clone());
        estimate
    }

    #[cfg(feature = "gpu")]
    fn renew_from_picked(
        &mut self,
        picked: &PickedSamples,
        at: Option<Vec3>,
    ) -> Result<LightEstimate, Rejection> {
        let mut present = self.begin(&picked.counts, picked.bands)?;
        picked.fill(self.params.hidden_radiance, &mut present);
        let then = picked.points.iter().map(|point| point.then);
        let change = self.before.change_since(&present, then);
        let estimate = self.explain(present, change, &picked.counts, picked.bands, at)?;
        self.before.keep_elsewhere(picked.view);
        Ok(estimate)
    }

    /// For frames whose surface is unknown, as where the camera is lost.
    pub fn without_surface(&mut self, view: &View, bands: usize) -> LightEstimate {
        let estimate = self.keep(Rejection::NoSurface, view, bands);
        self.last = Some(estimate.clone());
        estimate
    }

    fn renew(&mut self, seen: &Seen, at: Option<Vec3>) -> Result<LightEstimate, Rejection> {
        let counts = self.samples.find(seen, &self.params);
        let mut present = self.begin(&counts, seen.transfer.bands)?;
        self.samples.pick(seen, self.params.hidden_radiance, &mut present);
        let change = self.before.change(&present);
        let estimate = self.explain(present, change, &counts, seen.transfer.bands, at)?;
        self.before.keep(seen);
        Ok(estimate)
    }

    /// An empty batch, with what is past forgotten where it is of another kind.
    fn begin(&mut self, counts: &Counts, bands: usize) -> Result<Batch, Rejection> {
        let n = sh::coefficients(bands);
        enough_samples(counts, n)?;
        if self.last.is_none() || self.bank.coefficients() != n {
            self.forget();
            self.suspect = false;
        }
        Ok(self.bank.blank())
    }

    /// The light that explains the samples of this frame and of those before.
    fn explain(
        &mut self,
        present: Batch,
        change: Option<f32>,
        counts: &Counts,
        bands: usize,
        at: Option<Vec3>,
    ) -> Result<LightEstimate, Rejection> {
        let n = sh::coefficients(bands);
        let changed = self.detect_change(change)?;
        if changed {
            self.forget();
        }
        if self.params.memory <= 0.0 {
            self.fit.forget();
        }
        self.bank.push(present, n, self.params.memory as f32);
        let solution = self.fit.explain(&mut self.bank, &self.params);
        let newest = self.bank.newest().expect("pushed above");
        let residual = self.fit.residual(newest, n);
        let field = self.fit.light_field(&solution, bands);
        let light = field.at(at);
        let finite = light.coefficients.iter().flatten().all(|c| c.is_finite());
        if !(finite && residual.squares.is_finite()) {
            self.forget();
            return Err(Rejection::NotFinite);
        }
        let Spectrum { rank, condition } = spectrum(self.fit.equations());
        let deviation = self.fit.deviation(&Deviating {
            bank: &self.bank,
            params: &self.params,
            solution: &solution,
            light: &light,
            at,
            noise: residual.noise(rank),
        });
        Ok(LightEstimate {
            deviation,
            light,
            condition,
            rank,
            residual: residual.relative(),
            field,
            pixels: counts.used,
            rejection: None,
            age_frames: 0,
            changed,
        })
    }

    /// Whether this frame shows another light than those before.
    ///
    /// The first frame whose surfaces are brighter or darker is refused: it may be a flash, or a hand before
    /// the lens. A second one that differs as much from the same picture decides.
    fn detect_change(&mut self, change: Option<f32>) -> Result<bool, Rejection> {
        let Some(change) = change else {
            self.suspect = false;
            return Ok(false);
        };
        if change <= self.params.change_threshold.max(ABOVE_USUAL * self.usual_change) {
            self.suspect = false;
            self.usual_change = 0.5 * (self.usual_change + change);
            return Ok(false);
        }
        if std::mem::replace(&mut self.suspect, true) {
            self.suspect = false;
            return Ok(true);
        }
        Err(Rejection::Unconfirmed)
    }

    /// The last good light, grown older.
    fn keep(&self, rejection: Rejection, view: &View, bands: usize) -> LightEstimate {
        let mut kept = match &self.last {
            Some(last) => last.clone(),
            None => neutral(view, bands),
        };
        kept.rejection = Some(rejection);
        kept.age_frames += 1;
        kept.changed = false;
        kept
    }
}

fn enough_samples(counts: &Counts, coefficients: usize) -> Result<(), Rejection> {
    if counts.used >= SAMPLES_PER_COEFFICIENT * coefficients {
        return Ok(());
    }
    let reasons = [
        (counts.saturated, Rejection::Saturated),
        (counts.dark, Rejection::TooDark),
        (counts.grazing, Rejection::Grazing),
        (counts.no_surface, Rejection::NoSurface),
    ];
    let commonest = reasons.iter().max_by_key(|(count, _)| *count);
    Err(commonest.map_or(Rejection::NoSurface, |&(_, reason)| reason))
}

/// A grey room before anything has been seen: a surface facing the light shows middle grey. The
/// caller says why it is needed.
fn neutral(view: &View, bands: usize) -> LightEstimate {
    const AMBIENT: f32 = 0.12;
    const FROM_ABOVE: f32 = 0.06;
    let up = view.world_from_view_f32().transform_vector3(-glam::Vec3::Y);
    let direction = sh::basis(up, bands);
    // An unoccluded surface reflects A_l / pi times each band: choose what gives these two values.
    let y00 = direction[0];
    let band_1 = FROM_ABOVE / (2.0 / 3.0 * sh::basis(glam::Vec3::Z, 2)[2].powi(2));
    let coefficients = (0..sh::coefficients(bands))
        .map(|i| match i {
            0 => [AMBIENT / y00; 3],
            1..=3 => [band_1 * direction[i]; 3],
            _ => [0.0; 3],
        })
        .collect();
    let light = ShLight { bands, coefficients };
    LightEstimate {
        field: LightField::uniform(light.clone()),
        light,
        condition: 1e16,
        rank: 0,
        residual: 0.0,
        deviation: vec![AMBIENT / y00; sh::coefficients(bands)],
        pixels: 0,
        rejection: None,
        age_frames: 0,
        changed: false,
    }
}
