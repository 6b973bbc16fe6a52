//! The light from frame to frame: memory, robustness, and what to do with frames that show nothing.

use super::normal_equations::NormalEquations;
use super::samples::{Counts, Residual, Samples};
use super::solve::{Prior, Solution, Spectrum, solve, spectrum};
use super::{LightParams, ShLight};
use crate::capture::RgbdFrame;
use crate::geometry::GBuffer;
use crate::math::color::luminance;
use crate::math::{View, sh};
use crate::transfer::TransferMap;

/// Samples that are needed for each coefficient.
const SAMPLES_PER_COEFFICIENT: usize = 4;

/// Rounds of re-weighting. The weights of an L1-like loss settle within a few.
const HUBER_ROUNDS: usize = 2;

/// Weight of the past against the present when the two are compared.
const PAST_DOMINANCE: f64 = 10.0;

/// Residuals below this (relative) are quantisation: they never count as a change of light.
const QUIET_RESIDUAL: f64 = 0.02;

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
    #[error("the picture does not fit the light so far; waiting for the next frame to confirm")]
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
    /// Standard deviation of each coefficient of the luminance. Takes errors for independent from
    /// pixel to pixel, the prior for a true one and the albedo for uniform: a lower bound.
    pub deviation: Vec<f32>,
    /// Pixels used.
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
    /// Normal equations of the frames so far, with forgetting.
    past: NormalEquations,
    /// Those of the present frame, and of both together.
    present: NormalEquations,
    total: NormalEquations,
    last: Option<LightEstimate>,
    /// Residuals of recent frames under the light before them.
    usual_residual: f64,
    /// The last frame did not fit the past.
    suspect: bool,
}

impl LightEstimator {
    pub fn new(params: &LightParams) -> Self {
        Self {
            params: params.clone(),
            samples: Samples::default(),
            past: NormalEquations::default(),
            present: NormalEquations::default(),
            total: NormalEquations::default(),
            last: None,
            usual_residual: 0.0,
            suspect: false,
        }
    }

    /// Forgets all frames.
    pub fn reset(&mut self) {
        self.past.reset(0, 0);
        self.last = None;
        self.suspect = false;
    }

    /// Takes other settings, and other bands, from the next frame on. What was learnt is kept where
    /// bands and channels stay; the last light is kept in any case, cut off or with zeros added.
    pub fn reconfigure(&mut self, params: &LightParams, bands: usize) {
        self.params = params.clone();
        if let Some(last) = &mut self.last {
            last.light.bands = bands;
            last.light.coefficients.resize(sh::coefficients(bands), [0.0; 3]);
            let unknown = last.deviation.iter().copied().fold(0.0, f32::max);
            last.deviation.resize(sh::coefficients(bands), unknown);
        }
    }

    /// Takes in one frame. `surface` and `frame` have one size, and `transfer` belongs to `surface`.
    pub fn estimate(
        &mut self,
        frame: &RgbdFrame,
        surface: &GBuffer,
        transfer: &TransferMap,
    ) -> LightEstimate {
        let renewed = self.renew(frame, surface, transfer);
        let estimate = match renewed {
            Ok(estimate) => {
                self.past.clone_from(&self.total);
                estimate
            }
            Err(rejection) => self.keep(rejection, &surface.view, transfer.bands),
        };
        self.last = Some(estimate.clone());
        estimate
    }

    /// The light of a frame without any surface to look at: the last one, a frame older.
    pub fn without_surface(&mut self, view: &View, bands: usize) -> LightEstimate {
        let estimate = self.keep(Rejection::NoSurface, view, bands);
        self.last = Some(estimate.clone());
        estimate
    }

    fn renew(
        &mut self,
        frame: &RgbdFrame,
        surface: &GBuffer,
        transfer: &TransferMap,
    ) -> Result<LightEstimate, Rejection> {
        let counts = self.samples.gather(frame, surface, transfer, &self.params);
        let n = sh::coefficients(transfer.bands);
        enough_samples(&counts, n)?;
        self.samples.accumulate(&mut self.present);
        let changed = self.detect_change()?;
        if changed {
            self.past.reset(0, 0);
        }
        let solution = self.solve_robustly();
        let light = sh_light(&solution.light, transfer.bands);
        let residual = self.samples.residual(&light.luminance());
        let finite = light.coefficients.iter().flatten().all(|c| c.is_finite());
        if !(finite && residual.squares.is_finite()) {
            return Err(Rejection::NotFinite);
        }
        if changed || self.past.n == 0 {
            self.usual_residual = residual.relative();
        }
        let Spectrum { rank, condition } = spectrum(&self.total);
        Ok(LightEstimate {
            deviation: deviation(&solution, &light, &residual, rank),
            light,
            condition,
            rank,
            residual: residual.relative(),
            pixels: counts.used,
            rejection: None,
            age_frames: 0,
            changed,
        })
    }

    /// Does the present frame show another light than the past? The first frame that says so must
    /// be confirmed by the next, so that a single bad picture costs one frame and no more.
    ///
    /// The present is held against a light that fits the past first, and the present only in what
    /// the past leaves open: a view of new surfaces is no change. Nor is a picture that no light
    /// explains (another albedo): its own best light must do clearly better.
    fn detect_change(&mut self) -> Result<bool, Rejection> {
        if self.last.is_none() || !self.past.same_shape(&self.present) {
            self.past.reset(0, 0);
            self.suspect = false;
            return Ok(false);
        }
        self.total.clone_from(&self.present);
        self.total.add_scaled(&self.past, PAST_DOMINANCE);
        let under_past = residual_under(&mut self.samples, &self.total, &self.params);
        let limit = self.params.change_factor * self.usual_residual.max(QUIET_RESIDUAL);
        if under_past <= limit {
            self.suspect = false;
            self.usual_residual = 0.5 * (self.usual_residual + under_past);
            return Ok(false);
        }
        if !std::mem::replace(&mut self.suspect, true) {
            return Err(Rejection::Unconfirmed);
        }
        self.suspect = false;
        let own = residual_under(&mut self.samples, &self.present, &self.params);
        self.usual_residual = under_past;
        Ok(under_past > self.params.change_factor * own.max(QUIET_RESIDUAL))
    }

    /// Iteratively re-weighted least squares on the present frame, together with the past.
    fn solve_robustly(&mut self) -> Solution {
        let mut solution = self.solve_with_past();
        let rounds = if self.params.huber > 0.0 { HUBER_ROUNDS } else { 0 };
        for _ in 0..rounds {
            self.samples.residual(&mono(&solution.light));
            self.samples.weigh(self.params.huber);
            self.samples.accumulate(&mut self.present);
            solution = self.solve_with_past();
        }
        solution
    }

    fn solve_with_past(&mut self) -> Solution {
        self.total.clone_from(&self.present);
        if self.past.same_shape(&self.present) {
            self.total.add_scaled(&self.past, self.params.memory);
        }
        solve(&self.total, &Prior::new(&self.total, &self.params))
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

/// Relative residual of the samples under the light that solves these equations.
fn residual_under(samples: &mut Samples, equations: &NormalEquations, params: &LightParams) -> f64 {
    let light = solve(equations, &Prior::new(equations, params)).light;
    samples.residual(&mono(&light)).relative()
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

fn sh_light(channels: &[Vec<f64>], bands: usize) -> ShLight {
    let coefficients = (0..channels[0].len())
        .map(|i| match channels {
            [r, g, b] => [r[i] as f32, g[i] as f32, b[i] as f32],
            _ => [channels[0][i] as f32; 3],
        })
        .collect();
    ShLight { bands, coefficients }
}

/// Luminance of a light of one or three channels.
fn mono(channels: &[Vec<f64>]) -> Vec<f32> {
    match channels {
        [r, g, b] => {
            (0..r.len()).map(|i| luminance([r[i] as f32, g[i] as f32, b[i] as f32])).collect()
        }
        _ => channels[0].iter().map(|&v| v as f32).collect(),
    }
}

fn deviation(solution: &Solution, light: &ShLight, residual: &Residual, rank: usize) -> Vec<f32> {
    let freedom = (residual.weight - rank as f64).max(1.0);
    let noise = residual.squares / freedom;
    let luminance = light.luminance();
    let power = luminance.iter().map(|&l| f64::from(l).powi(2)).sum::<f64>();
    // Where nothing is known, all that can be said is that the light is of its usual size.
    let unknown = power / luminance.len().max(1) as f64;
    (solution.variance.iter().zip(&solution.undetermined))
        .map(|(v, u)| (noise * v + unknown * u).sqrt() as f32)
        .collect()
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
    LightEstimate {
        light: ShLight { bands, coefficients },
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
