//! Projective data association and the sums of point-to-plane ICP (Newcombe et al. 2011, Eq. 14-20).
//!
//! All geometry is in the axes of the model's view, so positions stay small and f32 is enough however
//! far from the world's origin the camera is.

#![allow(unsafe_code, reason = "look-ups of inner loops, whose bounds are said beside each")]

use super::pyramid::Level;
use super::{LANES, TrackingParams};
use crate::geometry::GBuffer;
use crate::math::{Pinhole, Pose, affine_from_pose};
use nalgebra::{Matrix6, Vector6};
use rayon::prelude::*;

/// Rows that one task sums in f32 before the f64 total: fixed, so that results do not depend on threads.
const ROWS_PER_TASK: usize = 8;

/// Upper triangle of A, then b, then the scalars below.
pub(crate) const TERMS: usize = 21 + 6 + 5;
const RESIDUAL_SQ: usize = 27;
const DEPTH: usize = 28;
const PARTNERS: usize = 29;
const SEEN: usize = 30;
const VALID: usize = 31;

/// Totals over a frame. Rotation comes first, then translation.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sums([f64; TERMS]);

impl Sums {
    const ZERO: Self = Self([0.0; TERMS]);

    /// From totals in the order of the terms.
    #[cfg(feature = "gpu")]
    pub fn from_terms(terms: [f32; TERMS]) -> Self {
        Self(terms.map(f64::from))
    }

    pub fn a(&self) -> Matrix6<f64> {
        let mut a = Matrix6::zeros();
        let mut next = self.0.iter();
        for row in 0..6 {
            for (column, &value) in (row..6).zip(&mut next) {
                a[(row, column)] = value;
                a[(column, row)] = value;
            }
        }
        a
    }

    pub fn b(&self) -> Vector6<f64> {
        Vector6::from_column_slice(&self.0[21..27])
    }

    /// Pixels with a partner that passed both gates.
    pub fn partners(&self) -> f64 {
        self.0[PARTNERS]
    }

    /// Pixels that project onto a surface of the model.
    pub fn seen(&self) -> f64 {
        self.0[SEEN]
    }

    /// Pixels with depth and normal.
    pub fn valid(&self) -> f64 {
        self.0[VALID]
    }

    pub fn mean_depth_m(&self) -> f64 {
        self.0[DEPTH] / self.partners()
    }

    /// Unweighted point-to-plane RMS over the partners.
    pub fn rms_m(&self) -> f64 {
        (self.0[RESIDUAL_SQ] / self.partners().max(1.0)).sqrt()
    }
}

/// Which pairs are partners, and what they weigh.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gates {
    pub max_distance_m: f32,
    pub min_cosine: f32,
    /// Residuals beyond this many standard deviations of the depth noise weigh less (Huber).
    pub huber_sigmas: f32,
}

impl Gates {
    /// `reach` multiplies the distance gate.
    pub fn new(params: &TrackingParams, reach: f32) -> Self {
        Self {
            max_distance_m: params.max_distance_m * reach,
            min_cosine: params.max_angle_rad.cos(),
            huber_sigmas: HUBER_SIGMAS,
        }
    }
}

/// The usual constant: 95 % efficiency on Gaussian residuals.
const HUBER_SIGMAS: f32 = 1.345;

/// The model's picture as the kernel reads it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ModelView<'a> {
    camera: Pinhole,
    depth_m: &'a [f32],
    normals_in_world: [&'a [f32]; 3],
    view_from_world: [[f32; 3]; 3],
}

impl<'a> ModelView<'a> {
    /// `camera` is the perspective projection of `model`, which has pixels.
    pub fn new(model: &'a GBuffer, camera: Pinhole) -> Self {
        let normals = &model.normals;
        assert!(camera.size().pixels() > 0, "model picture without pixels");
        assert_eq!(camera.size(), model.size(), "model picture");
        assert_eq!(camera.size(), normals.size(), "model normals");
        Self {
            camera,
            depth_m: model.depth_m.as_slice(),
            normals_in_world: [&normals.x, &normals.y, &normals.z].map(|plane| plane.as_slice()),
            view_from_world: rows_of_inverse(&model.view.world_from_view),
        }
    }
}

/// Rows of the rotation that the inverse of a pose has.
pub(crate) fn rows_of_inverse(pose: &Pose) -> [[f32; 3]; 3] {
    let rotation = pose.rotation.inverse().to_rotation_matrix();
    [0, 1, 2].map(|r| [0, 1, 2].map(|c| rotation.matrix()[(r, c)] as f32))
}

/// Scratch of the reduction.
#[derive(Clone, Debug, Default)]
pub(crate) struct Reduction {
    tasks: Vec<Sums>,
}

impl Reduction {
    /// Sums over all pixels of `level`, moved by `model_from_camera`.
    pub fn accumulate(
        &mut self,
        level: &Level,
        model: &ModelView,
        model_from_camera: &Pose,
        gates: &Gates,
    ) -> Sums {
        let motion = affine_from_pose(model_from_camera);
        let motion = [0, 1, 2].map(|row| {
            let linear = motion.matrix3.row(row);
            [linear.x, linear.y, linear.z, motion.translation[row]]
        });
        let height = level.camera.height;
        self.tasks.resize(height.div_ceil(ROWS_PER_TASK), Sums::ZERO);
        self.tasks.par_iter_mut().enumerate().for_each(|(task, sums)| {
            let first = task * ROWS_PER_TASK;
            let rows = first..(first + ROWS_PER_TASK).min(height);
            *sums = accumulate_rows(rows, level, model, &motion, gates);
        });
        let mut total = Sums::ZERO;
        for task in &self.tasks {
            for (total, value) in total.0.iter_mut().zip(&task.0) {
                *total += value;
            }
        }
        total
    }
}

/// Axial noise of a Kinect (Nguyen, Izadi, Lovell, 2012): `floor_m` at `nearest_m`, and a parabola beyond.
pub(crate) struct DepthNoise {
    pub floor_m: f32,
    pub growth: f32,
    pub nearest_m: f32,
}

pub(crate) const DEPTH_NOISE: DepthNoise =
    DepthNoise { floor_m: 0.0012, growth: 0.0019, nearest_m: 0.4 };

#[inline(always)]
fn depth_sigma_m(depth_m: f32) -> f32 {
    let beyond = depth_m - DEPTH_NOISE.nearest_m;
    DEPTH_NOISE.floor_m + DEPTH_NOISE.growth * beyond * beyond
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn accumulate_rows(
    rows: std::ops::Range<usize>,
    level: &Level,
    model: &ModelView,
    motion: &[[f32; 4]; 3],
    gates: &Gates,
) -> Sums {
    accumulate_rows_body(rows, level, model, motion, gates)
}

#[inline(always)]
fn accumulate_rows_body(
    rows: std::ops::Range<usize>,
    level: &Level,
    model: &ModelView,
    motion: &[[f32; 4]; 3],
    gates: &Gates,
) -> Sums {
    let mut lanes = [[0f32; LANES]; TERMS];
    for y in rows {
        let depth = level.depth_m.row(y);
        let normals = level.normal_rows(y);
        for x0 in (0..depth.len()).step_by(LANES) {
            let depth = &depth[x0..x0 + LANES];
            if depth.iter().all(|&d| d == 0.0) {
                continue;
            }
            let normals = normals.map(|row| &row[x0..x0 + LANES]);
            let pairs = associate(x0, y, depth, normals, &level.camera, model, motion, gates);
            pairs.add_to(&mut lanes, gates);
        }
    }
    // Lanes are added in f64, in order.
    Sums(lanes.map(|term| term.iter().map(|&v| f64::from(v)).sum()))
}

/// Points of the frame with their partners, in the axes of the model's view. Where there is no partner
/// normal and residual are zero, so such a pair adds nothing.
struct Pairs {
    point: [[f32; LANES]; 3],
    normal: [[f32; LANES]; 3],
    residual: [f32; LANES],
    depth: [f32; LANES],
    partner: [f32; LANES],
    seen: [f32; LANES],
    valid: [f32; LANES],
}

#[inline(always)]
fn associate(
    x0: usize,
    y: usize,
    depth: &[f32],
    normals: [&[f32]; 3],
    camera: &Pinhole,
    model: &ModelView,
    motion: &[[f32; 4]; 3],
    gates: &Gates,
) -> Pairs {
    let mut pairs = Pairs {
        point: [[0.0; LANES]; 3],
        normal: [[0.0; LANES]; 3],
        residual: [0.0; LANES],
        depth: [0.0; LANES],
        partner: [0.0; LANES],
        seen: [0.0; LANES],
        valid: [0.0; LANES],
    };
    let lens = &model.camera;
    let (last_x, last_y) = (lens.width as f32 - 1.0, lens.height as f32 - 1.0);
    let mut index = [0i32; LANES];
    let mut ray = [[0f32; LANES]; 2];
    let mut inside = [false; LANES];
    let row_slope = (y as f32 - camera.cy) / camera.fy;
    let (inv_fx, inv_lens) = (1.0 / camera.fx, [1.0 / lens.fx, 1.0 / lens.fy]);

    // Project each point into the model's picture.
    for i in 0..LANES {
        let z = depth[i];
        let p = [((x0 + i) as f32 - camera.cx) * inv_fx * z, row_slope * z, z];
        for axis in 0..3 {
            let m = &motion[axis];
            pairs.point[axis][i] = m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3];
        }
        let inv_z = 1.0 / pairs.point[2][i];
        let u = pairs.point[0][i] * inv_z * lens.fx + lens.cx + 0.5;
        let v = pairs.point[1][i] * inv_z * lens.fy + lens.cy + 0.5;
        let in_front = (z > 0.0) & (pairs.point[2][i] > 0.0);
        inside[i] = in_front & (u >= 0.0) & (v >= 0.0) & (u < last_x + 1.0) & (v < last_y + 1.0);
        let (u, v) = (u.max(0.0).min(last_x), v.max(0.0).min(last_y));
        // SAFETY: `max` with 0 drops NaN, so both lie between 0 and the last column or row.
        let (column, row) = unsafe { (u.to_int_unchecked::<i32>(), v.to_int_unchecked::<i32>()) };
        index[i] = row * lens.width as i32 + column;
        ray[0][i] = (column as f32 - lens.cx) * inv_lens[0];
        ray[1][i] = (row as f32 - lens.cy) * inv_lens[1];
    }

    // Gather.
    let mut model_depth = [0f32; LANES];
    let mut world_normal = [[0f32; LANES]; 3];
    for i in 0..LANES {
        // SAFETY: column and row are inside the model's picture, which has pixels and whose planes
        // all have its size (asserted in `ModelView::new`).
        unsafe {
            model_depth[i] = *model.depth_m.get_unchecked(index[i] as usize);
            for axis in 0..3 {
                world_normal[axis][i] =
                    *model.normals_in_world[axis].get_unchecked(index[i] as usize);
            }
        }
    }

    // Gate.
    let max_distance_sq = gates.max_distance_m * gates.max_distance_m;
    let r = &model.view_from_world;
    for i in 0..LANES {
        let d = model_depth[i];
        let w = [world_normal[0][i], world_normal[1][i], world_normal[2][i]];
        let n = [0, 1, 2].map(|axis| r[axis][0] * w[0] + r[axis][1] * w[1] + r[axis][2] * w[2]);
        let f = [normals[0][i], normals[1][i], normals[2][i]];
        let mut cosine = 0.0;
        for axis in 0..3 {
            let m = &motion[axis];
            cosine += n[axis] * (m[0] * f[0] + m[1] * f[1] + m[2] * f[2]);
        }
        let to_model = [
            ray[0][i] * d - pairs.point[0][i],
            ray[1][i] * d - pairs.point[1][i],
            d - pairs.point[2][i],
        ];
        let distance_sq = to_model.iter().map(|v| v * v).sum::<f32>();
        let has_normal = f[0] * f[0] + f[1] * f[1] + f[2] * f[2] > 0.0;
        // Comparisons with NaN are false, so a broken model pixel is an empty one.
        let surface = (d > 0.0) & (d < f32::MAX) & (n[0] * n[0] + n[1] * n[1] + n[2] * n[2] > 0.5);
        let seen = has_normal & inside[i] & surface;
        let partner = seen & (distance_sq <= max_distance_sq) & (cosine >= gates.min_cosine);
        for axis in 0..3 {
            pairs.normal[axis][i] = if partner { n[axis] } else { 0.0 };
        }
        let residual = n[0] * to_model[0] + n[1] * to_model[1] + n[2] * to_model[2];
        pairs.residual[i] = if partner { residual } else { 0.0 };
        pairs.depth[i] = if partner { depth[i] } else { 0.0 };
        pairs.partner[i] = if partner { 1.0 } else { 0.0 };
        pairs.seen[i] = if seen { 1.0 } else { 0.0 };
        pairs.valid[i] = if has_normal { 1.0 } else { 0.0 };
    }
    pairs
}

impl Pairs {
    /// Adds `w J^T J`, `w J^T r` and the scalars. A small motion (w, t) moves the point by `w x p + t`,
    /// so the row of the Jacobian is `J = (p x n, n)`.
    #[inline(always)]
    fn add_to(&self, lanes: &mut [[f32; LANES]; TERMS], gates: &Gates) {
        let (p, n) = (&self.point, &self.normal);
        let mut weight = [0f32; LANES];
        let mut jacobian = [[0f32; LANES]; 6];
        for i in 0..LANES {
            let sigma = depth_sigma_m(self.depth[i]);
            let huber = (gates.huber_sigmas * sigma / self.residual[i].abs()).min(1.0);
            let relative = depth_sigma_m(DEPTH_NOISE.nearest_m) / sigma;
            weight[i] = huber * relative * relative;
            jacobian[0][i] = p[1][i] * n[2][i] - p[2][i] * n[1][i];
            jacobian[1][i] = p[2][i] * n[0][i] - p[0][i] * n[2][i];
            jacobian[2][i] = p[0][i] * n[1][i] - p[1][i] * n[0][i];
            for axis in 0..3 {
                jacobian[3 + axis][i] = n[axis][i];
            }
        }
        let mut term = 0;
        for row in 0..6 {
            let mut weighted = [0f32; LANES];
            for i in 0..LANES {
                weighted[i] = weight[i] * jacobian[row][i];
            }
            for column in row..6 {
                for i in 0..LANES {
                    lanes[term][i] += weighted[i] * jacobian[column][i];
                }
                term += 1;
            }
            for i in 0..LANES {
                lanes[21 + row][i] += weighted[i] * self.residual[i];
            }
        }
        for i in 0..LANES {
            lanes[RESIDUAL_SQ][i] += self.residual[i] * self.residual[i];
            lanes[DEPTH][i] += self.depth[i];
            lanes[PARTNERS][i] += self.partner[i];
            lanes[SEEN][i] += self.seen[i];
            lanes[VALID][i] += self.valid[i];
        }
    }
}
