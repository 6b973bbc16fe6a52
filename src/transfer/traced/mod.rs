//! Radiance transfer by rays through the volume: what image-space transfer is compared with (the
//! methods GR12 and GR14 of Gruber et al. 2015, Sec. 6).
//!
//! The transfer is that of [`RadianceTransfer`](super::RadianceTransfer), with the same directions and
//! the same treatment of what is open; only visibility differs. K_j is 0 where a ray from the surface
//! along w_j meets a surface within the ray's length, else 1. Rays reach what no buffer shows, and a
//! thin surface stops them; they cost a walk through voxels each, while a sample in a buffer is one
//! look-up.
//!
//! Left open by the paper, and decided here:
//! - The length of the rays: as far as image-space samples reach by default, so that both look for the
//!   same occluders.
//! - Where rays start: lifted along the normal by the bias, and at least one and a half voxels; what
//!   counts as a hit is said at `fusion::Occlusion`.
//! - Virtual objects are met as triangles. They hide light from real points within the length of the
//!   rays, to which the hits of the real pass are added; points on virtual surfaces trace both.
//! - Refinement (GR14): coarse points on every n-th pixel are always traced. Where the four around a
//!   pixel lie on one smooth surface and the pixel does so too, its transfer is their bilinear
//!   interpolation, else it is traced. Shadow borders on smooth surfaces are not refined.

use super::batch::Grid;
use super::directions::DirectionSet;
use super::{TransferError, TransferMap, TransferParams};
use crate::fusion::{EmptySpace, Occlusion, TsdfVolume};
use crate::geometry::GBuffer;
use crate::scene::{SceneRays, VirtualScene};
use cells::Cells;
use passes::{Before, Between, Rows, Trail, refine, refine_again, trace_grid, trace_grid_again};
use points::Surfaces;
use tracer::Tracer;

pub(crate) use cells::Smooth;
#[cfg(feature = "gpu")]
pub(crate) use cells::place;
#[cfg(feature = "gpu")]
pub(crate) use tracer::{OBJECT_LIFT_M, volume_lift_m};

mod cells;
mod passes;
mod points;
#[cfg(test)]
mod tests;
mod tracer;

/// Computes radiance transfer by rays through the volume and against virtual triangles.
#[derive(Debug)]
pub struct RayTracedTransfer {
    params: TransferParams,
    set: DirectionSet,
    space: EmptySpace,
    /// What rays meet beside the volume: nothing in the real pass.
    nothing: SceneRays,
    objects: SceneRays,
    /// Of the grid's points.
    trail: Trail,
    refined: Refined,
}

/// What refinement needs beside the grid.
#[derive(Debug, Default)]
struct Refined {
    real: Coarse,
    merged: Coarse,
    /// Coarse points that virtual objects change.
    changed: Vec<bool>,
    /// Of every pixel.
    trail: Trail,
}

#[derive(Debug, Default)]
struct Coarse {
    map: TransferMap,
    cells: Cells,
}

impl RayTracedTransfer {
    pub fn new(params: &TransferParams) -> Result<Self, TransferError> {
        Ok(Self {
            set: DirectionSet::new(params)?,
            params: params.clone(),
            space: EmptySpace::default(),
            nothing: SceneRays::default(),
            objects: SceneRays::default(),
            trail: Trail::default(),
            refined: Refined::default(),
        })
    }

    /// What the volume hides from each grid point of the last real pass: a bit for each direction, in
    /// words of 32.
    #[cfg(all(test, feature = "gpu"))]
    pub(crate) fn hits(&self) -> &[u32] {
        self.trail.hits()
    }

    /// Transfer of every grid point of `main`; of every pixel, with refinement.
    pub fn transfer(&mut self, volume: &TsdfVolume, main: &GBuffer, out: &mut TransferMap) {
        self.space.survey(volume);
        let occlusion = Occlusion::new(volume, &self.space);
        let tracer = Tracer::new(&self.params, &self.set, occlusion, &self.nothing);
        let rows = Rows::new(&self.params, &self.set, &tracer, main);
        out.reshape(self.params.bands, &self.params.results(main.size()));
        if !self.params.refines() {
            return trace_grid(&rows, &mut self.trail, out);
        }
        let Refined { real: Coarse { map, cells }, trail, .. } = &mut self.refined;
        map.reshape(self.params.bands, &rows.grid);
        trace_grid(&rows, &mut self.trail, map);
        let smooth = Smooth::new(&self.params);
        cells.prepare(&rows.surfaces, &rows.grid, smooth);
        let between = Between { rows: rows.every_pixel(), cells, smooth, coarse: map };
        refine(&between, trail, out);
    }

    /// Transfer of real and virtual geometry together, with the directions of the real pass.
    ///
    /// `real_transfer` is what the last call of [`Self::transfer`] made of `volume` and `real`, and
    /// `merged` is `real` with `scene` drawn into it. Points that no object can influence are copied;
    /// for the others the hits of the real pass are used again. A map of other settings is not trusted:
    /// the real pass is made anew. Panics where the two buffers differ in size.
    pub fn transfer_with_virtual(
        &mut self,
        volume: &TsdfVolume,
        scene: &VirtualScene,
        (real, merged): (&GBuffer, &GBuffer),
        real_transfer: &TransferMap,
        out: &mut TransferMap,
    ) {
        assert_eq!(real.size(), merged.size(), "the real buffer against the merged one");
        let results = self.params.results(merged.size());
        let points = Grid::new(merged.size(), self.params.subsampling, 1).size().pixels();
        if real_transfer.fits(self.params.bands, &results) && self.trail.fits(points) {
            out.reshape(self.params.bands, &results);
            out.coefficients.copy_from_slice(&real_transfer.coefficients);
        } else {
            self.transfer(volume, real, out);
        }
        self.objects.update(scene);
        if self.objects.is_empty() {
            return;
        }
        let occlusion = Occlusion::new(volume, &self.space);
        let tracer = Tracer::new(&self.params, &self.set, occlusion, &self.objects);
        let rows = Rows::new(&self.params, &self.set, &tracer, merged);
        let before = Before { surfaces: Surfaces::new(real), trail: &self.trail };
        if !self.params.refines() {
            return trace_grid_again(&rows, &before, out);
        }
        let Refined { real, merged: Coarse { map, cells }, changed, trail } = &mut self.refined;
        map.reshape(self.params.bands, &rows.grid);
        map.coefficients.copy_from_slice(&real.map.coefficients);
        trace_grid_again(&rows, &before, map);
        let n = crate::math::sh::coefficients(self.params.bands);
        let points = map.coefficients.chunks_exact(n).zip(real.map.coefficients.chunks_exact(n));
        changed.clear();
        changed.extend(points.map(|(merged, real)| merged != real));
        let smooth = Smooth::new(&self.params);
        cells.prepare(&rows.surfaces, &rows.grid, smooth);
        let between = Between { rows: rows.every_pixel(), cells, smooth, coarse: map };
        refine_again(&between, &Before { trail, ..before }, changed, out);
    }
}
