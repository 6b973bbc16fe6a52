//! Normals of a depth map, and which of them the model knows better.

use super::median::{LANES, Lanes, is_depth, load, row_at};
use super::{GBuffer, Origin};
use crate::image::Image;
use crate::math::View;
use glam::{Mat3A, Vec2};
use rayon::prelude::*;

/// Neighbours this many pixels away span a normal, where surface continues that far. On depth with
/// the noise and steps of a Kinect, after all filters, the median error of normals is 13 degrees with
/// direct neighbours, 5 with these, and no less further away.
pub(crate) const REACH: isize = 3;

/// A neighbour is on the same surface where depth changes by no more than this many times the
/// sideways step between the two pixels: surfaces tilted by up to atan(10) = 84 degrees.
pub(crate) const MAX_SLOPE: f32 = 10.0;

/// Sets normals and origin of `out` from its depth: the model's normal where its depth is within
/// `same_surface_m`, else that of the depth map itself.
pub(super) fn assign(out: &mut GBuffer, model: &GBuffer, same_surface_m: f32) {
    let GBuffer { view, depth_m, normals, origin } = out;
    let camera = Camera::new(view);
    let depth_m = &*depth_m;
    let xy = normals.x.par_rows_mut().zip(normals.y.par_rows_mut());
    xy.zip(normals.z.par_rows_mut()).zip(origin.par_rows_mut()).for_each(
        |((((y, nx), (_, ny)), (_, nz)), (_, origin))| {
            assign_row(depth_m, model, &camera, same_surface_m, y, [nx, ny, nz], origin);
        },
    );
}

/// `u = x * scale / w + centre`, where w is depth or, in an orthographic view, 1.
struct Camera {
    scale: Vec2,
    centre: Vec2,
    perspective: bool,
    world_from_view: Mat3A,
}

impl Camera {
    fn new(view: &View) -> Self {
        let (scale, centre) = view.scale_and_centre();
        let world_from_view = view.world_from_view_f32().matrix3;
        Self { scale, centre, perspective: view.is_perspective(), world_from_view }
    }

    #[inline(always)]
    fn w(&self, depth_m: f32) -> f32 {
        if self.perspective { depth_m } else { 1.0 }
    }
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn assign_row(
    depth: &Image<f32>,
    model: &GBuffer,
    camera: &Camera,
    same_surface_m: f32,
    y: usize,
    out: [&mut [f32]; 3],
    origin: &mut [Origin],
) {
    let planes = [&model.normals.x, &model.normals.y, &model.normals.z];
    for (chunk, origin) in origin.chunks_mut(LANES).enumerate() {
        let x = chunk * LANES;
        let own = load(depth.row(y), x as isize);
        let of_model = load(model.depth_m.row(y), x as isize);
        let known = planes.map(|plane| load(plane.row(y), x as isize));

        let mut from_model = [false; LANES];
        let mut unknown = false;
        for i in 0..LANES {
            let length2 = known[0][i].powi(2) + known[1][i].powi(2) + known[2][i].powi(2);
            let same = is_depth(of_model[i]) & ((own[i] - of_model[i]).abs() <= same_surface_m);
            from_model[i] = (own[i] > 0.0) & same & (length2 > 0.5);
            unknown |= (own[i] > 0.0) & !from_model[i];
        }
        let measured =
            if unknown { normals_of_depth(depth, camera, x, y, &own) } else { [[0.0; LANES]; 3] };

        let lanes = origin.len();
        for k in 0..3 {
            let out = &mut out[k][x..x + lanes];
            for i in 0..lanes {
                out[i] = if from_model[i] { known[k][i] } else { measured[k][i] };
            }
        }
        for i in 0..lanes {
            origin[i] = match (own[i] > 0.0, from_model[i]) {
                (false, _) => Origin::None,
                (true, true) => Origin::Model,
                (true, false) => Origin::Sensor,
            };
        }
    }
}

/// Unit normals in world axes, facing the view, of the 16 pixels from (x, y) on: the cross product
/// of differences between the two sides. 0 where depth is missing or stands alone.
#[inline(always)]
fn normals_of_depth(
    depth: &Image<f32>,
    camera: &Camera,
    x: usize,
    y: usize,
    own: &Lanes,
) -> [Lanes; 3] {
    let (xi, yi) = (x as isize, y as isize);
    let side = |dx: isize, dy: isize| {
        let at = |steps: isize| {
            row_at(depth, yi + steps * dy).map_or([0.0; LANES], |row| load(row, xi + steps * dx))
        };
        let focal = if dx != 0 { camera.scale.x } else { camera.scale.y };
        farthest_on_surface(camera, own, &at(1), &at(REACH), MAX_SLOPE / focal.abs())
    };
    let (left, right) = (side(-1, 0), side(1, 0));
    let (up, down) = (side(0, -1), side(0, 1));

    let mut out = [[0.0; LANES]; 3];
    for i in 0..LANES {
        let u = ((x + i) as f32 - camera.centre.x) / camera.scale.x;
        let v = (y as f32 - camera.centre.y) / camera.scale.y;
        let point = |du: f32, dv: f32, depth_m: f32| {
            let w = camera.w(depth_m);
            [(u + du / camera.scale.x) * w, (v + dv / camera.scale.y) * w, depth_m]
        };
        let across = subtract(
            point(right.steps[i], 0.0, right.depth[i]),
            point(-left.steps[i], 0.0, left.depth[i]),
        );
        let along = subtract(
            point(0.0, down.steps[i], down.depth[i]),
            point(0.0, -up.steps[i], up.depth[i]),
        );
        // x right, y down: along x across points back at the viewer
        let n = cross(along, across);
        let away = if camera.perspective { dot(n, point(0.0, 0.0, own[i])) } else { n[2] };
        let length2 = dot(n, n);
        let good = (own[i] > 0.0) & (length2 > 0.0) & (length2 < f32::INFINITY);
        let scale = if away > 0.0 { -1.0 } else { 1.0 } / length2.sqrt();
        let m = &camera.world_from_view;
        for k in 0..3 {
            let turned = m.x_axis[k] * n[0] + m.y_axis[k] * n[1] + m.z_axis[k] * n[2];
            out[k][i] = if good { turned * scale } else { 0.0 };
        }
    }
    out
}

struct Side {
    /// Pixels from the centre: REACH, 1, or 0 where the surface ends at once.
    steps: Lanes,
    depth: Lanes,
}

#[inline(always)]
fn farthest_on_surface(
    camera: &Camera,
    own: &Lanes,
    near: &Lanes,
    far: &Lanes,
    slope_per_w: f32,
) -> Side {
    let mut side = Side { steps: [0.0; LANES], depth: *own };
    for i in 0..LANES {
        let gate = slope_per_w * camera.w(own[i]);
        let near_ok = is_depth(near[i]) & ((near[i] - own[i]).abs() <= gate);
        let far_ok = near_ok & is_depth(far[i]) & ((far[i] - own[i]).abs() <= gate * REACH as f32);
        side.steps[i] = if far_ok { REACH as f32 } else { f32::from(near_ok) };
        side.depth[i] = if far_ok { far[i] } else { side.depth[i] };
        side.depth[i] = if near_ok & !far_ok { near[i] } else { side.depth[i] };
    }
    side
}

#[inline(always)]
fn subtract(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
