//! Transfer error: a transfer map against ray-traced transfer of the same points.
//!
//! With T the map, T* the traced transfer and T_o that of an open surface with the same normal, each
//! a vector of all coefficients of all sampled points:
//!
//! ```text
//! relative_l2        |T - T*| / |T*|                   of the whole transfer
//! open_relative_l2   |T_o - T*| / |T*|                 had visibility been ignored
//! hidden_relative_l2 |T - T*| / |T_o - T*|             of the part that geometry hides, T_o - T
//! ```
//!
//! The first is what the table at [`crate::transfer::ChiReading`] lists. The last is the quotient of
//! the other two: 0 is exact, 1 is no better than ignoring visibility.
//!
//! Which geometry the rays meet is the caller's choice: [`crate::synth::TrueWorld`] for made
//! sequences, [`SurfaceRays`] over the reconstructed mesh for recordings. So is where they start:
//! with the buffer that the map was computed from, visibility alone is measured; with
//! [`crate::synth::TrueWorld::seen_in`] of the same view, errors of depth and normals count too.
//!
//! So is how long the rays are. The transfer stage looks no farther than its radius, and nothing
//! outside the volume: unlimited rays in the true room count what it leaves out by design, rays of that
//! radius what it gets wrong.

#[cfg(test)]
mod made_scene_tests;
mod surface_rays;
#[cfg(test)]
mod tests;

pub use surface_rays::SurfaceRays;

use super::EvalError;
use crate::geometry::GBuffer;
use crate::math::sh::{MAX_BANDS, MAX_COEFFICIENTS, coefficients, unoccluded_transfer};
use crate::transfer::TransferMap;
use crate::transfer::reference::traced_transfer;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TransferErrorOptions {
    /// Rays a point. Their lattice is off by about 1 % of a half-hidden sky at 256.
    pub rays: usize,
    /// Every how many grid points are sampled, in x and y.
    pub every: usize,
    /// Points are lifted by this along their normal before rays start. 1 cm, the transfer stage's own bias,
    /// keeps noisy points out of the true surface; 1e-4 does for exact points.
    pub lift_m: f32,
}

impl Default for TransferErrorOptions {
    fn default() -> Self {
        Self { rays: 256, every: 4, lift_m: 0.01 }
    }
}

/// Errors over the sampled points; see the module's documentation.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct TransferError {
    pub relative_l2: f64,
    pub open_relative_l2: f64,
    /// None where nothing is hidden.
    pub hidden_relative_l2: Option<f64>,
    /// Mean error of what constant light of radiance 1 makes of a point (coefficient 0 times
    /// 2 sqrt pi; 1 is open): above 0, the map is too bright.
    pub dc_bias: f64,
    /// Share of constant light that is truly hidden, mean over points.
    pub hidden_share: f64,
    /// Points with a surface that were compared.
    pub points: usize,
}

/// Compares `map` with transfer traced from the points of `receivers`, a buffer of the map's view;
/// `occluded(point, unit direction)` tells whether a ray meets anything. Points that lack depth or
/// a normal do not count. The result is the same for any number of threads.
///
/// # Errors
/// `rays` or `every` of 0, a map that was not made for a buffer of this size, no point with a surface
/// that light can reach.
pub fn transfer_error(
    map: &TransferMap,
    receivers: &GBuffer,
    occluded: impl Fn(Vec3, Vec3) -> bool + Sync,
    options: &TransferErrorOptions,
) -> Result<TransferError, EvalError> {
    check(map, receivers, options)?;
    let samples: Vec<(usize, usize)> = (0..map.grid.height)
        .step_by(options.every)
        .flat_map(|j| (0..map.grid.width).step_by(options.every).map(move |i| (i, j)))
        .collect();
    let points: Vec<Option<Sums>> = samples
        .par_iter()
        .map(|&(i, j)| {
            let (position, normal) = receiver(map, receivers, i, j, options.lift_m)?;
            let truth = traced_transfer(&occluded, position, normal, map.bands, options.rays);
            Some(Sums::of_point(map.at(i, j), &truth, normal, map.bands))
        })
        .collect();
    let sums = points.into_iter().flatten().fold(Sums::default(), Sums::plus);
    sums.error().ok_or_else(|| {
        EvalError::Undefined("transfer error without a surface that light can reach".into())
    })
}

fn check(
    map: &TransferMap,
    receivers: &GBuffer,
    options: &TransferErrorOptions,
) -> Result<(), EvalError> {
    let undefined = |problem: String| Err(EvalError::Undefined(problem));
    if options.rays == 0 || options.every == 0 {
        return undefined("transfer error needs rays and every of at least 1".into());
    }
    let size = receivers.size();
    let made_for = |grid: usize, length: usize| map.step > 0 && grid == length.div_ceil(map.step);
    let consistent = (1..=MAX_BANDS).contains(&map.bands)
        && map.coefficients.len() == map.grid.pixels() * coefficients(map.bands);
    if !consistent
        || !made_for(map.grid.width, size.width)
        || !made_for(map.grid.height, size.height)
    {
        let (grid, step) = (map.grid, map.step);
        return undefined(format!(
            "a transfer map of {grid} with step {step} is not of a {size} buffer"
        ));
    }
    Ok(())
}

/// Lifted position and normal of a grid point.
fn receiver(
    map: &TransferMap,
    receivers: &GBuffer,
    i: usize,
    j: usize,
    lift_m: f32,
) -> Option<(Vec3, Vec3)> {
    let (x, y) = map.pixel(i, j, receivers.size());
    let depth_m = receivers.depth_m[(x, y)];
    let normal = receivers.normals.at(x, y).try_normalize()?;
    if depth_m <= 0.0 {
        return None;
    }
    let view = &receivers.view;
    let in_view = view.unproject(Vec2::new(x as f32, y as f32), depth_m);
    let position = view.world_from_view_f32().transform_point3(in_view) + normal * lift_m;
    Some((position, normal))
}

#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    error2: f64,
    open_error2: f64,
    norm2: f64,
    dc_error: f64,
    dc_hidden: f64,
    points: usize,
}

impl Sums {
    fn of_point(
        found: &[f32],
        truth: &[f32; MAX_COEFFICIENTS],
        normal: Vec3,
        bands: usize,
    ) -> Self {
        let open = unoccluded_transfer(normal, bands);
        let mut out = Self { points: 1, ..Self::default() };
        for k in 0..coefficients(bands) {
            let [found, truth, open] = [found[k], truth[k], open[k]].map(f64::from);
            out.error2 += (found - truth).powi(2);
            out.open_error2 += (open - truth).powi(2);
            out.norm2 += truth * truth;
        }
        // 2 sqrt pi: the coefficient 0 of constant radiance 1
        let furnace = |t: f32| f64::from(t) * 2.0 * std::f64::consts::PI.sqrt();
        out.dc_error = furnace(found[0]) - furnace(truth[0]);
        out.dc_hidden = furnace(open[0]) - furnace(truth[0]);
        out
    }

    fn plus(self, other: Self) -> Self {
        Self {
            error2: self.error2 + other.error2,
            open_error2: self.open_error2 + other.open_error2,
            norm2: self.norm2 + other.norm2,
            dc_error: self.dc_error + other.dc_error,
            dc_hidden: self.dc_hidden + other.dc_hidden,
            points: self.points + other.points,
        }
    }

    /// `None` without points, or where no light reaches any but for the rounding of f32 coefficients.
    fn error(&self) -> Option<TransferError> {
        if self.norm2 <= 1e-12 * self.points as f64 {
            return None;
        }
        let ratio = |a: f64, b: f64| (b > 0.0).then(|| (a / b).sqrt());
        let points = self.points as f64;
        Some(TransferError {
            relative_l2: ratio(self.error2, self.norm2)?,
            open_relative_l2: ratio(self.open_error2, self.norm2)?,
            hidden_relative_l2: ratio(self.error2, self.open_error2),
            dc_bias: self.dc_error / points,
            hidden_share: self.dc_hidden / points,
            points: self.points,
        })
    }
}
