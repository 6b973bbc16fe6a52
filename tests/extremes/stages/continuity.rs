//! Small changes of input make proportionally small changes of output: at two scales, one half of the other.

use super::light::every_pixel;
use super::made::*;
use super::on_device::{Fallible, Lit, Map, compose, estimate, shading, track, transfer};
use crate::table::{Device, Found, On, Outcome, Table};
use glam::Vec3;
use kinlight::compositing::{ComposeInput, CompositingParams, VirtualLayer};
use kinlight::fusion::VolumeParams;
use kinlight::image::Image;
use kinlight::math::View;
use kinlight::math::random::Rng;
use kinlight::scene::analytic::AnalyticScene;
use kinlight::tracking::TrackingParams;
use kinlight::transfer::TransferParams;

pub fn add_cases(table: &mut Table) {
    let cases: [(&str, &str, f64, Statistic, Body); 10] = [
        ("transfer", "depth by 0.01 mm, smooth part", 1e-5, Statistic::Median, transfer_by_depth),
        // at a depth limit a sample is hidden or not: jumps, whose number grows with the change
        ("transfer", "depth by 1 mm, jumps included", 1e-3, Statistic::Mean, transfer_by_depth),
        // by 1e-6 a coefficient changes by a step of f32
        ("transfer", "pose by 1e-5", 1e-5, Statistic::Median, transfer_by_pose),
        ("light", "colour by a code", 4e-3, Statistic::Norm, light_by_color),
        // robust weights bend where a residual comes to their limit, and the lamp's place ends within 3e-5
        ("light", "transfer by 2e-4", 2e-4, Statistic::Norm, light_by_transfer),
        ("picture", "R'/R, light by 1e-3", 1e-3, Statistic::Median, shading_by_light),
        // small beside the lobes of the light, and still 0.2 codes in the mean: the share of pixels that change
        ("picture", "codes, light by 0.02", 0.02, Statistic::Mean, codes_by_light),
        ("ray-cast", "depth, pose by 1e-6", 1e-6, Statistic::Median, raycast_by_pose),
        ("ray-cast", "depth, frame's depth by 0.1 mm", 1e-4, Statistic::Median, raycast_by_depth),
        ("registration", "pose, depth by 0.01 mm", 1e-5, Statistic::Norm, pose_by_depth),
    ];
    for (stage, name, step, statistic, body) in cases {
        let name = format!("continuous: {name}");
        table.case(stage, name, On::Both, |on| proportional(on, step, statistic, body));
    }
}

/// The output for input that is changed by so much.
type Body = fn(Device, f64) -> Fallible<Vec<f64>>;

/// How large a change is.
#[derive(Clone, Copy)]
enum Statistic {
    /// Of the values that change at all.
    Median,
    Mean,
    /// Root of the sum of squares.
    Norm,
}

impl Statistic {
    fn of(self, a: &[f64], b: &[f64]) -> f64 {
        let mut changes: Vec<f64> = a.iter().zip(b).map(|(a, b)| (a - b).abs()).collect();
        match self {
            Self::Mean => changes.iter().sum::<f64>() / changes.len() as f64,
            Self::Norm => changes.iter().map(|c| c * c).sum::<f64>().sqrt(),
            Self::Median => {
                changes.retain(|&c| c > 0.0);
                changes.sort_by(f64::total_cmp);
                changes.get(changes.len() / 2).copied().unwrap_or(0.0)
            }
        }
    }
}

/// Half the step makes half the change, within a quarter of it: rounding, curvature, the count of jumps.
fn proportional(on: Device, step: f64, statistic: Statistic, body: Body) -> Outcome {
    let [before, whole, half] = [0.0, step, 0.5 * step].map(|by| body(on, by));
    let (before, whole, half) = (before?, whole?, half?);
    if before.iter().chain(&whole).chain(&half).any(|v| !v.is_finite()) {
        return Err("not finite".into());
    }
    let [whole, half] = [whole, half].map(|after| statistic.of(&before, &after));
    if whole == 0.0 || half == 0.0 {
        return Err(format!("nothing changes: {whole:e} {half:e}"));
    }
    let ratio = whole / half;
    let off = (ratio / 2.0).max(2.0 / ratio) - 1.0;
    let name = match statistic {
        Statistic::Median => "median",
        Statistic::Mean => "mean",
        Statistic::Norm => "norm",
    };
    let what =
        format!("off a ratio of 2; {name} change {:.2} for each unit of input", whole / step);
    Ok(Found::new(off, 0.25, what))
}

/// A change without an edge, of this size.
fn ripple(x: usize, y: usize, by: f64) -> f32 {
    (by * (0.7 + 0.3 * (0.3 * x as f64).sin() * (0.2 * y as f64).cos())) as f32
}

fn corner() -> AnalyticScene {
    AnalyticScene::corner()
}

/// Relative, so that surfaces keep their shape, and their normals.
fn transfer_by_depth(on: Device, by: f64) -> Fallible<Vec<f64>> {
    let mut main = corner().render(&corner_view(SIZE));
    main.depth_m = image(SIZE, |x, y| match main.depth_m[(x, y)] {
        d if d > 0.0 => d + ripple(x, y, by),
        _ => 0.0,
    });
    coefficients(on, main)
}

/// The camera turns, and what it sees with it.
fn transfer_by_pose(on: Device, by: f64) -> Fallible<Vec<f64>> {
    let mut view = corner_view(SIZE);
    let scale = by.to_degrees();
    view.world_from_view *= motion([by, -by, by], [scale, scale, -scale]);
    let mut main = corner().render(&corner_view(SIZE));
    main.view = view;
    coefficients(on, main)
}

fn coefficients(on: Device, main: kinlight::geometry::GBuffer) -> Fallible<Vec<f64>> {
    let map = transfer(on, &TransferParams::default(), &main, &[])?;
    Ok(map.coefficients.iter().map(|&c| f64::from(c)).collect())
}

/// A picture under a lamp with noise, which is not fully explained.
fn lit() -> Picture {
    let light = lamps(4, 0.2, &[(Vec3::new(-0.6, -0.5, -0.62).normalize(), 0.4)]);
    let picture = Picture::open(SIZE, &light, |k| -on_sphere(k, SIZE.pixels(), 0.2));
    picture.noisy(0.01, &mut Rng::new(&[8]))
}

fn light_of(on: Device, picture: &Picture) -> Fallible<Vec<f64>> {
    let Picture { frame, surface, transfer } = picture;
    let e = estimate(on, &every_pixel(), &Lit { frame, surface, transfer })?;
    match e.rejection {
        Some(reason) => Err(reason.to_string()),
        None => Ok(e.light.luminance().iter().map(|&c| f64::from(c)).collect()),
    }
}

/// One side of the picture grows brighter.
fn light_by_color(on: Device, by: f64) -> Fallible<Vec<f64>> {
    light_of(on, &lit().colored(|k, rgb| rgb.map(|v| v + ripple(k % SIZE.width, 0, by))))
}

fn light_by_transfer(on: Device, by: f64) -> Fallible<Vec<f64>> {
    let (mut picture, mut rng) = (lit(), Rng::new(&[9]));
    // the device's samples have 16 bits, beside which this must be large in the mean of all
    picture
        .transfer
        .coefficients
        .iter_mut()
        .for_each(|t| *t *= 1.0 + 30.0 * by as f32 * rng.normal());
    light_of(on, &picture)
}

/// A shadow over half a wall.
fn shadowed(on: Device, by: f64, codes: bool) -> Fallible<Vec<f64>> {
    let towards = Vec3::new(0.3 + by as f32, -0.5, -0.8).normalize();
    let light = lamps(4, 0.2, &[(towards, 0.5)]);
    let seen = Picture::open(SIZE, &light, |k| -on_sphere(k / 97, 40, 0.5));
    let mut merged = seen.transfer.clone();
    let shadow = lamps(4, 0.0, &[(Vec3::new(0.5, -0.4, -0.75).normalize(), 0.08)]);
    for (k, row) in merged.coefficients.chunks_mut(16).enumerate() {
        if k % SIZE.width > SIZE.width / 2 {
            row.iter_mut().zip(&shadow.coefficients).for_each(|(t, s)| *t -= s[0]);
        }
    }
    let layer = VirtualLayer::empty(SIZE);
    let mut frame = seen.frame.clone();
    frame.color_srgb = Image::new(SIZE, [200; 3]);
    let input = ComposeInput {
        frame: &frame,
        real: &seen.surface,
        merged: &seen.surface,
        layer: &layer,
        real_transfer: &seen.transfer,
        merged_transfer: &merged,
        indirect: None,
        light: &light,
        mean_albedo: 0.5,
    };
    let params = CompositingParams::default();
    if codes {
        let out = compose(on, &params, &input)?;
        return Ok(out.as_slice().iter().map(|c| f64::from(c[1])).collect());
    }
    let out = shading(on, &params, &input)?;
    let pairs = out.merged.as_slice().iter().zip(out.real.as_slice());
    Ok(pairs.map(|(merged, real)| f64::from(merged[1]) / f64::from(real[1])).collect())
}

fn shading_by_light(on: Device, by: f64) -> Fallible<Vec<f64>> {
    shadowed(on, by, false)
}

fn codes_by_light(on: Device, by: f64) -> Fallible<Vec<f64>> {
    shadowed(on, by, true)
}

fn raycast_of(on: Device, view: &View, depth_by: f64) -> Fallible<Vec<f64>> {
    let params = VolumeParams { resolution: 64, color: false, ..VolumeParams::default() };
    let from = corner_view(SIZE);
    let depth_m = corner().render(&from).depth_m;
    let frame = grey_frame(image(SIZE, |x, y| match depth_m[(x, y)] {
        d if d > 0.0 => d + ripple(x, y, depth_by),
        _ => 0.0,
    }));
    let mut map = Map::new(on, &params)?;
    map.integrate(&frame, &from)?;
    let out = map.raycast(view)?;
    Ok(out.depth_m.as_slice().iter().map(|&d| f64::from(d)).collect())
}

fn raycast_by_pose(on: Device, by: f64) -> Fallible<Vec<f64>> {
    let mut view = corner_view(SIZE);
    view.world_from_view *= motion([0.5 * by, 0.0, -by], [by.to_degrees(), 0.0, 0.0]);
    raycast_of(on, &view, 0.0)
}

fn raycast_by_depth(on: Device, by: f64) -> Fallible<Vec<f64>> {
    raycast_of(on, &corner_view(SIZE), by)
}

/// Where alignment ends, in metres and radians.
fn pose_by_depth(on: Device, by: f64) -> Fallible<Vec<f64>> {
    let view = corner_view(SIZE);
    let model = corner().render(&view);
    let mut moved = view;
    moved.world_from_view *= motion([0.004, -0.003, 0.002], [0.2, 0.1, -0.1]);
    let depth_m = corner().render(&moved).depth_m;
    let frame = grey_frame(image(SIZE, |x, y| match depth_m[(x, y)] {
        d if d > 0.0 => d + ripple(x, y, by),
        _ => 0.0,
    }));
    // one step: partners are those of the nearest pixel, so that later steps may change partners, in jumps
    let params = TrackingParams { iterations: vec![1], ..TrackingParams::default() };
    let found = track(on, &params, &frame, &model, camera(SIZE))?;
    let step = view.world_from_view.inverse() * found.world_from_camera;
    let (t, r) = (step.translation.vector, step.rotation.scaled_axis());
    Ok(vec![t.x, t.y, t.z, r.x, r.y, r.z])
}
