//! Least squares for the light where pictures do not determine it, and says so.

use super::made::*;
use super::on_device::{Fallible, Lit, estimate};
use crate::table::{Device, Found, On, Outcome, Table};
use glam::Vec3;
use kinlight::image::Size;
use kinlight::lighting::{LightEstimate, LightParams, LightPrior, Rejection, ShLight};
use kinlight::math::random::Rng;
use nalgebra::{DMatrix, DVector};

pub fn add_cases(table: &mut Table) {
    for (solver, params) in [("plain", plain()), ("default", every_pixel())] {
        for (normals, normal, rank) in normal_sets() {
            let name = format!("{normals}, {solver} solver: finite, bounded, rank {rank}");
            table.case("light", name, On::Both, |on| determined(on, &params, normal, rank));
        }
        let name =
            format!("the fewer normals, the larger condition and deviations, {solver} solver");
        table.case("light", name, On::Both, |on| worse_and_worse(on, &params));
        let name = format!("stripes of albedo show in the residual, {solver} solver");
        table.case("light", name, On::Both, |on| stripes(on, &params));
    }
    table.case("light", "dark and saturated pictures bring no light", On::Both, no_light);
    table.case("light", "normal equations against f64", On::Both, against_f64);
}

/// Few enough pixels that all are samples.
const SMALL: Size = Size::new(36, 27);
const N: usize = SMALL.pixels();

/// The paper's solver: no prior, no weights, no memory.
pub fn plain() -> LightParams {
    LightParams {
        prior: LightPrior::Dark,
        balance_normals: false,
        hidden_radiance: 0.0,
        tikhonov: 0.0,
        huber: 0.0,
        memory: 0.0,
        ..every_pixel()
    }
}

/// Defaults, on pictures that have no bounced light.
pub fn every_pixel() -> LightParams {
    LightParams { stride: 1, min_cosine: -1.0, hidden_radiance: 0.0, ..LightParams::default() }
}

fn truth() -> ShLight {
    lamps(4, 0.25, &[(Vec3::new(-0.6, -0.5, -0.62).normalize(), 0.4)])
}

type Normal = fn(usize) -> Vec3;

/// From one normal to all; unoccluded surfaces show 9 of 16 coefficients at most, band 3 not at all.
fn normal_sets() -> [(&'static str, Normal, usize); 4] {
    [
        ("one normal", |_| -Vec3::Z, 1),
        ("two normals", |k| if k % 2 == 0 { -Vec3::Z } else { Vec3::new(0.0, -0.8, -0.6) }, 2),
        ("a hemisphere of normals", |k| -on_sphere(k, N, 0.0), 9),
        ("all normals", |k| on_sphere(k, N, -1.0), 9),
    ]
}

fn found(on: Device, params: &LightParams, picture: &Picture) -> Fallible<LightEstimate> {
    let Picture { frame, surface, transfer } = picture;
    estimate(on, params, &Lit { frame, surface, transfer })
}

/// With noise of a camera.
fn made(normal: Normal) -> Picture {
    Picture::open(SMALL, &truth(), normal).noisy(0.01, &mut Rng::new(&[3]))
}

fn norm(light: &ShLight) -> f64 {
    light.luminance().iter().map(|l| f64::from(*l).powi(2)).sum::<f64>().sqrt()
}

fn broken(e: &LightEstimate) -> usize {
    let light = e.light.coefficients.iter().flatten().filter(|c| !c.is_finite()).count();
    let deviations = e.deviation.iter().filter(|d| !d.is_finite() || **d < 0.0).count();
    let others = [e.condition, e.residual].iter().filter(|v| !v.is_finite() || **v < 0.0).count();
    light + deviations + others
}

fn determined(on: Device, params: &LightParams, normal: Normal, rank: usize) -> Outcome {
    let picture = made(normal);
    let e = found(on, params, &picture)?;
    if broken(&e) > 0 || !e.valid() {
        return Err(format!("{e:?}"));
    }
    if e.rank != rank {
        return Err(format!("rank {}, condition {:e}", e.rank, e.condition));
    }
    // What is not determined stays zero, or what the lamp has there, so that a light is no larger than what explains
    // the picture: some times the truth, by the amplification of noise of 0.01 in what is hardly seen.
    let size = norm(&e.light) / norm(&truth());
    Ok(Found::new(size, 3.0, format!("times the true light; condition {:.1e}", e.condition)))
}

fn worse_and_worse(on: Device, params: &LightParams) -> Outcome {
    let mut last: Option<(f64, f32)> = None;
    let mut said = String::new();
    for (name, normal, _) in normal_sets() {
        let e = found(on, params, &made(normal))?;
        // of bands 0 and 1, which all solvers find where they are seen, beside the light that is
        // found; above 1 it is unknown, and more does not say more
        let size = norm(&e.light) as f32;
        let deviation = e.deviation[..4].iter().map(|d| d * d).sum::<f32>().sqrt() / size;
        let deviation = deviation.min(1.0);
        said += &format!(" {name} {:.0e} {deviation:.2}", e.condition);
        if let Some((condition, before)) = last
            && (e.condition > condition * 1.001 || deviation > before)
        {
            return Err(format!("a better picture is said to be worse:{said}"));
        }
        last = Some((e.condition, deviation));
    }
    Ok(Found::broken(0, format!("condition, deviation:{said}")))
}

fn stripes(on: Device, params: &LightParams) -> Outcome {
    let picture = Picture::open(SMALL, &truth(), |k| on_sphere(k, N, -1.0));
    let striped =
        picture.colored(|k, rgb| rgb.map(|v| if (k / 5) % 2 == 0 { 0.5 * v } else { 1.5 * v }));
    let [even, striped] = [&picture, &striped].map(|p| found(on, params, p));
    let (even, striped) = (even?, striped?);
    if broken(&striped) > 0 {
        return Err(format!("{striped:?}"));
    }
    let said = striped.residual > 0.3 && even.residual < 0.05;
    let wider = striped.deviation.iter().zip(&even.deviation).take(4).all(|(s, e)| s > e);
    if !(said && wider) {
        return Err(format!(
            "residuals {} {}, deviations {:?} {:?}",
            even.residual, striped.residual, even.deviation, striped.deviation
        ));
    }
    let [a, b] = [&even, &striped].map(|e| e.light.dominant_direction());
    let (Some(a), Some(b)) = (a, b) else { return Err("no direction".into()) };
    let angle = f64::from(a.angle_between(b).to_degrees());
    // stripes are not fully independent of the normals that they are painted on: measured 0.84 with the plain solver,
    // 0.95 with the default
    Ok(Found::new(angle, 2.0, "degrees that stripes turn the light by"))
}

fn no_light(on: Device) -> Outcome {
    let picture = made(|k| on_sphere(k, N, -1.0));
    for (change, reason) in [(0.0, Rejection::TooDark), (100.0, Rejection::Saturated)] {
        let e = found(on, &every_pixel(), &picture.colored(|_, rgb| rgb.map(|v| v * change)))?;
        if e.rejection != Some(reason) || broken(&e) > 0 {
            return Err(format!("{:?} for {reason:?}", e.rejection));
        }
    }
    Ok(Found::broken(0, "neutral light, with the reason"))
}

/// The plain solver on noisy samples of the whole sphere, three bands: it has full rank.
fn against_f64(on: Device) -> Outcome {
    let light = lamps(3, 0.25, &[(Vec3::new(-0.6, -0.5, -0.62).normalize(), 0.4)]);
    let picture =
        Picture::open(SMALL, &light, |k| on_sphere(k, N, -1.0)).noisy(0.02, &mut Rng::new(&[5]));
    let e = found(on, &plain(), &picture)?;
    let n = 9;
    let rows = DMatrix::from_fn(N, n, |r, c| f64::from(picture.transfer.coefficients[r * n + c]));
    let seen = DVector::from_fn(N, |r, _| f64::from(picture.frame.color.as_slice()[r][0]));
    let svd = rows.clone().svd(true, true);
    let exact = svd.solve(&seen, 1e-12).map_err(str::to_owned)?;
    let worst = (0..n).map(|i| (f64::from(e.light.coefficients[i][0]) - exact[i]).abs());
    // A chunk of 64 rows sums in f32. Transfer comes from the device in steps of 1 / 32767, of which the half is a
    // bound and the mean over all samples that of a uniform distribution.
    let chunk = 64.0 * ROUNDING;
    let steps = match on {
        Device::Cpu => 0.0,
        Device::Gpu(_) => 1.0 / (32767.0 * 12f64.sqrt() * (N as f64).sqrt()) / 0.1,
    };
    let bound =
        e.condition * chunk * exact.norm() + 5.0 * e.condition.sqrt() * steps * exact.norm();
    Ok(Found::new(
        worst.fold(0.0, f64::max),
        bound,
        format!("condition {:.0}; sums of 64 in f32, transfer in 16 bits on a device", e.condition),
    ))
}
