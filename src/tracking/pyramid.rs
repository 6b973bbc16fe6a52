//! Depth and normals of the newest frame at several resolutions (Newcombe et al. 2011, Sec. 3.2).

use super::bilateral::Bilateral;
use super::padded::{PaddedDepth, lane_stride};
use super::{LANES, TrackingParams};
use crate::image::Image;
use crate::math::Pinhole;
use rayon::prelude::*;

/// Depth outside of this is missing: it would leave the range in which f32 squares are harmless.
pub(crate) const DEPTH_RANGE_M: std::ops::Range<f32> = 1e-3..1e3;

/// One resolution. Normals are unit vectors in camera axes that face the camera, zero where missing;
/// three planes with rows in whole lanes.
#[derive(Clone, Debug)]
pub(crate) struct Level {
    pub camera: Pinhole,
    pub depth_m: PaddedDepth,
    pub normals: [Vec<f32>; 3],
}

#[derive(Clone, Debug)]
pub(crate) struct Pyramid {
    /// 1/m, 0 where depth is missing.
    inverse_depth: PaddedDepth,
    filter: Bilateral,
    edge_m: f32,
    /// Finest first.
    pub levels: Vec<Level>,
}

impl Level {
    fn new(camera: Pinhole) -> Self {
        let plane = vec![0.0; lane_stride(camera.width) * camera.height];
        Self {
            camera,
            depth_m: PaddedDepth::new(camera.size(), 1),
            normals: [plane.clone(), plane.clone(), plane],
        }
    }

    /// Row `y` of the normals in whole lanes.
    pub fn normal_rows(&self, y: usize) -> [&[f32]; 3] {
        let stride = lane_stride(self.camera.width);
        [0, 1, 2].map(|axis| &self.normals[axis][y * stride..(y + 1) * stride])
    }

    fn update_normals(&mut self, edge_m: f32) {
        let Self { camera, depth_m, normals: [nx, ny, nz] } = self;
        let stride = lane_stride(camera.width).max(1);
        let rows = nx.par_chunks_mut(stride).zip(ny.par_chunks_mut(stride));
        rows.zip(nz.par_chunks_mut(stride)).enumerate().for_each(|(y, ((nx, ny), nz))| {
            normal_row([nx, ny, nz], y, depth_m, camera, edge_m);
        });
    }
}

/// Cameras of the levels, finest first: one for each entry of `params.iterations`, as far as an image is
/// left after halving.
pub(crate) fn level_cameras(
    params: &TrackingParams,
    camera: Pinhole,
) -> impl Iterator<Item = Pinhole> {
    (0..params.iterations.len().max(1) as u32)
        .map(move |level| camera.halved(level))
        .take_while(|camera| camera.width > 0 && camera.height > 0)
}

/// Depth steps beyond this are edges: no average and no normal reaches across.
pub(crate) fn edge_m(params: &TrackingParams) -> f32 {
    3.0 * params.filter_sigma_m
}

impl Pyramid {
    pub fn new(params: &TrackingParams, camera: Pinhole) -> Self {
        let filter = Bilateral::new(params);
        let levels = level_cameras(params, camera).map(Level::new).collect();
        Self {
            inverse_depth: PaddedDepth::new(camera.size(), filter.margin()),
            filter,
            edge_m: edge_m(params),
            levels,
        }
    }

    /// Fills all levels from a depth picture of the camera's size. Returns the share of pixels that
    /// have depth.
    pub fn update(&mut self, depth_m: &Image<f32>) -> f32 {
        let valid: usize = self
            .inverse_depth
            .par_rows_mut()
            .map(|(y, row)| {
                let mut valid = 0;
                for (out, &depth) in row.iter_mut().zip(depth_m.row(y)) {
                    let usable = DEPTH_RANGE_M.contains(&depth);
                    *out = if usable { 1.0 / depth } else { 0.0 };
                    valid += usize::from(usable);
                }
                valid
            })
            .sum();
        if let Some(finest) = self.levels.first_mut() {
            self.filter.apply(&self.inverse_depth, &mut finest.depth_m);
        }
        for level in 1..self.levels.len() {
            let (fine, coarse) = self.levels.split_at_mut(level);
            halve(&fine[level - 1].depth_m, &mut coarse[0].depth_m, self.edge_m);
        }
        for level in &mut self.levels {
            level.update_normals(self.edge_m);
        }
        valid as f32 / self.inverse_depth.size().pixels().max(1) as f32
    }
}

/// The mean inverse depth of those of each 2x2 pixels that are within `edge_m` of the nearest of them: exact on planes.
fn halve(fine: &PaddedDepth, coarse: &mut PaddedDepth, edge_m: f32) {
    let width = coarse.size().width;
    coarse.par_rows_mut().for_each(|(y, row)| {
        let (upper, lower) = (fine.row(2 * y), fine.row(2 * y + 1));
        for ((out, a), b) in
            row[..width].iter_mut().zip(upper.chunks_exact(2)).zip(lower.chunks_exact(2))
        {
            let block = [a[0], a[1], b[0], b[1]];
            let nearest =
                block.iter().fold(f32::MAX, |near, &d| if d > 0.0 { near.min(d) } else { near });
            let (mut sum, mut count) = (0.0, 0.0);
            for d in block {
                let same = d > 0.0 && d - nearest < edge_m;
                sum += if same { 1.0 / d } else { 0.0 };
                count += if same { 1.0f32 } else { 0.0 };
            }
            *out = if count > 0.0 { count / sum } else { 0.0 };
        }
    });
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn normal_row(
    out: [&mut [f32]; 3],
    y: usize,
    depth_m: &PaddedDepth,
    camera: &Pinhole,
    edge_m: f32,
) {
    normal_row_body(out, y, depth_m, camera, edge_m);
}

/// A plane `a.p = 1` has inverse depth `q = a.(x/z, y/z, 1)`, linear in the pixel. So the differences
/// of q give the plane exactly, `a = (fx q_u, fy q_v, q - (u - cx) q_u - (v - cy) q_v)`, and since
/// `a.p = 1` at the pixel itself, `-a` faces the camera at any angle.
/// Differences are central, one-sided beside holes and edges.
#[inline(always)]
fn normal_row_body(
    out: [&mut [f32]; 3],
    y: usize,
    depth_m: &PaddedDepth,
    camera: &Pinhole,
    edge_m: f32,
) {
    let [nx, ny, nz] = out;
    let above = &depth_m.row_with_margin(y, 0)[1..];
    let middle = depth_m.row_with_margin(y, 1);
    let below = &depth_m.row_with_margin(y, 2)[1..];
    let v = y as f32 - camera.cy;
    for x0 in (0..nx.len()).step_by(LANES) {
        let centre = &middle[x0 + 1..x0 + 1 + LANES];
        let neighbours = [
            &middle[x0..x0 + LANES],
            &middle[x0 + 2..x0 + 2 + LANES],
            &above[x0..x0 + LANES],
            &below[x0..x0 + LANES],
        ];
        let nx = &mut nx[x0..x0 + LANES];
        let ny = &mut ny[x0..x0 + LANES];
        let nz = &mut nz[x0..x0 + LANES];
        for i in 0..LANES {
            let z = centre[i];
            let q = 1.0 / z;
            // Inverse depth and distance in pixels; a neighbour across an edge is the pixel itself.
            let tap = |k: usize| {
                let d = neighbours[k][i];
                let same = (d > 0.0) & ((d - z).abs() < edge_m);
                if same { (1.0 / d, 1.0) } else { (q, 0.0f32) }
            };
            let ((left, l), (right, r), (up, a), (down, b)) = (tap(0), tap(1), tap(2), tap(3));
            let q_u = (right - left) / (l + r);
            let q_v = (down - up) / (a + b);
            let u = (x0 + i) as f32 - camera.cx;
            let plane = [camera.fx * q_u, camera.fy * q_v, q - u * q_u - v * q_v];
            let length_sq = plane[0] * plane[0] + plane[1] * plane[1] + plane[2] * plane[2];
            let valid = (z > 0.0) & (l + r > 0.0) & (a + b > 0.0) & (length_sq > 0.0);
            let scale = -1.0 / length_sq.sqrt();
            nx[i] = if valid { plane[0] * scale } else { 0.0 };
            ny[i] = if valid { plane[1] * scale } else { 0.0 };
            nz[i] = if valid { plane[2] * scale } else { 0.0 };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Size;
    use crate::math::{Pose, View};
    use crate::scene::analytic::{AnalyticScene, Shape};
    use glam::Vec3;

    fn camera() -> Pinhole {
        Pinhole { width: 67, height: 43, fx: 60.0, fy: 58.0, cx: 33.2, cy: 20.7 }
    }

    fn unfiltered(camera: Pinhole) -> Pyramid {
        let params =
            TrackingParams { filter_radius: 0, filter_sigma_m: 10.0, ..Default::default() };
        Pyramid::new(&params, camera)
    }

    fn normal(level: &Level, x: usize, y: usize) -> Vec3 {
        let rows = level.normal_rows(y);
        Vec3::new(rows[0][x], rows[1][x], rows[2][x])
    }

    #[test]
    fn planes_stay_planes_at_every_level() {
        let mut pyramid = unfiltered(camera());
        let inverse = |camera: &Pinhole, x: usize, y: usize| {
            let (u, v) = ((x as f32 - camera.cx) / camera.fx, (y as f32 - camera.cy) / camera.fy);
            0.5 + 0.3 * u - 0.4 * v
        };
        let mut depth = Image::new(camera().size(), 0.0);
        for y in 0..camera().height {
            for x in 0..camera().width {
                depth[(x, y)] = 1.0 / inverse(&camera(), x, y);
            }
        }
        pyramid.update(&depth);
        assert_eq!(pyramid.levels.len(), 3);
        for level in &pyramid.levels {
            for (x, y) in [(0, 0), (3, 5), (level.camera.width - 1, level.camera.height - 1)] {
                let (got, want) = (level.depth_m.row(y)[x], 1.0 / inverse(&level.camera, x, y));
                // a few roundings a level
                assert!((got / want - 1.0).abs() < 2e-6, "({x},{y}): {got} for {want}");
            }
        }
    }

    #[test]
    fn normals_of_planes_are_exact_up_to_grazing_angles() {
        let mut pyramid = unfiltered(camera());
        for degrees in [0f32, 30.0, 60.0, 80.0, 87.0] {
            let a = degrees.to_radians();
            // facing the camera, through a point below and in front of it
            let n = Vec3::new(0.0, -a.sin(), -a.cos());
            let plane = Shape::Plane { normal: n, offset: n.dot(Vec3::new(0.0, 0.2, 1.5)) };
            let view = View::perspective(camera(), Pose::identity());
            pyramid.update(&AnalyticScene::new([plane]).render(&view).depth_m);
            let level = &pyramid.levels[0];
            let mut seen = 0;
            for y in 0..43 {
                for x in 0..67 {
                    let got = normal(level, x, y);
                    if got != Vec3::ZERO {
                        // inverse depths of about 1 rounded at 2^-24, times f = 60 over 1 pixel
                        assert!(got.distance(n) < 1e-4, "{degrees} deg, ({x},{y}): {got}");
                        seen += 1;
                    }
                }
            }
            assert!(seen > 500, "{degrees} deg: {seen}");
        }
    }

    #[test]
    fn averages_and_normals_do_not_cross_edges() {
        let params = TrackingParams { filter_radius: 0, ..Default::default() };
        let mut pyramid = Pyramid::new(&params, camera());
        let size = Size::new(67, 43);
        let mut depth = Image::new(size, 1.0f32);
        for y in 0..43 {
            for x in 0..67 {
                // a step between columns 30 and 31, that is inside a 2x2 block of level 1
                depth[(x, y)] = if x > 30 { 3.0 } else { 1.0 };
            }
        }
        depth[(5, 5)] = f32::NAN;
        depth[(6, 5)] = f32::INFINITY;
        depth[(7, 5)] = -2.0;
        let valid = pyramid.update(&depth);
        assert_eq!(valid, (67 * 43 - 3) as f32 / (67 * 43) as f32);
        assert_eq!(pyramid.levels.len(), 3);
        for level in &pyramid.levels {
            let size = level.depth_m.size();
            for y in 0..size.height {
                for x in 0..size.width {
                    let d = level.depth_m.row(y)[x];
                    assert!(d == 1.0 || d == 3.0 || d == 0.0, "{size} ({x},{y}): {d}");
                    let n = normal(level, x, y);
                    assert!(n == Vec3::ZERO || n.distance(-Vec3::Z) < 1e-5, "{size} {n}");
                }
            }
        }
        assert_eq!(pyramid.levels[1].depth_m.row(0)[15], 1.0, "the nearer surface wins");
        assert_eq!(pyramid.levels[2].depth_m.size(), Size::new(16, 10));
    }

    #[test]
    fn tiny_images_have_fewer_levels() {
        let camera = Pinhole { width: 1, height: 1, fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0 };
        let mut pyramid = unfiltered(camera);
        assert_eq!(pyramid.levels.len(), 1);
        assert_eq!(pyramid.update(&Image::new(Size::new(1, 1), 1.0)), 1.0);
        assert_eq!(normal(&pyramid.levels[0], 0, 0), Vec3::ZERO);
    }
}
