//! Alignment: sums against f64, and scenes that leave motions open.

use super::made::*;
use super::on_device::track;
use crate::table::{Device, Found, On, Outcome, Table};
use glam::{DVec3, Vec3};
use kinlight::capture::RgbdFrame;
use kinlight::geometry::{GBuffer, Origin};
use kinlight::image::Size;
use kinlight::math::{Pose, View};
use kinlight::scene::analytic::{AnalyticScene, Shape};
use kinlight::tracking::{Tracking, TrackingIssue, TrackingParams};
use nalgebra::{Matrix6, Translation3, UnitQuaternion, Vector3, Vector6};

pub fn add_cases(table: &mut Table) {
    for size in [Size::new(640, 480), SIZE] {
        let name = format!("one step of {} pixels against f64", size.pixels());
        table.case("registration", name, On::Both, |on| one_step(on, size));
    }
    for scene in [wall(), ridge(), corridor(), ball()] {
        let motions = scene.open.len();
        let name = format!("{}: {motions} open, {}", scene.name, scene.motions);
        table.case("registration", name, On::Both, |on| left_open(on, &scene));
    }
}

/// One Gauss-Newton step on the depth as it comes.
fn single_step() -> TrackingParams {
    TrackingParams {
        iterations: vec![1],
        filter_radius: 0,
        filter_sigma_m: 10.0,
        ..TrackingParams::default()
    }
}

/// A smooth wall with waves, without an edge, so that no pair is at a gate: depth and normal, camera axes.
fn waves(size: Size, x: f64, y: f64) -> (f64, DVec3) {
    let camera = camera(size);
    let phase = |u: f64, v: f64| (9.0 * u / size.width as f64, 7.0 * v / size.height as f64);
    let depth = |u: f64, v: f64| {
        let (a, b) = phase(u, v);
        1.4 + 0.12 * a.sin() + 0.15 * b.cos() + 0.1 * (a + b).sin()
    };
    let point = |u: f64, v: f64| ray(&camera, u, v) * depth(u, v);
    let h = 1e-3;
    let (du, dv) = (point(x + h, y) - point(x - h, y), point(x, y + h) - point(x, y - h));
    (depth(x, y), dv.cross(du).normalize())
}

fn one_step(on: Device, size: Size) -> Outcome {
    let view = View::perspective(camera(size), Pose::identity());
    let mut model = GBuffer::empty(view);
    let mut frame = grey_frame(model.depth_m.clone());
    for (x, y) in (0..size.pixels()).map(|k| (k % size.width, k / size.width)) {
        let (depth, normal) = waves(size, x as f64, y as f64);
        model.depth_m[(x, y)] = depth as f32;
        model.normals.set(x, y, normal.as_vec3());
        model.origin[(x, y)] = Origin::Model;
        // a millimetre nearer and farther, and tilted: within the Huber limit
        let off =
            1e-3 * (0.7 + 0.3 * (x as f64 / size.width as f64) - (y as f64 / size.height as f64));
        frame.depth_m[(x, y)] = (depth + off) as f32;
    }
    let found = track(on, &single_step(), &frame, &model, camera(size))?;
    let exact = Exact::of(&frame, &model);
    let step = exact.a.try_inverse().ok_or("the scene determines all motions")? * exact.b;
    let expected = exp(&step);
    let apart = expected.inverse() * found.world_from_camera;
    let error = apart.translation.vector.norm().max(apart.rotation.angle());
    if found.rank != 6 {
        return Err(format!("rank {}", found.rank));
    }
    Ok(Found::new(
        error,
        exact.bound(&step),
        "m and rad; rounding of every term, of 320 in a row, and of points",
    ))
}

/// Point-to-plane normal equations (Newcombe et al. 2011, Eq. 20-24) of two pictures from one place.
struct Exact {
    a: Matrix6<f64>,
    b: Vector6<f64>,
    /// Sums of absolute terms of A and b, and of |w J|.
    most: (Matrix6<f64>, Vector6<f64>, Vector6<f64>),
}

impl Exact {
    fn of(frame: &RgbdFrame, model: &GBuffer) -> Self {
        let size = model.size();
        let camera = camera(size);
        let zero = (Matrix6::zeros(), Vector6::zeros());
        let mut out = Self { a: zero.0, b: zero.1, most: (zero.0, zero.1, zero.1) };
        let sigma_m = |z: f64| 0.0012 + 0.0019 * (z - 0.4).powi(2);
        for (x, y) in (0..size.pixels()).map(|k| (k % size.width, k / size.width)) {
            let ray = ray(&camera, x as f64, y as f64);
            let z = f64::from(frame.depth_m[(x, y)]);
            let (p, n) = (ray * z, model.normals.at(x, y).as_dvec3());
            let residual = n.dot(ray * f64::from(model.depth_m[(x, y)]) - p);
            let huber = (1.345 * sigma_m(z) / residual.abs()).min(1.0);
            let weight = huber * (sigma_m(0.4) / sigma_m(z)).powi(2);
            let turn = p.cross(n);
            let j = Vector6::new(turn.x, turn.y, turn.z, n.x, n.y, n.z);
            out.a += weight * j * j.transpose();
            out.b += weight * residual * j;
            out.most.0 += weight * (j * j.transpose()).abs();
            out.most.1 += weight * residual.abs() * j.abs();
            out.most.2 += weight * j.abs();
        }
        out
    }

    /// How far rounding may move the step. 320 terms follow each other in f32, and each is a product of
    /// ten roundings; a residual is a difference of points of 2 m, rounded six times each.
    fn bound(&self, step: &Vector6<f64>) -> f64 {
        let (sums, points_m) = (330.0 * ROUNDING, 6.0 * 2.0 * ROUNDING);
        let moved = sums * (self.most.1 + self.most.0 * step.abs()) + points_m * self.most.2;
        let inverse = self.a.try_inverse().map_or(f64::INFINITY * Matrix6::identity(), |a| a.abs());
        (inverse * moved).max()
    }
}

/// Exponential of a small motion, rotation first, to third order.
fn exp(step: &Vector6<f64>) -> Pose {
    let (w, t) = (step.fixed_rows::<3>(0).into_owned(), step.fixed_rows::<3>(3).into_owned());
    let turned = w.cross(&t);
    let translation = t + 0.5 * turned + w.cross(&turned) / 6.0;
    Pose::from_parts(Translation3::from(translation), UnitQuaternion::from_scaled_axis(w))
}

/// The small motion that a pose is the exponential of.
fn log(pose: &Pose) -> (Vector3<f64>, Vector3<f64>) {
    let (w, t) = (pose.rotation.scaled_axis(), pose.translation.vector);
    let turned = w.cross(&t);
    (w, t - 0.5 * turned + w.cross(&turned) / 12.0)
}

/// A scene, and the motions that it leaves open: rotation vector and translation of each.
struct Open {
    name: &'static str,
    motions: &'static str,
    shapes: Vec<Shape>,
    open: Vec<[Vec3; 2]>,
    moved: Pose,
    /// What the step may hold of an open motion, of the size of the whole.
    rounding: f64,
}

/// Where open motions are pure rotations or pure translations, the step's part in them is rounding of f32 normals
/// and points, 6e-8, over the root of the smallest eigenvalue's share that counts, 2e-4.
const PURE: f64 = 5e-6;

fn wall() -> Open {
    let normal = Vec3::new(0.36, 0.48, -0.8);
    let along = normal.any_orthonormal_pair();
    Open {
        name: "wall",
        motions: "along it twice, about its normal",
        shapes: vec![Shape::Plane { normal, offset: -1.2 }],
        open: vec![[normal, Vec3::ZERO], [Vec3::ZERO, along.0], [Vec3::ZERO, along.1]],
        moved: motion([0.003, -0.002, 0.004], [0.2, 0.1, 0.4]),
        rounding: PURE,
    }
}

fn ridge() -> Open {
    let plane = |x: f32| {
        let normal = Vec3::new(x, 0.0, -0.8);
        Shape::Plane { normal, offset: normal.dot(Vec3::new(0.0, 0.0, 2.0)) }
    };
    Open {
        name: "two walls",
        motions: "along their edge",
        shapes: vec![plane(0.6), plane(-0.6)],
        open: vec![[Vec3::ZERO, Vec3::Y]],
        moved: motion([0.003, 0.004, 0.002], [0.1; 3]),
        rounding: PURE,
    }
}

fn corridor() -> Open {
    let side = |normal: Vec3| Shape::Plane { normal, offset: -1.0 };
    Open {
        name: "corridor",
        motions: "along it",
        shapes: [Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y].map(side).to_vec(),
        open: vec![[Vec3::ZERO, Vec3::Z]],
        moved: motion([0.003, -0.002, 0.006], [0.1, 0.1, -0.1]),
        rounding: PURE,
    }
}

fn ball() -> Open {
    let centre = Vec3::new(0.05, -0.03, 1.2);
    // about an axis through the centre: the centre stays
    let about = |axis: Vec3| [axis, centre.cross(axis)];
    Open {
        name: "ball",
        motions: "three rotations about its centre",
        shapes: vec![Shape::Sphere { centre, radius: 0.5 }],
        open: vec![about(Vec3::X), about(Vec3::Y), about(Vec3::Z)],
        moved: motion([0.002, 0.003, -0.002], [0.1, 0.1, 0.4]),
        // lengths are compared in units of the mean depth of all pixels, not of the partners alone; pixels of the
        // rim have normals of f32 differences
        rounding: 0.01,
    }
}

fn left_open(on: Device, scene: &Open) -> Outcome {
    let shapes = AnalyticScene::new(scene.shapes.clone());
    let model = shapes.render(&View::perspective(camera(SIZE), Pose::identity()));
    let frame = grey_frame(shapes.render(&View::perspective(camera(SIZE), scene.moved)).depth_m);
    let found = track(on, &single_step(), &frame, &model, camera(SIZE))?;
    let rank = 6 - scene.open.len();
    judge(&found, rank)?;
    let depths = frame.depth_m.as_slice().iter().filter(|&&d| d > 0.0);
    let length_m = depths.clone().map(|&d| f64::from(d)).sum::<f64>() / depths.count() as f64;
    // unknowns of one kind, as the solver has them
    let (w, t) = log(&found.world_from_camera);
    let step = Vector6::new(w.x, w.y, w.z, t.x / length_m, t.y / length_m, t.z / length_m);
    let vector = |v: Vec3| Vector3::from(v.as_dvec3().to_array());
    let along = scene.open.iter().map(|&[w, t]| {
        let (w, t) = (vector(w), vector(t) / length_m);
        let open = Vector6::new(w.x, w.y, w.z, t.x, t.y, t.z).normalize();
        open.dot(&step).abs() / step.norm()
    });
    let share = along.fold(0.0, f64::max);
    Ok(Found::new(share, scene.rounding, format!("part of the step in open motions; rank {rank}")))
}

fn judge(found: &Tracking, rank: usize) -> Result<(), String> {
    match found.issue {
        Some(TrackingIssue::Underconstrained { rank: seen }) if seen == rank => Ok(()),
        _ => Err(format!("rank {rank} expected: {found:?}")),
    }
}
