//! One pass over the rows of a grid: over real geometry, keeping what the rays met; or over real and
//! virtual geometry, using that again.

use super::super::batch::Grid;
use super::super::directions::{DirectionSet, LANES};
use super::super::{TransferMap, TransferParams};
use super::cells::{Cells, Smooth};
use super::points::{Mask, Picked, Points, Surface, Surfaces};
use super::tracer::{Hidden, Tracer, write_transfer};
use crate::geometry::GBuffer;
use crate::math::sh;
use rayon::prelude::*;

/// How a point got its transfer.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) enum How {
    #[default]
    NoSurface,
    Interpolated,
    Traced,
}

/// What the real pass found at each point of a grid.
#[derive(Debug, Default)]
pub(super) struct Trail {
    pub how: Vec<How>,
    /// A bit for each direction that the volume hides from a traced point, in words of 32.
    hits: Vec<u32>,
    words: usize,
}

impl Trail {
    fn reshape(&mut self, points: usize, directions: usize) {
        self.words = directions.div_ceil(32);
        self.how.resize(points, How::NoSurface);
        self.hits.resize(points * self.words, 0);
    }

    #[cfg(all(test, feature = "gpu"))]
    pub fn hits(&self) -> &[u32] {
        &self.hits
    }

    pub fn fits(&self, points: usize) -> bool {
        self.how.len() == points
    }

    fn row(&self, j: usize, width: usize) -> TrailRow<'_> {
        let range = j * width..(j + 1) * width;
        let hits = &self.hits[range.start * self.words..range.end * self.words];
        TrailRow { how: &self.how[range], hits, words: self.words }
    }
}

/// A row of the real pass, read by the pass with virtual objects.
#[derive(Clone, Copy)]
struct TrailRow<'a> {
    how: &'a [How],
    hits: &'a [u32],
    words: usize,
}

/// A row of results, written by the real pass.
struct Written<'a> {
    how: &'a mut [How],
    hits: &'a mut [u32],
    words: usize,
    out: &'a mut [f32],
}

/// The points of a pass, and what their rays can meet.
#[derive(Clone, Copy)]
pub(super) struct Rows<'a> {
    pub surfaces: Surfaces<'a>,
    pub grid: Grid,
    pub set: &'a DirectionSet,
    pub tracer: &'a Tracer<'a>,
}

/// The real pass.
#[derive(Clone, Copy)]
pub(super) struct Before<'a> {
    pub surfaces: Surfaces<'a>,
    pub trail: &'a Trail,
}

impl<'a> Rows<'a> {
    pub fn new(
        params: &TransferParams,
        set: &'a DirectionSet,
        tracer: &'a Tracer<'a>,
        main: &'a GBuffer,
    ) -> Self {
        let grid = Grid::new(main.size(), params.subsampling, 1);
        Self { surfaces: Surfaces::new(main), grid, set, tracer }
    }

    pub fn every_pixel(&self) -> Self {
        Self { grid: Grid::new(self.surfaces.buffer.size(), 1, 1), ..*self }
    }

    /// Row of the image that a grid row stands at.
    fn y(&self, j: usize) -> usize {
        self.grid.pixel(j, self.surfaces.buffer.size().height)
    }

    /// The whole grid row in pieces.
    fn pieces(&self) -> impl Iterator<Item = Picked> + '_ {
        let length = self.surfaces.buffer.size().width;
        (0..self.grid.width).step_by(LANES).map(move |first| {
            let mut picked = Picked::default();
            for slot in first..(first + LANES).min(self.grid.width) {
                picked.push(self.grid.pixel(slot, length), slot);
            }
            picked
        })
    }

    fn trace(&self, y: usize, picked: &Picked, row: &mut Written) {
        let points = Points::gather(&self.surfaces, y, picked);
        let mut hidden = Hidden::none();
        if points.any() {
            self.tracer.add_volume(&points, &points.valid, &mut hidden);
        }
        for (lane, _, slot) in picked.lanes() {
            let surface = points.valid[lane] == 1;
            row.how[slot] = if surface { How::Traced } else { How::NoSurface };
            hidden.store(lane, &mut row.hits[slot * row.words..][..row.words]);
        }
        self.write(&points, &hidden, picked, row.out);
    }

    /// `out` holds the transfer of the real pass, which stays where nothing can have changed.
    fn trace_again(
        &self,
        before: &Surfaces,
        trail: &TrailRow,
        y: usize,
        picked: &Picked,
        out: &mut [f32],
    ) {
        let points = Points::gather(&self.surfaces, y, picked);
        let mut hidden = Hidden::none();
        let mut fresh: Mask = points.valid;
        let mut all_known = true;
        for (lane, x, slot) in picked.lanes() {
            let known =
                trail.how[slot] != How::Interpolated && before.at(x, y) == self.surfaces.at(x, y);
            all_known &= known;
            if known {
                fresh[lane] = 0;
                hidden.load(lane, &trail.hits[slot * trail.words..][..trail.words]);
            }
        }
        let reached = points.any() && self.tracer.objects_in_reach(&points);
        if all_known && !reached {
            return;
        }
        if !all_known {
            self.tracer.add_volume(&points, &fresh, &mut hidden);
        }
        if reached {
            self.tracer.add_objects(&points, &mut hidden);
        }
        self.write(&points, &hidden, picked, out);
    }

    fn write(&self, points: &Points, hidden: &Hidden, picked: &Picked, out: &mut [f32]) {
        let n = out.len() / self.grid.width;
        write_transfer(self.set, points, hidden, n, &picked.slots[..picked.count], out);
    }
}

/// Transfer of every grid point.
pub(super) fn trace_grid(rows: &Rows, trail: &mut Trail, out: &mut TransferMap) {
    for_rows(rows, trail, out, |j, mut row| {
        rows.pieces().for_each(|picked| rows.trace(rows.y(j), &picked, &mut row));
    });
}

/// The same with virtual objects; `out` holds the transfer of the real pass.
pub(super) fn trace_grid_again(rows: &Rows, before: &Before, out: &mut TransferMap) {
    for_rows_again(rows, before, out, |j, trail, out| {
        for picked in rows.pieces() {
            rows.trace_again(&before.surfaces, &trail, rows.y(j), &picked, out);
        }
    });
}

/// The pixels between coarse points.
pub(super) struct Between<'a> {
    /// Of every pixel.
    pub rows: Rows<'a>,
    pub cells: &'a Cells,
    pub smooth: Smooth,
    pub coarse: &'a TransferMap,
}

impl Between<'_> {
    /// Calls `visit` on each pixel of a row with what it shows and whether that is to be interpolated.
    fn each(&self, y: usize, mut visit: impl FnMut(usize, Option<Surface>, bool)) {
        for x in 0..self.rows.grid.width {
            let surface = self.rows.surfaces.at(x, y);
            let between = surface.is_some_and(|s| self.cells.interpolates(x, y, &s, self.smooth));
            visit(x, surface, between);
        }
    }
}

/// Transfer of every pixel: interpolated, or traced where that would cross an edge.
pub(super) fn refine(between: &Between, trail: &mut Trail, out: &mut TransferMap) {
    let rows = &between.rows;
    for_rows(rows, trail, out, |y, mut row| {
        let n = row.out.len() / rows.grid.width;
        let mut picked = Picked::default();
        between.each(y, |x, surface, interpolated| {
            if interpolated {
                row.how[x] = How::Interpolated;
                between.cells.interpolate(between.coarse, x, y, &mut row.out[x * n..][..n]);
            } else if surface.is_some() {
                picked.push(x, x);
            } else {
                row.how[x] = How::NoSurface;
                row.hits[x * row.words..][..row.words].fill(0);
                row.out[x * n..][..n].fill(0.0);
            }
            if picked.is_full() {
                rows.trace(y, &std::mem::take(&mut picked), &mut row);
            }
        });
        if picked.count > 0 {
            rows.trace(y, &picked, &mut row);
        }
    });
}

/// The same with virtual objects. `out` holds the transfer of the real pass, and `changed` says for
/// each coarse point whether its transfer differs from the real one.
pub(super) fn refine_again(
    between: &Between,
    before: &Before,
    changed: &[bool],
    out: &mut TransferMap,
) {
    let rows = &between.rows;
    for_rows_again(rows, before, out, |y, trail, out| {
        let n = out.len() / rows.grid.width;
        let mut picked = Picked::default();
        between.each(y, |x, _, interpolated| {
            if !interpolated {
                picked.push(x, x);
            } else if trail.how[x] != How::Interpolated
                || between.cells.corners(x, y).iter().any(|&k| changed[k])
            {
                between.cells.interpolate(between.coarse, x, y, &mut out[x * n..][..n]);
            }
            if picked.is_full() {
                let picked = std::mem::take(&mut picked);
                rows.trace_again(&before.surfaces, &trail, y, &picked, out);
            }
        });
        if picked.count > 0 {
            rows.trace_again(&before.surfaces, &trail, y, &picked, out);
        }
    });
}

/// Runs `kernel` on every row of a real pass in parallel.
fn for_rows(
    rows: &Rows,
    trail: &mut Trail,
    out: &mut TransferMap,
    kernel: impl Fn(usize, Written) + Sync,
) {
    trail.reshape(rows.grid.size().pixels(), rows.set.len());
    let (width, words, n) = (rows.grid.width, trail.words, sh::coefficients(out.bands));
    if width == 0 {
        return;
    }
    let hits = trail.hits.par_chunks_mut(width * words);
    let rows = trail.how.par_chunks_mut(width).zip(hits);
    rows.zip(out.coefficients.par_chunks_mut(width * n))
        .enumerate()
        .for_each(|(j, ((how, hits), out))| kernel(j, Written { how, hits, words, out }));
}

fn for_rows_again(
    rows: &Rows,
    before: &Before,
    out: &mut TransferMap,
    kernel: impl Fn(usize, TrailRow, &mut [f32]) + Sync,
) {
    let (width, n) = (rows.grid.width, sh::coefficients(out.bands));
    if width > 0 {
        let out = out.coefficients.par_chunks_mut(width * n).enumerate();
        out.for_each(|(j, out)| kernel(j, before.trail.row(j, width), out));
    }
}
