//! The RadTransfer stage in image space, as [`crate::transfer::RadianceTransfer`].
//!
//! ```text
//! limits -> real              transfer of the real scene
//! insert -> merged            transfer with virtual surfaces, and one bounce of light
//! ```
//!
//! One invocation looks along all directions from one point of the grid. What spares the CPU most look-ups
//! (packets of points, pyramids of nearest depths) is not there, nor is the border of the depth limits. Where
//! a sample may be behind a virtual pixel, transfer is computed anew, while the CPU adds the difference:
//! equal but for rounding.

mod atlas;
mod uniforms;

#[cfg(test)]
mod tests;

use super::transfer_map::grid_size;
use super::{GpuIndirectMap, GpuTransferMap};
use crate::gpu::{Commands, Gpu, GpuBuffer, GpuError, Shader};
use crate::math::sh::coefficients;
use crate::timing::Stage;
use crate::transfer::{BounceParams, DirectionSet, TransferParams};
use atlas::Atlas;
pub use atlas::{GpuBuffers, GpuRadiance};
pub use uniforms::MAX_VIEWS;
use uniforms::{TransferUniform, TransferView};

fn with_views(file: &'static str, bands: usize, views: usize) -> Shader {
    Shader::new(file).with_u32("BANDS", bands).with_u32("VIEWS", views)
}

#[cfg(test)]
pub(super) fn shaders() -> Vec<Shader> {
    let mut all = vec![atlas::limits_shader(), atlas::insert_shader()];
    for (bands, views) in [(1, 1), (2, 1), (3, 4), (4, 5), (5, 5), (6, MAX_VIEWS)] {
        all.push(with_views("transfer/real", bands, views));
        all.push(with_views("transfer/merged", bands, views));
    }
    all
}

/// The stage, with what it keeps from frame to frame.
pub struct TransferPass {
    params: TransferParams,
    bounce: BounceParams,
    set: DirectionSet,
    /// A direction, then its spherical harmonics, four to a value.
    directions: GpuBuffer<[f32; 4]>,
    /// Metres; by cell of the jitter tile, direction and sample.
    distances_m: GpuBuffer<f32>,
    atlas: Atlas,
}

impl TransferPass {
    /// `set` must have been made of `params`.
    pub fn new(
        gpu: &Gpu,
        params: &TransferParams,
        bounce: &BounceParams,
        set: &DirectionSet,
    ) -> Result<Self, GpuError> {
        let directions = direction_rows(set, params.bands);
        Ok(Self {
            directions: GpuBuffer::from_slice(gpu, "directions", &directions)?,
            distances_m: GpuBuffer::from_slice(gpu, "sample distances", &distances_m(set, params))?,
            atlas: Atlas::new(gpu, params.bias_m)?,
            set: set.clone(),
            params: params.clone(),
            bounce: bounce.clone(),
        })
    }

    /// Transfer of every grid point of the main buffer.
    ///
    /// # Panics
    /// If `out` has not the bands, step and grid of this stage, or there are [`MAX_VIEWS`] auxiliary buffers
    /// or more.
    pub fn transfer(
        &mut self,
        commands: &mut Commands<'_>,
        real: GpuBuffers,
        out: &GpuTransferMap,
    ) -> Result<(), GpuError> {
        self.assert_fits(real, out);
        commands.stage(Stage::RadTransfer);
        self.atlas.show(commands, real)?;
        commands
            .pass(&self.shader("transfer/real"))?
            .uniform(&self.uniform(out, 0.0))?
            .read(&self.directions)?
            .read(&self.distances_m)?
            .read(&self.atlas.real_limits_m)?
            .read(&real.0.surface)?
            .write(&out.coefficients)?
            .over(out.grid)
    }

    /// Transfer of real and virtual surfaces together; and one bounce of light, with `radiance` leaving the
    /// pixels of each merged buffer.
    ///
    /// The last call of [`Self::transfer`] must have made `real_transfer` of the real buffers, and `merged`
    /// must differ from these in pixels of [`crate::geometry::Origin::Virtual`] alone. Light on real
    /// surfaces comes from virtual ones alone (Eq. 14), light on virtual surfaces from all; without virtual
    /// pixels or radiance it is zero everywhere.
    ///
    /// # Panics
    /// If sizes of buffers, pictures or maps do not belong together.
    pub fn transfer_and_bounce(
        &mut self,
        commands: &mut Commands<'_>,
        merged: GpuBuffers,
        radiance: Option<GpuRadiance>,
        real_transfer: &GpuTransferMap,
        out: &GpuTransferMap,
        indirect: &GpuIndirectMap,
    ) -> Result<(), GpuError> {
        self.assert_fits(merged, real_transfer);
        self.assert_fits(merged, out);
        assert_eq!((indirect.step, indirect.grid), (out.step, out.grid), "step and grid");
        commands.stage(Stage::RadTransfer);
        let radiance = radiance.filter(|_| self.bounce.enabled);
        self.atlas.insert(commands, merged, radiance)?;
        commands.copy(&real_transfer.coefficients, &out.coefficients, out.coefficients.len());
        let strength = radiance.map_or(0.0, |_| self.bounce.strength);
        commands
            .pass(&self.shader("transfer/merged"))?
            .uniform(&self.uniform(out, strength))?
            .read(&self.directions)?
            .read(&self.distances_m)?
            .read(&self.atlas.limits_m)?
            .read(&self.atlas.emitters)?
            .read(&self.atlas.extents)?
            .write(&out.coefficients)?
            .write(&indirect.light)?
            .over(out.grid)
    }

    fn assert_fits(&self, (main, _): GpuBuffers, map: &GpuTransferMap) {
        let TransferParams { bands, subsampling, .. } = self.params;
        let grid = grid_size(subsampling, main.size());
        assert_eq!((map.bands, map.step, map.grid), (bands, subsampling, grid), "map of transfer");
    }

    fn shader(&self, file: &'static str) -> Shader {
        with_views(file, self.params.bands, self.atlas.views().len())
    }

    fn uniform(&self, map: &GpuTransferMap, strength: f32) -> TransferUniform {
        let mut uniform = TransferUniform::new(&self.params, &self.set, map.grid, strength);
        let views = self.atlas.views();
        for (to, (view, first)) in uniform.views.iter_mut().zip(views) {
            *to = TransferView::new(view, &views[0].0, *first);
        }
        uniform
    }
}

/// A direction, then its spherical harmonics: `ROW` values, as the shaders want them.
pub(super) fn direction_rows(set: &DirectionSet, bands: usize) -> Vec<[f32; 4]> {
    let n = coefficients(bands).next_multiple_of(4);
    (set.directions.iter().enumerate())
        .flat_map(|(k, w)| {
            let harmonics = set.row(k)[..n].as_chunks::<4>().0.iter().copied();
            std::iter::once([w.x, w.y, w.z, 0.0]).chain(harmonics)
        })
        .collect()
}

fn distances_m(set: &DirectionSet, params: &TransferParams) -> Vec<f32> {
    let tile = set.tile();
    let mut out = Vec::with_capacity(tile * tile * set.len() * params.samples);
    for cell in 0..tile * tile {
        for direction in 0..set.len() {
            let samples = 0..params.samples;
            out.extend(samples.map(|s| set.distance_m(direction, s, cell % tile, cell / tile)));
        }
    }
    out
}
