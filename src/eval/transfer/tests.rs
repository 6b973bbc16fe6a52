use super::*;
use crate::geometry::Origin;
use crate::image::Size;
use crate::math::{Orthographic, Pose, Projection, View, pose_from_xyzw};
use crate::mesh::TriangleMesh;
use std::f64::consts::PI;

const RAYS: usize = 20_000;

/// A floor at z = 0 seen straight from above: pixel (x, y) looks at (x - 4, -(y - 3)) / 4 metres.
fn floor() -> GBuffer {
    let camera = Orthographic { width: 9, height: 7, pixels_per_m: 4.0, cx: 4.0, cy: 3.0 };
    // half a turn about x: the view looks down
    let pose = pose_from_xyzw([0.0, 0.0, 2.0], [1.0, 0.0, 0.0, 0.0]).unwrap();
    let view = View { projection: Projection::Orthographic(camera), world_from_view: pose };
    let mut out = GBuffer::empty(view);
    out.depth_m.fill(2.0);
    out.origin.fill(Origin::Model);
    for y in 0..7 {
        for x in 0..9 {
            out.normals.set(x, y, Vec3::Z);
        }
    }
    out
}

fn map_of(step: usize, bands: usize, at: impl Fn(usize, usize) -> Vec<f32>) -> TransferMap {
    let grid = Size::new(9usize.div_ceil(step), 7usize.div_ceil(step));
    let points = (0..grid.pixels()).flat_map(|p| at(p % grid.width, p / grid.width));
    TransferMap { bands, step, grid, coefficients: points.collect() }
}

fn open(step: usize, bands: usize) -> TransferMap {
    map_of(step, bands, |_, _| unoccluded_transfer(Vec3::Z, bands)[..bands * bands].to_vec())
}

fn options(rays: usize) -> TransferErrorOptions {
    TransferErrorOptions { rays, every: 1, lift_m: 1e-4 }
}

/// Transfer of a floor where the half of the sky with x > 0 is hidden, two bands.
fn half_hidden() -> Vec<f32> {
    let (y0, y1) = (0.5 / PI.sqrt(), (3.0 / (4.0 * PI)).sqrt());
    // means over the unit disc that cosine-weighted directions fill: of z 2/3, of x over a half 4/(3 pi)
    [0.5 * y0, 0.0, 0.5 * y1 * 2.0 / 3.0, -0.5 * y1 * 4.0 / (3.0 * PI)].map(|v| v as f32).to_vec()
}

#[test]
fn half_a_sky_has_the_errors_of_its_closed_form() {
    let wall = |_: Vec3, d: Vec3| d.x > 0.0;
    let exact = map_of(1, 2, |_, _| half_hidden());
    let error = transfer_error(&exact, &floor(), wall, &options(RAYS)).unwrap();
    assert_eq!(error.points, 63);
    // the lattice's own error with 20000 rays is below 1e-3
    assert!(error.relative_l2 < 1e-3, "{error:?}");
    assert!(error.dc_bias.abs() < 1e-3 && (error.hidden_share - 0.5).abs() < 1e-3, "{error:?}");

    // What is hidden is the mirror image of what is seen: as large.
    let error = transfer_error(&open(1, 2), &floor(), wall, &options(RAYS)).unwrap();
    assert!((error.relative_l2 - 1.0).abs() < 2e-3, "{error:?}");
    assert_eq!(error.relative_l2, error.open_relative_l2);
    assert_eq!(error.hidden_relative_l2, Some(1.0));
    assert!((error.dc_bias - 0.5).abs() < 1e-3);

    // A map with half of what is hidden has half of the error, and a darker one a negative bias.
    let between = |hidden: f32| {
        let o = unoccluded_transfer(Vec3::Z, 2);
        map_of(1, 2, |_, _| (0..4).map(|k| o[k] + hidden * (half_hidden()[k] - o[k])).collect())
    };
    let error = transfer_error(&between(0.5), &floor(), wall, &options(RAYS)).unwrap();
    assert!((error.hidden_relative_l2.unwrap() - 0.5).abs() < 1e-3, "{error:?}");
    let error = transfer_error(&between(1.2), &floor(), wall, &options(RAYS)).unwrap();
    assert!((error.dc_bias + 0.1).abs() < 1e-3, "{error:?}");
}

#[test]
fn nothing_hidden_is_exact_and_has_no_hidden_part() {
    let error = transfer_error(&open(1, 4), &floor(), |_, _| false, &options(8)).unwrap();
    assert_eq!((error.relative_l2, error.open_relative_l2), (0.0, 0.0));
    assert_eq!((error.hidden_relative_l2, error.hidden_share), (None, 0.0));
}

/// A wall along y at x = `x`, from the floor to a height, as two long triangles.
fn wall_mesh(x: f32, height: f32) -> TriangleMesh {
    TriangleMesh {
        positions: vec![[x, -500.0, 0.0], [x, 500.0, 0.0], [x, 500.0, height], [x, -500.0, height]],
        triangles: vec![[0, 1, 2], [0, 2, 3], [0, 1, 9]],
        ..TriangleMesh::default()
    }
}

#[test]
fn a_long_wall_hides_its_form_factor() {
    let (x, height) = (1.3f32, 0.7f32);
    let rays = SurfaceRays::new(&wall_mesh(x, height));
    let error = transfer_error(
        &open(1, 4),
        &floor(),
        |p, d| rays.occluded(p, d, f32::INFINITY),
        &options(RAYS),
    );
    // A strip beside a patch in its plane hides (1 - cos) / 2 of it, for the angle to its upper edge.
    let expected: f64 = (0..9)
        .map(|i| {
            let distance = f64::from(x) - (f64::from(i) - 4.0) / 4.0;
            0.5 * (1.0 - distance / distance.hypot(f64::from(height)))
        })
        .sum::<f64>()
        / 9.0;
    let found = error.unwrap().dc_bias;
    assert!((found / expected - 1.0).abs() < 5e-3, "{found} {expected}");
}

#[test]
fn grid_points_are_compared_at_their_pixels() {
    // Exact only if the map's value at (i, j) meets the truth of pixel (4 i + 2, 4 j + 2), clamped.
    let hidden_right_of_middle = |p: Vec3, d: Vec3| p.x > 0.1 && d.x > 0.0;
    let map = map_of(4, 2, |i, _| match (4 * i + 2).min(8) {
        x if x > 4 => half_hidden(),
        _ => unoccluded_transfer(Vec3::Z, 2)[..4].to_vec(),
    });
    let error = transfer_error(&map, &floor(), hidden_right_of_middle, &options(RAYS)).unwrap();
    assert_eq!(error.points, 6);
    assert!(error.relative_l2 < 1e-3 && error.hidden_share > 0.3, "{error:?}");
    let fewer = TransferErrorOptions { every: 2, ..options(100) };
    let error = transfer_error(&map, &floor(), hidden_right_of_middle, &fewer).unwrap();
    assert_eq!(error.points, 2);
}

#[test]
fn missing_surfaces_do_not_count_and_none_at_all_is_an_error() {
    let mut buffer = floor();
    for y in 0..7 {
        buffer.depth_m[(0, y)] = 0.0;
        buffer.normals.set(1, y, Vec3::ZERO);
        buffer.normals.set(2, y, Vec3::splat(f32::NAN));
    }
    let wall = |_: Vec3, d: Vec3| d.x > 0.0;
    let error = transfer_error(&open(1, 3), &buffer, wall, &options(10)).unwrap();
    assert_eq!(error.points, 6 * 7);
    buffer.depth_m.fill(0.0);
    assert!(transfer_error(&open(1, 3), &buffer, wall, &options(10)).is_err());
    let dark = |_: Vec3, _: Vec3| true;
    let closed = transfer_error(&open(1, 1), &floor(), dark, &options(1)).map(|e| e.points);
    assert!(closed.is_err(), "no light at all: nothing to relate to, {closed:?}");
}

#[test]
fn maps_that_do_not_fit_are_refused() {
    let none = |_: Vec3, _: Vec3| false;
    let fails = |map: &TransferMap, options: &TransferErrorOptions, needle: &str| {
        let error = transfer_error(map, &floor(), none, options).unwrap_err().to_string();
        assert!(error.contains(needle), "{error}");
    };
    fails(&TransferMap::default(), &options(8), "not of a 9x7 buffer");
    fails(&TransferMap { step: 2, ..open(1, 2) }, &options(8), "step 2");
    fails(&TransferMap { bands: 3, ..open(1, 2) }, &options(8), "9x7");
    fails(&open(1, 2), &options(0), "rays");
    fails(&open(1, 2), &TransferErrorOptions { every: 0, ..options(8) }, "every");
    let empty = GBuffer::empty(View::perspective(
        crate::math::Pinhole { width: 0, height: 0, fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0 },
        Pose::identity(),
    ));
    let map = TransferMap { bands: 1, step: 1, ..TransferMap::default() };
    assert!(transfer_error(&map, &empty, none, &options(8)).is_err());
}

#[test]
fn the_result_does_not_depend_on_the_number_of_threads() {
    let rays = SurfaceRays::new(&wall_mesh(0.4, 1.0));
    let measured = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let occluded = |p: Vec3, d: Vec3| rays.occluded(p, d, f32::INFINITY);
        pool.install(|| transfer_error(&open(1, 4), &floor(), occluded, &options(500)).unwrap())
    };
    assert_eq!(measured(1), measured(3));
}
