//! The RadTransfer stage on the CPU.

use super::batch::{Batch, Grid, Receivers, Scratch, hiddenness};
use super::bounce::{BounceInput, bounce_row};
use super::directions::{DirectionSet, LANES};
use super::influence::VirtualFootprint;
use super::occluder::Occluder;
use super::{BounceParams, IndirectMap, TransferError, TransferMap, TransferParams};
use crate::geometry::GBuffer;
use crate::image::Image;
use crate::math::sh;
use glam::Affine3A;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Rows of the grid are treated in at most this many pieces, each with memory of its own.
const PIECES: usize = 64;

/// A main buffer and its auxiliary buffers.
pub type Buffers<'a> = (&'a GBuffer, &'a [GBuffer]);

/// Computes radiance transfer and the indirect bounce from geometry buffers.
#[derive(Debug)]
pub struct RadianceTransfer {
    params: TransferParams,
    bounce: BounceParams,
    set: DirectionSet,
    occluders: Vec<Occluder>,
    footprints: Vec<VirtualFootprint>,
    scratch: Vec<Scratch>,
}

/// What all batches of one pass share.
pub(super) struct Pass<'a> {
    pub main: &'a GBuffer,
    pub grid: Grid,
    pub receivers: Receivers,
    pub world_from_main: Affine3A,
    pub set: &'a DirectionSet,
    pub occluders: &'a [Occluder],
}

impl RadianceTransfer {
    pub fn new(params: &TransferParams, bounce: &BounceParams) -> Result<Self, TransferError> {
        bounce.check()?;
        Ok(Self {
            set: DirectionSet::new(params)?,
            params: params.clone(),
            bounce: bounce.clone(),
            occluders: Vec::new(),
            footprints: Vec::new(),
            scratch: vec![Scratch::default(); PIECES],
        })
    }

    pub fn params(&self) -> &TransferParams {
        &self.params
    }

    pub fn direction_set(&self) -> &DirectionSet {
        &self.set
    }

    /// Transfer of every grid point of `main`.
    pub fn transfer(&mut self, main: &GBuffer, auxiliary: &[GBuffer], out: &mut TransferMap) {
        let grid = Grid::new(main.size(), self.params.subsampling);
        out.reshape(self.params.bands, &grid);
        self.prepare((main, auxiliary), false);
        let (pass, scratch) = self.pass(main, grid);
        let row_length = grid.width * sh::coefficients(out.bands);
        for_rows(&mut out.coefficients, row_length, &grid, scratch, |j, row, scratch| {
            transfer_row(&pass, j, row, scratch);
        });
    }

    /// Transfer of real and virtual geometry together, with the samples of the real pass.
    ///
    /// `real_transfer` is what [`Self::transfer`] made of `real`, and `merged` must differ from
    /// `real` in pixels of [`Origin::Virtual`](crate::geometry::Origin::Virtual) alone. Points that no virtual pixel can influence
    /// are copied; the result equals that of [`Self::transfer`] on `merged` bit for bit.
    pub fn transfer_with_virtual(
        &mut self,
        real: Buffers,
        merged: Buffers,
        real_transfer: &TransferMap,
        out: &mut TransferMap,
    ) {
        let (main, auxiliary) = merged;
        let grid = Grid::new(main.size(), self.params.subsampling);
        if !real_transfer.fits(self.params.bands, &grid) || real.0.size() != main.size() {
            return self.transfer(main, auxiliary, out);
        }
        out.reshape(self.params.bands, &grid);
        out.coefficients.copy_from_slice(&real_transfer.coefficients);
        if !self.find_virtual(merged) {
            return;
        }
        self.prepare(merged, false);
        let (radius_m, footprints) = (self.params.radius_m, std::mem::take(&mut self.footprints));
        let (pass, scratch) = self.pass(main, grid);
        let row_length = grid.width * sh::coefficients(out.bands);
        let row_kernel = |j: usize, row: &mut [f32], scratch: &mut Scratch| {
            transfer_row_near_virtual(&pass, real.0, &footprints, radius_m, j, row, scratch);
        };
        for_rows(&mut out.coefficients, row_length, &grid, scratch, row_kernel);
        self.footprints = footprints;
    }

    /// One bounce of light, with `radiance` leaving the pixels of each buffer.
    ///
    /// Light on real surfaces comes from virtual ones alone (Eq. 14), light on virtual surfaces
    /// from all; without virtual pixels it is zero everywhere. Panics where a picture has not the
    /// size of its buffer.
    pub fn bounce(
        &mut self,
        merged: Buffers,
        radiance: (&Image<[f32; 3]>, &[Image<[f32; 3]>]),
        out: &mut IndirectMap,
    ) {
        let (main, auxiliary) = merged;
        let grid = Grid::new(main.size(), self.params.subsampling);
        assert_eq!(radiance.0.size(), main.size(), "radiance of the main buffer");
        assert!(
            radiance.1.iter().map(Image::size).eq(auxiliary.iter().map(GBuffer::size)),
            "radiance of the auxiliary buffers"
        );
        out.reshape(&grid);
        if !self.bounce.enabled || !self.find_virtual(merged) {
            out.rgb.fill([0.0; 3]);
            return;
        }
        self.prepare(merged, true);
        let footprints = std::mem::take(&mut self.footprints);
        let input = BounceInput {
            buffers: merged,
            radiance,
            footprints: &footprints,
            radius_m: self.params.radius_m,
            strength: self.bounce.strength,
        };
        let (pass, scratch) = self.pass(main, grid);
        for_rows(&mut out.rgb, grid.width, &grid, scratch, |j, row, scratch| {
            bounce_row(&pass, &input, j, row, scratch);
        });
        self.footprints = footprints;
    }

    fn prepare(&mut self, (main, auxiliary): Buffers, track: bool) {
        self.occluders.resize_with(1 + auxiliary.len(), Occluder::default);
        let buffers = std::iter::once(main).chain(auxiliary);
        for (occluder, buffer) in self.occluders.iter_mut().zip(buffers) {
            occluder.prepare(buffer, &main.view, &self.set, self.params.bias_m);
        }
        for scratch in &mut self.scratch {
            scratch.reserve(self.set.len(), track);
        }
    }

    /// Whether any buffer shows a virtual object.
    fn find_virtual(&mut self, (main, auxiliary): Buffers) -> bool {
        self.footprints.resize_with(1 + auxiliary.len(), VirtualFootprint::default);
        let buffers = std::iter::once(main).chain(auxiliary);
        for (footprint, buffer) in self.footprints.iter_mut().zip(buffers) {
            footprint.prepare(buffer, &main.view);
        }
        self.footprints.iter().any(VirtualFootprint::any)
    }

    fn pass<'a>(&'a mut self, main: &'a GBuffer, grid: Grid) -> (Pass<'a>, &'a mut [Scratch]) {
        let pass = Pass {
            main,
            grid,
            receivers: Receivers::new(&main.view, self.params.bias_m),
            world_from_main: main.view.world_from_view_f32(),
            set: &self.set,
            occluders: &self.occluders,
        };
        (pass, &mut self.scratch)
    }
}

/// Runs `kernel(row index, row, scratch)` over all rows in parallel, with the same pieces for any
/// number of threads.
fn for_rows<T: Send>(
    data: &mut [T],
    row_length: usize,
    grid: &Grid,
    scratch: &mut [Scratch],
    kernel: impl Fn(usize, &mut [T], &mut Scratch) + Sync,
) {
    if row_length == 0 {
        return;
    }
    let rows = grid.height.div_ceil(scratch.len()).max(1);
    data.par_chunks_mut(rows * row_length).zip(scratch).enumerate().for_each(
        |(piece, (chunk, scratch))| {
            for (k, row) in chunk.chunks_mut(row_length).enumerate() {
                kernel(piece * rows + k, row, scratch);
            }
        },
    );
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn transfer_row(pass: &Pass, j: usize, row: &mut [f32], scratch: &mut Scratch) {
    let n = row.len() / pass.grid.width;
    for (b, out) in row.chunks_mut(n * LANES).enumerate() {
        let batch = Batch::gather(pass.main, &pass.receivers, &pass.grid, b * LANES, j);
        transfer_batch(pass, &batch, out, scratch);
    }
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn transfer_row_near_virtual(
    pass: &Pass,
    real: &GBuffer,
    footprints: &[VirtualFootprint],
    radius_m: f32,
    j: usize,
    row: &mut [f32],
    scratch: &mut Scratch,
) {
    let n = row.len() / pass.grid.width;
    for (b, out) in row.chunks_mut(n * LANES).enumerate() {
        let batch = Batch::gather(pass.main, &pass.receivers, &pass.grid, b * LANES, j);
        let before = Batch::gather(real, &pass.receivers, &pass.grid, b * LANES, j);
        let moved = batch.x != before.x || batch.n != before.n || batch.valid != before.valid;
        if moved || footprints.iter().any(|f| f.may_meet(&batch, radius_m)) {
            transfer_batch(pass, &batch, out, scratch);
        }
    }
}

/// T = T_unoccluded - sum_j (1 - K_j) c_j Y_j / sum_j c_j with c_j = max(0, n.w_j).
#[inline(always)]
fn transfer_batch(pass: &Pass, batch: &Batch, out: &mut [f32], scratch: &mut Scratch) {
    if !batch.any_valid() {
        out.fill(0.0);
        return;
    }
    let sum = scratch.look::<false>(batch, pass.set, pass.occluders);
    let mut inverse = [0f32; LANES];
    for i in 0..LANES {
        inverse[i] = if sum[i] > 0.0 { 1.0 / sum[i] } else { 0.0 };
    }
    // Keep the directions that hide anything, with their shares in `cosine`.
    let mut kept = 0;
    for k in 0..scratch.active.len() {
        let mut any = 0;
        let mut share = [0f32; LANES];
        for i in 0..LANES {
            share[i] =
                hiddenness(scratch.best[k][i], pass.set.chi) * scratch.cosine[k][i] * inverse[i];
            any |= u32::from(share[i] > 0.0);
        }
        if any != 0 {
            scratch.cosine[kept] = share;
            scratch.active[kept] = scratch.active[k];
            kept += 1;
        }
    }
    let n = out.len() / batch.count;
    let bands = n.isqrt();
    let mut unoccluded = [[0f32; LANES]; sh::MAX_COEFFICIENTS];
    sh::basis_lanes(&batch.n, bands, &mut unoccluded);
    for l in 0..bands {
        let factor = (sh::CLAMPED_COSINE[l] / PI) as f32;
        for row in &mut unoccluded[l * l..(l + 1) * (l + 1)] {
            row.iter_mut().for_each(|v| *v *= factor);
        }
    }
    let hidden = scratch.active[..kept].iter().zip(&scratch.cosine[..kept]);
    for (i, out) in out.chunks_exact_mut(n).enumerate() {
        if !batch.valid[i] {
            out.fill(0.0);
            continue;
        }
        for (c, out) in out.chunks_mut(LANES).enumerate() {
            let mut sum = [0f32; LANES];
            for (&direction, share) in hidden.clone() {
                let row = &pass.set.row(direction as usize)[c * LANES..(c + 1) * LANES];
                for k in 0..LANES {
                    sum[k] += share[i] * row[k];
                }
            }
            for (k, out) in out.iter_mut().enumerate() {
                *out = unoccluded[c * LANES + k][i] - sum[k];
            }
        }
    }
}
