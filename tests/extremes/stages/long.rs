//! What is added up for days.

use super::light::every_pixel;
use super::made::*;
use super::on_device::Map;
use crate::table::{Device, Found, On, Outcome, Table};
use glam::Vec3;
use kinlight::fusion::VolumeParams;
use kinlight::image::{Image, Size};
use kinlight::lighting::LightEstimator;
use kinlight::math::random::Rng;
use kinlight::math::{Pinhole, Pose, View};
use nalgebra::{UnitQuaternion, Vector3};

pub fn add_cases(table: &mut Table) {
    table.case(
        "long",
        "a wall that comes and goes by 1 mm does not wander off",
        On::Both,
        alternating,
    );
    table.case("long", "100 000 poses one after the other", On::Host, |_| poses());
    table.case("long", "2000 frames of one light: nothing is added up", On::Host, |_| light());
}

/// A map of 16 voxels a side before a wall, seen in a few pixels.
fn alternating(on: Device) -> Outcome {
    let integrations = match on {
        Device::Cpu => 100_000,
        Device::Gpu(_) => 1000,
    };
    let params = VolumeParams { resolution: 16, color: false, ..VolumeParams::default() };
    let size = Size::new(21, 15);
    let pinhole = Pinhole { width: 21, height: 15, fx: 17.0, fy: 17.0, cx: 10.0, cy: 7.0 };
    let view = View::perspective(pinhole, look_at([0.0, -1.2, 0.0], [0.0, 0.0, 0.0]));
    let walls = [1.2f32, 1.201].map(|depth_m| grey_frame(Image::new(size, depth_m)));
    let mut map = Map::new(on, &params)?;
    for k in 0..integrations {
        map.integrate(&walls[k % 2], &view)?;
    }
    let depth_m = map.raycast(&view)?.depth_m;
    let errors =
        depth_m.as_slice().iter().filter(|&&d| d > 0.0).map(|d| f64::from((d - 1.2005).abs()));
    let (count, worst) = errors.fold((0, 0.0f64), |(n, worst), e| (n + 1, worst.max(e)));
    if count < 100 {
        return Err(format!("only {count} pixels show the wall"));
    }
    let volume = map.into_host()?;
    // At the largest weight a frame moves an average by 1 / 129 of how far it is away, and by nothing where that is
    // less than half a step: it stands still within 64 steps of the mean, whatever came before.
    let step_m = f64::from(volume.truncation_m()) / f64::from(i16::MAX);
    let bound = (0.5 * 129.0 + 1.0) * step_m;
    Ok(Found::new(
        worst,
        bound,
        format!("m off the mean after {integrations}; 65 steps of 16 bits"),
    ))
}

/// A turn and a shift a hundred thousand times, against the screw motion that they are part of.
fn poses() -> Outcome {
    let (axis, angle, along_m) = (Vector3::new(0.36, 0.48, 0.8), 1e-3, 1e-4);
    let n = 100_000;
    let step =
        Pose::from_parts((axis * along_m).into(), UnitQuaternion::from_scaled_axis(axis * angle));
    let mut pose = Pose::identity();
    for _ in 0..n {
        pose *= step;
    }
    let exact = UnitQuaternion::from_scaled_axis(axis * (angle * f64::from(n)));
    let unit = (pose.rotation.coords.norm() - 1.0).abs();
    let turned = exact.angle_to(&pose.rotation);
    let shifted = (pose.translation.vector - axis * (along_m * f64::from(n))).norm();
    // eight roundings of 2^-53 for each product, all in one direction, of numbers up to 10
    let bound = 8.0 * f64::from(n) * 0.5 * f64::EPSILON;
    let worst = unit.max(turned).max(shifted / 10.0);
    Ok(Found::new(
        worst,
        bound,
        format!("norm {unit:.0e}, {turned:.0e} rad, {shifted:.0e} m of 10"),
    ))
}

/// Sums are made anew of the frames that are remembered, 16 at most: after these, nothing of the past is left.
fn light() -> Outcome {
    let size = Size::new(12, 9);
    let lamp = lamps(3, 0.25, &[(Vec3::new(-0.6, -0.5, -0.62).normalize(), 0.4)]);
    let picture = |seed| {
        let made = Picture::open(size, &lamp, |k| on_sphere(k, size.pixels(), -1.0));
        made.noisy(0.01, &mut Rng::new(&[seed]))
    };
    let params = kinlight::lighting::LightParams {
        prior: kinlight::lighting::LightPrior::Dark,
        huber: 0.0,
        ..every_pixel()
    };
    let run = |before: usize| {
        let mut estimator = LightEstimator::new(&params);
        let mut last = None;
        for k in 0..before + 16 {
            let seed = if k < before { 1000 + k } else { k - before };
            let Picture { frame, surface, transfer } = picture(seed as u32);
            last = Some(estimator.estimate(&frame, &surface, &transfer, None));
        }
        last.map(|e| e.light.luminance()).unwrap_or_default()
    };
    let (fresh, old) = (run(0), run(2000));
    let different = fresh.iter().zip(&old).filter(|(a, b)| a != b).count();
    if fresh.is_empty() {
        return Err("no light".into());
    }
    Ok(Found::broken(different, "coefficients that 2000 earlier frames have changed"))
}
