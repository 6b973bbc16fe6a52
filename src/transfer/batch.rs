//! Sixteen surface points of the grid at a time, and the visibility of their samples.

use super::directions::{DirectionSet, LANES};
use super::occluder::{Found, Occluder};
use super::samples::NOT_HIDDEN;
use crate::geometry::GBuffer;
use crate::image::Size;
use crate::math::View;
use glam::{Mat3, Vec2};

/// Points of a batch side by side, and one below the other. They share one cell of the jitter tile, so that they
/// have the same samples, and lie close together: a `tile`-th of the points of a block.
const COLUMNS: usize = 4;
const ROWS: usize = LANES / COLUMNS;

/// The grid of points: every `step`-th pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    pub step: usize,
    pub width: usize,
    pub height: usize,
    /// Side of the jitter tile.
    pub tile: usize,
}

impl Grid {
    pub fn new(image: Size, step: usize, tile: usize) -> Self {
        Self { step, width: image.width.div_ceil(step), height: image.height.div_ceil(step), tile }
    }

    /// Rows of the grid that make up a row of blocks.
    pub fn block_rows(&self) -> usize {
        ROWS * self.tile
    }

    /// First column and cell of all batches in a row of blocks.
    pub fn batches(&self) -> impl Iterator<Item = (usize, (usize, usize))> + use<> {
        let tile = self.tile;
        (0..self.width).step_by(COLUMNS * tile).flat_map(move |left| {
            (0..tile * tile).map(move |cell| (left, (cell % tile, cell / tile)))
        })
    }

    pub fn size(&self) -> Size {
        Size::new(self.width, self.height)
    }

    /// The pixel that a grid index stands at, in an image of `length` pixels along this axis.
    pub fn pixel(&self, index: usize, length: usize) -> usize {
        grid_pixel(self.step, index, length)
    }
}

/// Grid points stand in the middle of their step, clamped to the image.
pub(crate) fn grid_pixel(step: usize, index: usize, length: usize) -> usize {
    (index * step + step / 2).min(length.saturating_sub(1))
}

/// How pixels of the main buffer become points.
#[derive(Clone, Copy, Debug)]
pub(super) struct Receivers {
    perspective: bool,
    inverse_scale: Vec2,
    centre: Vec2,
    main_from_world: Mat3,
    lift_m: f32,
}

impl Receivers {
    pub fn new(main: &View, lift_m: f32) -> Self {
        let (scale, centre) = main.scale_and_centre();
        Self {
            perspective: main.is_perspective(),
            inverse_scale: 1.0 / scale,
            centre,
            main_from_world: main.view_from_world_f32().matrix3.into(),
            lift_m,
        }
    }
}

/// 16 points of the grid. Those that lie outside it, or have no surface, are copies of another.
pub(super) struct Batch {
    /// Column and row in the jitter tile.
    pub cell: (usize, usize),
    /// Within the row of blocks; for points inside the grid.
    pub index: [usize; LANES],
    pub inside: [bool; LANES],
    pub valid: [bool; LANES],
    /// Pixel of the main buffer.
    pub pixel: [usize; LANES],
    /// In main-view axes, lifted off the surface along the normal.
    pub x: [[f32; LANES]; 3],
    /// Normals in main-view axes.
    pub n_in_main: [[f32; LANES]; 3],
    /// Normals in world axes.
    pub n: [[f32; LANES]; 3],
}

/// Surfaces beyond this depth are taken as missing, so that no coordinate of a sample overflows.
const FARTHEST_M: f32 = 1e9;

impl Batch {
    /// The points of one cell of the block whose upper left point is (left, top).
    #[inline(always)]
    pub fn gather(
        main: &GBuffer,
        receivers: &Receivers,
        grid: &Grid,
        (left, top): (usize, usize),
        cell: (usize, usize),
    ) -> Self {
        let size = main.size();
        let (mut inside, mut index, mut pixel) = ([false; LANES], [0; LANES], [0; LANES]);
        let mut at = [[0f32; LANES]; 2];
        for k in 0..LANES {
            let i = left + cell.0 + k % COLUMNS * grid.tile;
            let row = cell.1 + k / COLUMNS * grid.tile;
            inside[k] = i < grid.width && top + row < grid.height;
            let (u, v) = (grid.pixel(i, size.width), grid.pixel(top + row, size.height));
            (index[k], pixel[k]) = (row * grid.width + i, v * size.width + u);
            (at[0][k], at[1][k]) = (u as f32, v as f32);
        }
        let depth = main.depth_m.as_slice();
        let normals = [&main.normals.x, &main.normals.y, &main.normals.z].map(|n| n.as_slice());
        let mut z = [0f32; LANES];
        let mut n = [[0f32; LANES]; 3];
        for k in 0..LANES {
            z[k] = depth[pixel[k]];
            for axis in 0..3 {
                n[axis][k] = normals[axis][pixel[k]];
            }
        }
        let mut valid = [false; LANES];
        let mut x = [[0f32; LANES]; 3];
        let mut n_in_main = [[0f32; LANES]; 3];
        let m = receivers.main_from_world.to_cols_array_2d();
        for k in 0..LANES {
            let squared = n[0][k] * n[0][k] + n[1][k] * n[1][k] + n[2][k] * n[2][k];
            // Also false for NaN.
            let shown = (z[k] > 0.0) & (z[k] < FARTHEST_M) & (squared > 0.25) & (squared < 4.0);
            valid[k] = shown & inside[k];
            let depth = if valid[k] { z[k] } else { 0.0 };
            let [nx, ny, nz] = [0, 1, 2].map(|axis| if valid[k] { n[axis][k] } else { 0.0 });
            let w = if receivers.perspective { depth } else { 1.0 };
            let px = (at[0][k] - receivers.centre.x) * receivers.inverse_scale.x;
            let py = (at[1][k] - receivers.centre.y) * receivers.inverse_scale.y;
            let point = [px * w, py * w, depth];
            for axis in 0..3 {
                let normal = m[0][axis] * nx + m[1][axis] * ny + m[2][axis] * nz;
                n_in_main[axis][k] = normal;
                x[axis][k] = point[axis] + receivers.lift_m * normal;
            }
            (n[0][k], n[1][k], n[2][k]) = (nx, ny, nz);
        }
        if let Some(first) = valid.iter().position(|&v| v) {
            for axis in x.iter_mut().chain(&mut n_in_main).chain(&mut n) {
                let value = axis[first];
                for k in 0..LANES {
                    axis[k] = if valid[k] { axis[k] } else { value };
                }
            }
        }
        Self { cell, index, inside, valid, pixel, x, n_in_main, n }
    }

    pub fn any_valid(&self) -> bool {
        self.valid.contains(&true)
    }
}

/// Memory of one batch at work.
#[derive(Clone, Debug, Default)]
pub(super) struct Scratch {
    /// Directions that are looked along: above the surface of any lane.
    pub active: Vec<u32>,
    /// max(0, n.w) by direction.
    pub cosine: Vec<[f32; LANES]>,
    /// Largest t.w of a surface that hides a sample, by active direction.
    pub best: Vec<[f32; LANES]>,
    /// The same without virtual surfaces.
    pub before: Vec<[f32; LANES]>,
    /// Which surface `best` was.
    pub hit: Vec<[u32; LANES]>,
    /// What an active direction, by its place in `active`, takes from the transfer: (1 - K) c / sum c.
    pub share: Vec<[f32; LANES]>,
    /// Slots of the active directions.
    wanted: Vec<u16>,
    marks: Vec<bool>,
}

impl Scratch {
    pub fn reserve(&mut self, set: &DirectionSet) {
        let directions = set.len();
        self.cosine.resize(directions, [0.0; LANES]);
        self.best.resize(directions, [0.0; LANES]);
        self.share.resize(directions, [0.0; LANES]);
        self.before.resize(directions, [0.0; LANES]);
        self.hit.resize(directions, [0; LANES]);
        self.wanted.resize(set.chunks(), 0);
        self.marks.resize(directions, false);
        self.active.clear();
        self.active.reserve(directions);
    }

    /// Finds the directions above the surface, and returns the sum of the cosines of each lane.
    #[inline(always)]
    pub fn face(&mut self, batch: &Batch, set: &DirectionSet) -> [f32; LANES] {
        let mut sum = [0f32; LANES];
        self.active.clear();
        for (direction, (w, out)) in set.directions.iter().zip(&mut self.cosine).enumerate() {
            let mut any = 0;
            for i in 0..LANES {
                let dot = batch.n[0][i] * w.x + batch.n[1][i] * w.y + batch.n[2][i] * w.z;
                out[i] = if dot > 0.0 { dot } else { 0.0 };
                any |= u32::from(dot > 0.0);
                sum[i] += out[i];
            }
            if any != 0 {
                self.active.push(direction as u32);
            }
        }
        self.want_active(set);
        sum
    }

    fn want_active(&mut self, set: &DirectionSet) {
        self.wanted.fill(0);
        for &direction in &self.active {
            for slot in set.slots(direction as usize) {
                self.wanted[slot / LANES] |= 1 << (slot % LANES);
            }
        }
    }

    /// Keeps the active directions in which virtual surfaces may have changed anything.
    #[inline(always)]
    pub fn narrow(&mut self, batch: &Batch, set: &DirectionSet, occluders: &[Occluder]) {
        for &direction in &self.active {
            self.marks[direction as usize] = false;
        }
        for occluder in occluders.iter().filter(|occluder| occluder.shows_virtual()) {
            occluder.mark_changed(batch, set, &self.wanted, &mut self.marks);
            self.forget_marked(set);
        }
        self.active.retain(|&direction| self.marks[direction as usize]);
        self.want_active(set);
    }

    /// What is marked once need not be tried again.
    #[inline(always)]
    fn forget_marked(&mut self, set: &DirectionSet) {
        for &direction in self.active.iter().filter(|&&d| self.marks[d as usize]) {
            for slot in set.slots(direction as usize) {
                self.wanted[slot / LANES] &= !(1 << (slot % LANES));
            }
        }
    }

    /// Looks along the active directions for real surfaces.
    #[inline(always)]
    pub fn look_real(&mut self, batch: &Batch, set: &DirectionSet, occluders: &[Occluder]) {
        for &direction in &self.active {
            self.best[direction as usize] = [NOT_HIDDEN; LANES];
        }
        for occluder in occluders {
            let Self { cosine, best, before, hit, wanted, .. } = self;
            occluder.cast_real(batch, set, wanted, Found { cosine, best, before, hit });
        }
    }

    /// Looks along the active directions for real and virtual surfaces, and with `COMPARE` for real
    /// ones alone too.
    #[inline(always)]
    pub fn look_merged<const COMPARE: bool>(
        &mut self,
        batch: &Batch,
        set: &DirectionSet,
        occluders: &[Occluder],
    ) {
        for &direction in &self.active {
            self.best[direction as usize] = [NOT_HIDDEN; LANES];
            self.before[direction as usize] = [NOT_HIDDEN; LANES];
        }
        let mut first_code = 0;
        for occluder in occluders {
            let Self { cosine, best, before, hit, wanted, .. } = self;
            let found = Found { cosine, best, before, hit };
            occluder.cast_merged::<COMPARE>(batch, set, wanted, found, first_code);
            first_code += occluder.padded_len() as u32;
        }
    }

    /// What the k-th active direction takes from the transfer of each lane.
    #[inline(always)]
    pub fn hidden_share(&self, k: usize, chi: f32, inverse_sum: &[f32; LANES]) -> [f32; LANES] {
        let direction = self.active[k] as usize;
        share(&self.best[direction], &self.cosine[direction], chi, inverse_sum)
    }

    /// How much more it takes than without virtual surfaces.
    #[inline(always)]
    pub fn added_share(&self, k: usize, chi: f32, inverse_sum: &[f32; LANES]) -> [f32; LANES] {
        let direction = self.active[k] as usize;
        let before = share(&self.before[direction], &self.cosine[direction], chi, inverse_sum);
        let mut added = self.hidden_share(k, chi, inverse_sum);
        for i in 0..LANES {
            added[i] -= before[i];
        }
        added
    }
}

#[inline(always)]
fn share(
    best: &[f32; LANES],
    cosine: &[f32; LANES],
    chi: f32,
    inverse_sum: &[f32; LANES],
) -> [f32; LANES] {
    let mut share = [0f32; LANES];
    for i in 0..LANES {
        share[i] = hiddenness(best[i], chi) * cosine[i] * inverse_sum[i];
    }
    share
}

/// 1 / v, and 0 where v is not positive.
#[inline(always)]
pub(super) fn inverse_or_zero(v: &[f32; LANES]) -> [f32; LANES] {
    let mut inverse = [0f32; LANES];
    for i in 0..LANES {
        inverse[i] = if v[i] > 0.0 { 1.0 / v[i] } else { 0.0 };
    }
    inverse
}

/// 1 - K of Eq. 8 from the cosine between t and w.
#[inline(always)]
pub(super) fn hiddenness(cosine: f32, chi: f32) -> f32 {
    let rise = (cosine - (1.0 - chi)) / chi;
    let rise = if rise > 0.0 { rise } else { 0.0 };
    if rise < 1.0 { rise } else { 1.0 }
}
