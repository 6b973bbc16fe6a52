//! Edge-aware smoothing of the shading over 3 x 3 grid points.
//!
//! Visibility samples are jittered over tiles of 2 x 2 grid points. The weights 1 2 1 in x and y
//! average such a tile out exactly; neighbours on another surface lend nothing.

use super::CompositingParams;
use super::grid::{NOTHING, ShadingGrid};
use super::planes::{LANES, Planes, lanes};
use crate::geometry::GBuffer;
use crate::math::View;
use glam::Vec3;

/// Most planes that a grid has: three channels of R, R' and the bounce.
const MAX_PLANES: usize = 9;

/// How like a neighbour's surface must be to lend its shading.
#[derive(Clone, Copy, Debug)]
pub struct Likeness {
    /// Distance from the tangent plane, relative to depth, at which the weight reaches 0.
    pub plane_tolerance: f32,
    /// Exponent p on the cosine of the normals, as (1 - p/8 (1 - cos))^8: cos^8 for p = 8, and
    /// close to cos^p for others.
    pub normal_exponent: f32,
}

impl Likeness {
    pub fn new(params: &CompositingParams) -> Self {
        Self {
            plane_tolerance: params.depth_tolerance.max(1e-6),
            normal_exponent: params.normal_exponent,
        }
    }

    /// Weight from the squared relative plane distance and the cosine of the normals.
    #[inline(always)]
    pub fn weight(self, relative_distance: f32, cosine: f32) -> f32 {
        let off = relative_distance / self.plane_tolerance;
        let plane = (1.0 - off * off).max(0.0);
        let eighth = (1.0 - self.normal_exponent * 0.125 * (1.0 - cosine)).clamp(0.0, 1.0);
        let fourth = eighth * eighth;
        let half = fourth * fourth;
        plane * plane * half * half
    }
}

/// Distances from tangent planes in a camera's pixels.
///
/// The point at pixel (u, v) is o + d (z + u x + v y), with x and y the steps of one pixel at depth
/// 1, so a neighbour lies n.z' (d' - d) + d' (du n.x + dv n.y) off the plane, z' = z + u x + v y.
#[derive(Clone, Copy, Debug)]
pub struct PixelSteps {
    pub x: Vec3,
    pub y: Vec3,
    pub z: Vec3,
}

impl PixelSteps {
    /// Of a perspective view, in world axes.
    pub fn new(view: &View) -> Self {
        let (scale, centre) = view.scale_and_centre();
        let world_from_view = view.world_from_view_f32();
        let x = world_from_view.transform_vector3(Vec3::X / scale.x);
        let y = world_from_view.transform_vector3(Vec3::Y / scale.y);
        let z = world_from_view.transform_vector3(Vec3::Z) - x * centre.x - y * centre.y;
        Self { x, y, z }
    }
}

/// Depth and normals of one row of grid points.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceRow<'a> {
    pub depth: &'a [f32],
    pub normal: [&'a [f32]; 3],
}

impl<'a> SurfaceRow<'a> {
    pub fn new(grid: &'a ShadingGrid, merged: &'a GBuffer, j: usize) -> Self {
        if grid.step > 1 {
            let row = |plane| grid.surface.row(plane, j);
            Self { depth: row(0), normal: [row(1), row(2), row(3)] }
        } else {
            let n = &merged.normals;
            Self { depth: merged.depth_m.row(j), normal: [n.x.row(j), n.y.row(j), n.z.row(j)] }
        }
    }
}

/// Smooths the blocks of 16 points that hold a widened one; copies the others.
pub fn smooth(grid: &ShadingGrid, merged: &GBuffer, likeness: Likeness, out: &mut Planes) {
    use rayon::prelude::*;
    let size = grid.size();
    out.reshape(size, grid.planes.count());
    let steps = PixelSteps::new(&merged.view);
    out.par_rows_mut().for_each(|(j, row)| {
        let around = [j.saturating_sub(1), j, (j + 1).min(size.height - 1)];
        let surface = around.map(|j| SurfaceRow::new(grid, merged, j));
        for plane in 0..grid.planes.count() {
            row[plane * size.width..][..size.width].copy_from_slice(grid.planes.row(plane, j));
        }
        smooth_row(&Row { grid, around, surface, steps, likeness }, row);
    });
}

struct Row<'a> {
    grid: &'a ShadingGrid,
    /// Grid rows above, here and below.
    around: [usize; 3],
    surface: [SurfaceRow<'a>; 3],
    steps: PixelSteps,
    likeness: Likeness,
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn smooth_row(row: &Row, out: &mut [f32]) {
    let width = row.grid.size().width;
    let widened = row.grid.widened_row(row.around[1]);
    for (block, active) in widened.chunks(LANES).enumerate() {
        if active.iter().any(|&w| w != 0) {
            smooth_block(row, block * LANES, active.len(), out, width);
        }
    }
}

#[inline(always)]
fn smooth_block(row: &Row, x0: usize, count: usize, out: &mut [f32], width: usize) {
    let planes = &row.grid.planes;
    let centre = Centre::load(row, x0);
    let mut total = [0.0; LANES];
    let mut sums = [[0.0; LANES]; MAX_PLANES];
    for dy in 0..3 {
        for dx in 0..3isize {
            let at = x0 as isize + dx - 1;
            let spatial = [0.25, 0.5, 0.25][dy] * [0.25, 0.5, 0.25][dx as usize];
            let weight = if (dy, dx) == (1, 1) {
                // The point itself, even where its normal is missing.
                [spatial; LANES]
            } else {
                centre.weights(row, dy, at, spatial)
            };
            for k in 0..LANES {
                total[k] += weight[k];
            }
            for p in 0..planes.count() {
                let value = lanes(planes.row(p, row.around[dy]), at);
                for k in 0..LANES {
                    sums[p][k] += weight[k] * value[k];
                }
            }
        }
    }
    for p in 0..planes.count() {
        for k in 0..count {
            if centre.kind[k] != NOTHING {
                out[p * width + x0 + k] = sums[p][k] / total[k];
            }
        }
    }
}

/// 16 points whose neighbours are weighed.
struct Centre {
    kind: [f32; LANES],
    depth: [f32; LANES],
    inverse_depth: [f32; LANES],
    normal: [[f32; LANES]; 3],
    u: [f32; LANES],
    v: f32,
    /// The normal along one step in x and y, and along the ray.
    along_x: [f32; LANES],
    along_y: [f32; LANES],
    along_ray: [f32; LANES],
}

impl Centre {
    #[inline(always)]
    fn load(row: &Row, x0: usize) -> Self {
        let at = x0 as isize;
        let surface = row.surface[1];
        let kind = lanes(row.grid.kind.row(0, row.around[1]), at);
        let depth = lanes(surface.depth, at);
        let normal = surface.normal.map(|n| lanes(n, at));
        let u = lanes(&row.grid.u, at);
        let v = row.grid.v[row.around[1]];
        let dot = |d: Vec3| {
            let mut out = [0.0; LANES];
            for k in 0..LANES {
                out[k] = normal[0][k] * d.x + normal[1][k] * d.y + normal[2][k] * d.z;
            }
            out
        };
        let (along_x, along_y, mut along_ray) =
            (dot(row.steps.x), dot(row.steps.y), dot(row.steps.z));
        let mut inverse_depth = [0.0; LANES];
        for k in 0..LANES {
            along_ray[k] += u[k] * along_x[k] + v * along_y[k];
            // 0 where depth is missing: such points are not written
            inverse_depth[k] = if depth[k] > 0.0 { 1.0 / depth[k] } else { 0.0 };
        }
        Self { kind, depth, inverse_depth, normal, u, v, along_x, along_y, along_ray }
    }

    #[inline(always)]
    fn weights(&self, row: &Row, dy: usize, at: isize, spatial: f32) -> [f32; LANES] {
        let surface = row.surface[dy];
        let kind = lanes(row.grid.kind.row(0, row.around[dy]), at);
        let depth = lanes(surface.depth, at);
        let normal = surface.normal.map(|n| lanes(n, at));
        let u = lanes(&row.grid.u, at);
        let dv = row.grid.v[row.around[dy]] - self.v;
        let mut out = [0.0; LANES];
        for k in 0..LANES {
            let du = u[k] - self.u[k];
            let distance = self.along_ray[k] * (depth[k] - self.depth[k])
                + depth[k] * (du * self.along_x[k] + dv * self.along_y[k]);
            let cosine = self.normal[0][k] * normal[0][k]
                + self.normal[1][k] * normal[1][k]
                + self.normal[2][k] * normal[2][k];
            let like = row.likeness.weight(distance * self.inverse_depth[k], cosine);
            out[k] = if kind[k] == self.kind[k] { spatial * like } else { 0.0 };
        }
        out
    }
}
