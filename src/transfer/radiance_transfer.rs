//! The RadTransfer stage on the CPU.

use super::batch::{Batch, Grid, Receivers, Scratch, inverse_or_zero};
use super::bounce::BounceInput;
use super::directions::{DirectionSet, LANES};
use super::occluder::Occluder;
use super::{BounceParams, IndirectMap, TransferError, TransferMap, TransferParams};
use crate::geometry::{GBuffer, Origin};
use crate::image::{Image, Size};
use crate::math::sh;
use glam::Affine3A;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Rows of the grid are treated in at most this many pieces, each with memory of its own.
const PIECES: usize = 64;

/// A main buffer and its auxiliary buffers.
pub type Buffers<'a> = (&'a GBuffer, &'a [GBuffer]);

/// Radiance that leaves the pixels of a main buffer and of its auxiliary buffers.
pub type Radiance<'a> = (&'a Image<[f32; 3]>, &'a [Image<[f32; 3]>]);

/// Computes radiance transfer and the indirect bounce from geometry buffers.
#[derive(Debug)]
pub struct RadianceTransfer {
    params: TransferParams,
    bounce: BounceParams,
    set: DirectionSet,
    occluders: Vec<Occluder>,
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
        self.prepare((main, auxiliary));
        let (pass, scratch) = self.pass(main, grid);
        let n = sh::coefficients(pass.set.bands());
        for_blocks(&mut out.coefficients, grid.width * n, &grid, scratch, |top, rows, scratch| {
            transfer_blocks(&pass, top, rows, scratch);
        });
    }

    /// Transfer of real and virtual geometry together, with the samples of the real pass; and one bounce
    /// of light, with `radiance` leaving the pixels of each merged buffer.
    ///
    /// The last call of [`Self::transfer`] must have made `real_transfer` of `real`, and `merged` must
    /// differ from `real` in pixels of [`Origin::Virtual`] alone. Points on virtual surfaces are computed
    /// as by `transfer`. Elsewhere only directions in which a sample is behind a
    /// virtual pixel of some buffer are looked along again, with and without the virtual pixels, and
    /// the difference is added; all points without such directions are copied. The result
    /// equals that of `transfer` on `merged` but for the rounding of that addition.
    ///
    /// Light on real surfaces comes from virtual ones alone (Eq. 14), light on virtual surfaces
    /// from all; without virtual pixels or radiance it is zero everywhere. Panics where a picture has not the
    /// size of its buffer, or merged buffers not those of the real ones.
    pub fn transfer_and_bounce(
        &mut self,
        real: Buffers,
        merged: Buffers,
        radiance: Option<Radiance>,
        real_transfer: &TransferMap,
        out: &mut TransferMap,
        indirect: &mut IndirectMap,
    ) {
        assert!(sizes(real).eq(sizes(merged)), "merged buffers");
        let grid = self.grid(merged.0);
        if real_transfer.fits(self.params.bands, &grid) {
            out.reshape(self.params.bands, &grid);
            out.coefficients.copy_from_slice(&real_transfer.coefficients);
            if !self.is_prepared(real) {
                self.prepare(real);
            }
        } else {
            self.transfer(real.0, real.1, out);
        }
        indirect.reshape(&grid);
        indirect.rgb.fill([0.0; 3]);
        self.insert(merged);
        if !self.occluders.iter().any(Occluder::shows_virtual) {
            return;
        }
        let strength = self.bounce.strength;
        let bounce = radiance
            .filter(|_| self.bounce.enabled)
            .map(|radiance| BounceInput::new(merged, radiance, strength));
        let (pass, scratch) = self.pass(merged.0, grid);
        let row_length = grid.width * sh::coefficients(pass.set.bands());
        let (block, piece) = (grid.block_rows(), piece_rows(&grid, scratch.len()));
        (out.coefficients.par_chunks_mut(piece * row_length))
            .zip(indirect.rgb.par_chunks_mut(piece * grid.width))
            .zip(scratch)
            .enumerate()
            .for_each(|(at, ((transfer, indirect), scratch))| {
                let blocks = (transfer.chunks_mut(block * row_length))
                    .zip(indirect.chunks_mut(block * grid.width));
                for (k, rows) in blocks.enumerate() {
                    let top = at * piece + k * block;
                    update_blocks(&pass, bounce.as_ref(), top, rows, scratch);
                }
            });
    }

    fn grid(&self, main: &GBuffer) -> Grid {
        Grid::new(main.size(), self.params.subsampling, self.set.tile())
    }

    fn prepare(&mut self, (main, auxiliary): Buffers) {
        self.occluders.resize_with(1 + auxiliary.len(), Occluder::default);
        let buffers = std::iter::once(main).chain(auxiliary);
        for (occluder, buffer) in self.occluders.iter_mut().zip(buffers) {
            occluder.prepare(buffer, &main.view, &self.set, self.params.bias_m);
        }
        for scratch in &mut self.scratch {
            scratch.reserve(&self.set);
        }
    }

    fn is_prepared(&self, (main, auxiliary): Buffers) -> bool {
        let views = std::iter::once(main).chain(auxiliary).map(|buffer| &buffer.view);
        self.occluders.len() == 1 + auxiliary.len()
            && self.occluders.iter().zip(views).all(|(o, view)| o.view.shows(view, &main.view))
    }

    fn insert(&mut self, (main, auxiliary): Buffers) {
        let bias_m = self.params.bias_m;
        let (first, others) = self.occluders.split_first_mut().expect("prepared");
        rayon::join(
            || first.insert(main, bias_m),
            || {
                let pairs = others.iter_mut().zip(auxiliary);
                pairs.for_each(|(occluder, buffer)| occluder.insert(buffer, bias_m));
            },
        );
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

fn sizes<'a>((main, auxiliary): Buffers<'a>) -> impl Iterator<Item = Size> + use<'a> {
    std::iter::once(main).chain(auxiliary).map(GBuffer::size)
}

/// Rows of the grid in a piece: whole rows of blocks.
fn piece_rows(grid: &Grid, pieces: usize) -> usize {
    let block = grid.block_rows();
    grid.height.div_ceil(block).div_ceil(pieces).max(1) * block
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
    let (block, piece) = (grid.block_rows(), piece_rows(grid, scratch.len()));
    data.par_chunks_mut(piece * row_length).zip(scratch).enumerate().for_each(
        |(k, (chunk, scratch))| {
            for (block_row, rows) in chunk.chunks_mut(block * row_length).enumerate() {
                kernel(k * piece + block_row * block, rows, scratch);
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
        if !batch.any_valid() {
            write_nothing(pass, &batch, rows);
            continue;
        }
        let sum = scratch.face(&batch, pass.set);
        scratch.look_real(&batch, pass.set, pass.occluders);
        write_transfer(pass, &batch, &sum, rows, scratch);
    }
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn update_blocks(
    pass: &Pass,
    bounce: Option<&BounceInput>,
    top: usize,
    (transfer, indirect): (&mut [f32], &mut [[f32; 3]]),
    scratch: &mut Scratch,
) {
    let origin = pass.main.origin.as_slice();
    for (left, cell) in pass.grid.batches() {
        let batch = Batch::gather(pass.main, &pass.receivers, &pass.grid, (left, top), cell);
        let on_virtual: [bool; LANES] =
            std::array::from_fn(|i| batch.inside[i] & (origin[batch.pixel[i]] == Origin::Virtual));
        let whole = on_virtual.contains(&true);
        if !batch.any_valid() {
            if whole {
                write_nothing(pass, &batch, transfer);
            }
            continue;
        }
        let sum = scratch.face(&batch, pass.set);
        if whole {
            scratch.look_merged::<false>(&batch, pass.set, pass.occluders);
        } else {
            scratch.narrow(&batch, pass.set, pass.occluders);
            if scratch.active.is_empty() {
                continue;
            }
            scratch.look_merged::<true>(&batch, pass.set, pass.occluders);
        }
        if let Some(bounce) = bounce {
            bounce.write(pass, &batch, &on_virtual, &sum, scratch, indirect);
        }
        if whole {
            write_transfer(pass, &batch, &sum, transfer, scratch);
        } else {
            add_difference(pass, &batch, &sum, transfer, scratch);
        }
    }
}

#[inline(always)]
fn write_nothing(pass: &Pass, batch: &Batch, out: &mut [f32]) {
    let n = sh::coefficients(pass.set.bands());
    for i in (0..LANES).filter(|&i| batch.inside[i]) {
        out[batch.index[i] * n..][..n].fill(0.0);
    }
}

/// T = T_unoccluded - sum_j (1 - K_j) c_j Y_j / sum_j c_j with c_j = max(0, n.w_j).
#[inline(always)]
fn write_transfer(
    pass: &Pass,
    batch: &Batch,
    sum: &[f32; LANES],
    out: &mut [f32],
    scratch: &mut Scratch,
) {
    let bands = pass.set.bands();
    let n = sh::coefficients(bands);
    let inverse_sum = inverse_or_zero(sum);
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
fn add_difference(
    pass: &Pass,
    batch: &Batch,
    sum: &[f32; LANES],
    out: &mut [f32],
    scratch: &mut Scratch,
) {
    let inverse_sum = inverse_or_zero(sum);
    let mut kept = 0;
    for k in 0..scratch.active.len() {
        let share = scratch.added_share(k, pass.set.chi, &inverse_sum);
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
