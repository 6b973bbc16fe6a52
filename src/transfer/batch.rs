//! Sixteen surface points of the grid at a time, and the visibility of their samples.

use super::directions::{DirectionSet, LANES};
use super::occluder::{NOT_HIDDEN, Occluder, Samples};
use crate::geometry::GBuffer;
use crate::image::Size;
use crate::math::View;
use glam::{Mat3, Vec2};

/// The grid of points: every `step`-th pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    pub step: usize,
    pub width: usize,
    pub height: usize,
}

impl Grid {
    pub fn new(image: Size, step: usize) -> Self {
        Self { step, width: image.width.div_ceil(step), height: image.height.div_ceil(step) }
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
pub(super) fn grid_pixel(step: usize, index: usize, length: usize) -> usize {
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

/// Up to 16 points of one grid row. Lanes without a surface have a zero normal.
pub(super) struct Batch {
    pub i: usize,
    pub j: usize,
    pub count: usize,
    pub valid: [bool; LANES],
    /// In main-view axes, lifted off the surface along the normal.
    pub x: [[f32; LANES]; 3],
    /// Normals in main-view axes.
    pub n_in_main: [[f32; LANES]; 3],
    /// Normals in world axes.
    pub n: [[f32; LANES]; 3],
}

impl Batch {
    #[inline(always)]
    pub fn gather(main: &GBuffer, receivers: &Receivers, grid: &Grid, i: usize, j: usize) -> Self {
        let size = main.size();
        let count = (grid.width - i).min(LANES);
        let row = grid.pixel(j, size.height);
        let depth = main.depth_m.row(row);
        let normals = [&main.normals.x, &main.normals.y, &main.normals.z].map(|n| n.row(row));
        let mut column = [0f32; LANES];
        let mut z = [0f32; LANES];
        let mut n = [[0f32; LANES]; 3];
        for k in 0..count {
            let u = grid.pixel(i + k, size.width);
            (column[k], z[k]) = (u as f32, depth[u]);
            for axis in 0..3 {
                n[axis][k] = normals[axis][u];
            }
        }
        let mut valid = [false; LANES];
        let mut x = [[0f32; LANES]; 3];
        let mut n_in_main = [[0f32; LANES]; 3];
        let y = (row as f32 - receivers.centre.y) * receivers.inverse_scale.y;
        let m = receivers.main_from_world.to_cols_array_2d();
        for k in 0..LANES {
            let squared = n[0][k] * n[0][k] + n[1][k] * n[1][k] + n[2][k] * n[2][k];
            // Also false for NaN.
            valid[k] = (z[k] > 0.0) & (z[k] < f32::INFINITY) & (squared > 0.25) & (squared < 4.0);
            let depth = if valid[k] { z[k] } else { 0.0 };
            let [nx, ny, nz] = [0, 1, 2].map(|axis| if valid[k] { n[axis][k] } else { 0.0 });
            let w = if receivers.perspective { depth } else { 1.0 };
            let px = (column[k] - receivers.centre.x) * receivers.inverse_scale.x;
            let point = [px * w, y * w, depth];
            for axis in 0..3 {
                let normal = m[0][axis] * nx + m[1][axis] * ny + m[2][axis] * nz;
                n_in_main[axis][k] = normal;
                x[axis][k] = point[axis] + receivers.lift_m * normal;
            }
            (n[0][k], n[1][k], n[2][k]) = (nx, ny, nz);
        }
        Self { i, j, count, valid, x, n_in_main, n }
    }

    pub fn any_valid(&self) -> bool {
        self.valid.contains(&true)
    }
}

/// Memory of one batch at work.
#[derive(Clone, Debug, Default)]
pub(super) struct Scratch {
    /// Directions that lie above the surface of any lane.
    pub active: Vec<u32>,
    /// max(0, n.w) by active direction.
    pub cosine: Vec<[f32; LANES]>,
    /// Largest t.w of a surface that hides the sample, by active direction.
    pub best: Vec<[f32; LANES]>,
    /// Which surface that was; filled where asked for.
    pub hit: Vec<[u32; LANES]>,
}

impl Scratch {
    pub fn reserve(&mut self, directions: usize, track: bool) {
        self.cosine.resize(directions, [0.0; LANES]);
        self.best.resize(directions, [0.0; LANES]);
        self.hit.resize(if track { directions } else { 0 }, [0; LANES]);
        self.active.clear();
        self.active.reserve(directions);
    }

    /// Fills the tables for a batch, and returns the sum of the cosines of each lane.
    #[inline(always)]
    pub fn look<const TRACK: bool>(
        &mut self,
        batch: &Batch,
        set: &DirectionSet,
        occluders: &[Occluder],
    ) -> [f32; LANES] {
        let mut sum = [0f32; LANES];
        self.active.clear();
        for (direction, w) in set.directions.iter().enumerate() {
            let mut cosine = [0f32; LANES];
            let mut any = 0;
            for i in 0..LANES {
                let dot = batch.n[0][i] * w.x + batch.n[1][i] * w.y + batch.n[2][i] * w.z;
                cosine[i] = if dot > 0.0 { dot } else { 0.0 };
                any |= u32::from(dot > 0.0);
                sum[i] += cosine[i];
            }
            if any != 0 {
                let k = self.active.len();
                self.cosine[k] = cosine;
                self.best[k] = [NOT_HIDDEN; LANES];
                self.active.push(direction as u32);
            }
        }
        let samples = Samples {
            set,
            x: batch.x,
            n: batch.n_in_main,
            i: batch.i,
            j: batch.j,
            active: &self.active,
        };
        let mut first_code = 0;
        for occluder in occluders {
            occluder.cast::<TRACK>(&samples, &mut self.best, &mut self.hit, first_code);
            first_code += occluder.padded_len() as u32;
        }
        sum
    }
}

/// 1 - K of Eq. 8 from the cosine between t and w.
#[inline(always)]
pub(super) fn hiddenness(cosine: f32, chi: f32) -> f32 {
    let rise = (cosine - (1.0 - chi)) / chi;
    let rise = if rise > 0.0 { rise } else { 0.0 };
    if rise < 1.0 { rise } else { 1.0 }
}
