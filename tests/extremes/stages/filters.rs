//! Medians and normals of depth pictures, read off the page in f64.

use super::made::*;
use super::on_device::dyn_geo;
use crate::table::{Device, Found, On, Outcome, Table};
use glam::DVec3;
use kinlight::capture::RgbdFrame;
use kinlight::geometry::{DynGeoParams, GBuffer, Origin};
use kinlight::image::Image;
use kinlight::math::random::Rng;
use kinlight::math::{Pose, View};

pub fn add_cases(table: &mut Table) {
    table.case("filters", "plain median against sorting", On::Both, |on| median(on, false));
    table.case("filters", "guided median against sorting", On::Both, |on| median(on, true));
    table.case("filters", "the median of a constant picture is that picture", On::Both, |on| {
        let depth_m = Image::new(SIZE, 1.234_567_9f32);
        let out = dyn_geo(on, &DynGeoParams::default(), &grey_frame(depth_m.clone()), &blank())?;
        Ok(Found::broken(different(&depth_m, &out.depth_m), "pixels that differ"))
    });
    table.case(
        "filters",
        "D'' and D''' leave their own result of steps alone",
        On::Both,
        idempotent,
    );
    for degrees in [0.0, 45.0, 75.0] {
        let name = format!("normals of a wall at {degrees} degrees against f64");
        table.case("filters", name, On::Both, |on| normals_of_a_wall(on, degrees));
    }
}

fn view() -> View {
    View::perspective(camera(SIZE), Pose::identity())
}

/// A model that knows nothing.
fn blank() -> GBuffer {
    GBuffer::empty(view())
}

fn different(a: &Image<f32>, b: &Image<f32>) -> usize {
    a.as_slice().iter().zip(b.as_slice()).filter(|(a, b)| a != b).count()
}

/// Depth with holes, and intensity, in steps whose differences are exact.
fn rough() -> RgbdFrame {
    let mut rng = Rng::new(&[41]);
    let depth_m = image(SIZE, |x, y| {
        let step = if (x / 9 + y / 7) % 2 == 0 { 256.0 } else { 300.0 };
        let depth = (step + (24.0 * rng.uniform()).floor()) / 256.0;
        if rng.uniform() < 0.7 { depth } else { 0.0 }
    });
    let intensity = image(SIZE, |_, _| (80.0 * rng.uniform()).floor() / 4.0);
    RgbdFrame { intensity, ..grey_frame(depth_m) }
}

/// Everything off but one median.
fn one_median(guided: bool) -> DynGeoParams {
    DynGeoParams { merge: true, smooth: guided, denoise: !guided, ..DynGeoParams::default() }
}

/// Without a model, D' is the sensor's depth where there is any, else the guided median.
fn median(on: Device, guided: bool) -> Outcome {
    let (params, frame) = (one_median(guided), rough());
    let out = dyn_geo(on, &params, &frame, &blank())?;
    let sorted =
        |depth: &Image<f32>, reach: isize, step: isize, guided: bool, x: usize, y: usize| {
            let mut values = Vec::new();
            for dy in (-reach..=reach).step_by(step as usize) {
                for dx in (-reach..=reach).step_by(step as usize) {
                    let (u, v) = (x as isize + dx, y as isize + dy);
                    let Some(&d) = usize::try_from(u)
                        .ok()
                        .zip(usize::try_from(v).ok())
                        .and_then(|(u, v)| depth.get(u, v))
                    else {
                        continue;
                    };
                    let step = frame.intensity[(u as usize, v as usize)] - frame.intensity[(x, y)];
                    if d > 0.0 && (!guided || step.abs() < params.intensity_threshold) {
                        values.push(d);
                    }
                }
            }
            values.sort_by(f32::total_cmp);
            if values.is_empty() { 0.0 } else { values[(values.len() - 1) / 2] }
        };
    // windows of 20 and 8 pixels with 5 taps a side, of 3 with all
    let merged = image(SIZE, |x, y| match frame.depth_m[(x, y)] {
        d if d > 0.0 => d,
        _ => sorted(&frame.depth_m, 10, 5, true, x, y),
    });
    let (reach, step) = if guided { (4, 2) } else { (1, 1) };
    let expected = image(SIZE, |x, y| sorted(&merged, reach, step, guided, x, y));
    Ok(Found::broken(different(&expected, &out.depth_m), "pixels that differ"))
}

/// A median is idempotent on pictures of steps that are wider than its window: that is what it leaves behind
/// of them. (On texture it is not: each pass takes more of it away.)
fn idempotent(on: Device) -> Outcome {
    let steps = image(SIZE, |x, _| if x < 32 { 1.0 } else { 1.5 });
    let params = DynGeoParams::default();
    let once = dyn_geo(on, &params, &grey_frame(steps), &blank())?;
    let twice = dyn_geo(on, &params, &grey_frame(once.depth_m.clone()), &blank())?;
    Ok(Found::broken(different(&once.depth_m, &twice.depth_m), "pixels that differ"))
}

fn normals_of_a_wall(on: Device, degrees: f64) -> Outcome {
    let a = degrees.to_radians();
    let normal = DVec3::new(0.6 * a.sin(), 0.8 * a.sin(), -a.cos());
    let camera = camera(SIZE);
    let offset_m = normal.dot(DVec3::new(0.0, 0.0, 1.5));
    let depth = |x: usize, y: usize| {
        let z = plane_depth_m(&camera, normal, offset_m, x as f64, y as f64);
        if z > 0.3 && z < 8.0 { z as f32 } else { 0.0 }
    };
    let frame = grey_frame(image(SIZE, depth));
    let params = DynGeoParams { smooth: false, denoise: false, ..DynGeoParams::default() };
    let out = dyn_geo(on, &params, &frame, &blank())?;
    let (mut worst, mut seen) = (Found::new(0.0, 1.0, ""), 0);
    for (x, y) in (0..SIZE.pixels()).map(|k| (k % SIZE.width, k / SIZE.width)) {
        // holes are filled with medians, which are no part of the wall
        if frame.depth_m[(x, y)] == 0.0 || out.origin[(x, y)] != Origin::Sensor {
            continue;
        }
        let found = out.normals.at(x, y).as_dvec3();
        let reach = [(x, SIZE.width), (y, SIZE.height)].map(|(k, n)| k.min(n - 1 - k));
        if reach.iter().any(|&r| r < 3) || found == DVec3::ZERO {
            continue;
        }
        // Points at both ends of a baseline of 6 pixels, z / f wide at least, are rounded four times each
        // in numbers of their size; the farther an end is, the larger.
        let z = f64::from(frame.depth_m[(x, y)]);
        let ends = [(x - 3, y), (x + 3, y), (x, y - 3), (x, y + 3)].map(|at| frame.depth_m[at]);
        if ends.contains(&0.0) {
            continue;
        }
        let far = f64::from(ends.into_iter().fold(0.0, f32::max));
        let size = far * ray(&camera, x as f64, y as f64).length();
        let bound = 2.0 * 4.0 * ROUNDING * size / (6.0 * z / f64::from(camera.fx));
        let error = found.cross(normal).length();
        let what = "of what 8 roundings of points 6 pixels apart turn a normal by";
        worst = worst.worse(Found::new(error / bound, 1.0, what));
        seen += 1;
    }
    if seen < 500 { Err(format!("only {seen} normals to compare")) } else { Ok(worst) }
}
