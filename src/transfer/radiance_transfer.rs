//! The RadTransfer stage on the CPU.

use super::batch::{Batch, Grid, Receivers, Scratch, inverse_or_zero};
use super::bounce::{BounceInput, bounce_blocks};
use super::directions::{DirectionSet, LANES};
use super::occluder::Occluder;
use super::{BounceParams, IndirectMap, TransferError, TransferMap, TransferParams};
use crate::geometry::{GBuffer, Origin};
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
    /// Without virtual objects.
    real_occluders: Vec<Occluder>,
    /// Where visibility may differ between the two; one for each view that shows virtual objects.
    changed: Vec<Occluder>,
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
    pub real_occluders: &'a [Occluder],
    pub changed: &'a [Occluder],
}

impl RadianceTransfer {
    pub fn new(params: &TransferParams, bounce: &BounceParams) -> Result<Self, TransferError> {
        bounce.check()?;
        Ok(Self {
            set: DirectionSet::new(params)?,
            params: params.clone(),
            bounce: bounce.clone(),
            occluders: Vec::new(),
            real_occluders: Vec::new(),
            changed: Vec::new(),
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
        let grid = self.grid(main);
        out.reshape(self.params.bands, &grid);
        self.prepare((main, auxiliary), false);
        let (pass, scratch) = self.pass(main, grid);
        let n = sh::coefficients(pass.set.bands());
        for_blocks(&mut out.coefficients, grid.width * n, &grid, scratch, |top, rows, scratch| {
            transfer_blocks(&pass, top, rows, scratch);
        });
    }

    /// Transfer of real and virtual geometry together, with the samples of the real pass.
    ///
    /// `real_transfer` is what [`Self::transfer`] made of `real`, and `merged` must differ from
    /// `real` in pixels of [`Origin::Virtual`](crate::geometry::Origin::Virtual) alone. Only directions in which a sample is behind
    /// a virtual pixel of some buffer are looked along again, with and without the virtual pixels, and
    /// the difference is added; all points without such directions are copied. The result
    /// equals that of [`Self::transfer`] on `merged` but for the rounding of that addition.
    pub fn transfer_with_virtual(
        &mut self,
        real: Buffers,
        merged: Buffers,
        real_transfer: &TransferMap,
        out: &mut TransferMap,
    ) {
        let (main, auxiliary) = merged;
        let grid = self.grid(main);
        let same_views = real.0.size() == main.size() && real.1.len() == auxiliary.len();
        if !real_transfer.fits(self.params.bands, &grid) || !same_views {
            return self.transfer(main, auxiliary, out);
        }
        out.reshape(self.params.bands, &grid);
        out.coefficients.copy_from_slice(&real_transfer.coefficients);
        if !shows_virtual(merged) {
            return;
        }
        std::mem::swap(&mut self.occluders, &mut self.real_occluders);
        self.prepare(real, false);
        std::mem::swap(&mut self.occluders, &mut self.real_occluders);
        self.prepare(merged, false);
        self.find_changed(merged, true);
        let (pass, scratch) = self.pass(main, grid);
        let row_length = grid.width * sh::coefficients(pass.set.bands());
        for_blocks(&mut out.coefficients, row_length, &grid, scratch, |top, rows, scratch| {
            update_blocks(&pass, real.0, top, rows, scratch);
        });
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
        let grid = self.grid(main);
        assert_eq!(radiance.0.size(), main.size(), "radiance of the main buffer");
        assert!(
            radiance.1.iter().map(Image::size).eq(auxiliary.iter().map(GBuffer::size)),
            "radiance of the auxiliary buffers"
        );
        out.reshape(&grid);
        if !self.bounce.enabled || !shows_virtual(merged) {
            out.rgb.fill([0.0; 3]);
            return;
        }
        self.prepare(merged, true);
        self.find_changed(merged, false);
        let input = BounceInput { buffers: merged, radiance, strength: self.bounce.strength };
        let (pass, scratch) = self.pass(main, grid);
        for_blocks(&mut out.rgb, grid.width, &grid, scratch, |top, rows, scratch| {
            bounce_blocks(&pass, &input, top, rows, scratch);
        });
    }

    fn grid(&self, main: &GBuffer) -> Grid {
        Grid::new(main.size(), self.params.subsampling, self.set.tile())
    }

    fn prepare(&mut self, (main, auxiliary): Buffers, track: bool) {
        self.occluders.resize_with(1 + auxiliary.len(), Occluder::default);
        let buffers = std::iter::once(main).chain(auxiliary);
        for (occluder, buffer) in self.occluders.iter_mut().zip(buffers) {
            occluder.prepare(buffer, &main.view, &self.set, self.params.bias_m);
        }
        for scratch in &mut self.scratch {
            scratch.reserve(&self.set, track);
        }
    }

    /// Where the occluders show virtual objects, and with `against_real` what was there before.
    fn find_changed(&mut self, (main, auxiliary): Buffers, against_real: bool) {
        let mut count = 0;
        for (k, buffer) in std::iter::once(main).chain(auxiliary).enumerate() {
            if self.changed.len() <= count {
                self.changed.push(Occluder::default());
            }
            let real = against_real.then(|| &self.real_occluders[k]);
            let changed = &mut self.changed[count];
            count += usize::from(changed.prepare_changed(&self.occluders[k], real, &buffer.origin));
        }
        self.changed.truncate(count);
    }

    fn pass<'a>(&'a mut self, main: &'a GBuffer, grid: Grid) -> (Pass<'a>, &'a mut [Scratch]) {
        let pass = Pass {
            main,
            grid,
            receivers: Receivers::new(&main.view, self.params.bias_m),
            world_from_main: main.view.world_from_view_f32(),
            set: &self.set,
            occluders: &self.occluders,
            real_occluders: &self.real_occluders,
            changed: &self.changed,
        };
        (pass, &mut self.scratch)
    }
}

/// Whether any buffer shows a virtual object.
fn shows_virtual((main, auxiliary): Buffers) -> bool {
    std::iter::once(main).chain(auxiliary).any(|b| b.origin.as_slice().contains(&Origin::Virtual))
}

/// Runs `kernel(first row, rows, scratch)` over all rows of blocks in parallel, with the same pieces for
/// any number of threads.
fn for_blocks<T: Send>(
    data: &mut [T],
    row_length: usize,
    grid: &Grid,
    scratch: &mut [Scratch],
    kernel: impl Fn(usize, &mut [T], &mut Scratch) + Sync,
) {
    if row_length == 0 {
        return;
    }
    let block = grid.block_rows();
    let blocks = grid.height.div_ceil(block).div_ceil(scratch.len()).max(1);
    data.par_chunks_mut(blocks * block * row_length).zip(scratch).enumerate().for_each(
        |(piece, (chunk, scratch))| {
            for (k, rows) in chunk.chunks_mut(block * row_length).enumerate() {
                kernel((piece * blocks + k) * block, rows, scratch);
            }
        },
    );
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn transfer_blocks(pass: &Pass, top: usize, rows: &mut [f32], scratch: &mut Scratch) {
    for (left, cell) in pass.grid.batches() {
        let batch = Batch::gather(pass.main, &pass.receivers, &pass.grid, (left, top), cell);
        transfer_batch(pass, &batch, rows, scratch);
    }
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn update_blocks(pass: &Pass, real: &GBuffer, top: usize, rows: &mut [f32], scratch: &mut Scratch) {
    for (left, cell) in pass.grid.batches() {
        let batch = Batch::gather(pass.main, &pass.receivers, &pass.grid, (left, top), cell);
        let before = Batch::gather(real, &pass.receivers, &pass.grid, (left, top), cell);
        let moved = batch.x != before.x || batch.n != before.n || batch.valid != before.valid;
        if moved {
            transfer_batch(pass, &batch, rows, scratch);
        } else if batch.any_valid() {
            update_batch(pass, &batch, rows, scratch);
        }
    }
}

/// T = T_unoccluded - sum_j (1 - K_j) c_j Y_j / sum_j c_j with c_j = max(0, n.w_j).
#[inline(always)]
fn transfer_batch(pass: &Pass, batch: &Batch, out: &mut [f32], scratch: &mut Scratch) {
    let bands = pass.set.bands();
    let n = sh::coefficients(bands);
    if !batch.any_valid() {
        for i in (0..LANES).filter(|&i| batch.inside[i]) {
            out[batch.index[i] * n..][..n].fill(0.0);
        }
        return;
    }
    let inverse_sum = inverse_or_zero(&scratch.face(batch, pass.set));
    scratch.look::<false>(batch, pass.set, pass.occluders);
    // Keep the directions that hide anything.
    let mut kept = 0;
    for k in 0..scratch.active.len() {
        let share = scratch.hidden_share(k, pass.set.chi, &inverse_sum);
        if any_nonzero(&share) {
            scratch.share[kept] = share;
            scratch.active[kept] = scratch.active[k];
            kept += 1;
        }
    }
    let mut unoccluded = [[0f32; LANES]; sh::MAX_COEFFICIENTS];
    sh::basis_lanes(&batch.n, bands, &mut unoccluded);
    for l in 0..bands {
        let factor = (sh::CLAMPED_COSINE[l] / PI) as f32;
        for row in &mut unoccluded[l * l..(l + 1) * (l + 1)] {
            row.iter_mut().for_each(|v| *v *= factor);
        }
    }
    for i in (0..LANES).filter(|&i| batch.inside[i]) {
        let out = &mut out[batch.index[i] * n..][..n];
        if !batch.valid[i] {
            out.fill(0.0);
            continue;
        }
        for (c, out) in out.chunks_mut(LANES).enumerate() {
            let hidden = hidden_light(pass.set, &scratch.active[..kept], &scratch.share, i, c);
            for (k, out) in out.iter_mut().enumerate() {
                *out = unoccluded[c * LANES + k][i] - hidden[k];
            }
        }
    }
}

/// Adds to the transfer of real geometry what virtual geometry changes in it.
#[inline(always)]
fn update_batch(pass: &Pass, batch: &Batch, out: &mut [f32], scratch: &mut Scratch) {
    let inverse_sum = inverse_or_zero(&scratch.face(batch, pass.set));
    scratch.narrow(batch, pass.set, pass.changed);
    if scratch.active.is_empty() {
        return;
    }
    let chi = pass.set.chi;
    scratch.look::<false>(batch, pass.set, pass.real_occluders);
    for k in 0..scratch.active.len() {
        scratch.share[k] = scratch.hidden_share(k, chi, &inverse_sum);
    }
    scratch.look::<false>(batch, pass.set, pass.occluders);
    let mut kept = 0;
    for k in 0..scratch.active.len() {
        let mut share = scratch.hidden_share(k, chi, &inverse_sum);
        for i in 0..LANES {
            share[i] -= scratch.share[k][i];
        }
        if any_nonzero(&share) {
            scratch.share[kept] = share;
            scratch.active[kept] = scratch.active[k];
            kept += 1;
        }
    }
    if kept == 0 {
        return;
    }
    let n = sh::coefficients(pass.set.bands());
    for i in (0..LANES).filter(|&i| batch.valid[i]) {
        let out = &mut out[batch.index[i] * n..][..n];
        for (c, out) in out.chunks_mut(LANES).enumerate() {
            let hidden = hidden_light(pass.set, &scratch.active[..kept], &scratch.share, i, c);
            for (out, hidden) in out.iter_mut().zip(hidden) {
                *out -= hidden;
            }
        }
    }
}

#[inline(always)]
fn any_nonzero(share: &[f32; LANES]) -> bool {
    share.iter().fold(false, |any, &s| any | (s != 0.0))
}

/// Sum of share times Y of one lane, the c-th 16 coefficients.
#[inline(always)]
fn hidden_light(
    set: &DirectionSet,
    directions: &[u32],
    share: &[[f32; LANES]],
    lane: usize,
    c: usize,
) -> [f32; LANES] {
    let mut sum = [0f32; LANES];
    for (&direction, share) in directions.iter().zip(share) {
        let row = &set.row(direction as usize)[c * LANES..(c + 1) * LANES];
        for k in 0..LANES {
            sum[k] += share[lane] * row[k];
        }
    }
    sum
}
