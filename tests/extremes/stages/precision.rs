//! Kernels in f32 against the same mathematics in f64.

use super::made::*;
use super::on_device::{Fallible, Map, transfer};
use super::transfer_oracle::TransferOracle;
use crate::table::{Device, Found, On, Outcome, Table};
use glam::{DVec3, Vec2, Vec3};
use kinlight::capture::RgbdFrame;
use kinlight::fusion::{TsdfVolume, VolumeParams};
use kinlight::geometry::GBuffer;
use kinlight::image::Size;
use kinlight::math::{Pinhole, Pose, View};
use kinlight::scene::analytic::{AnalyticScene, Shape};
use kinlight::transfer::TransferParams;

pub fn add_cases(table: &mut Table) {
    table.case("precision", "projection and back against f64", On::Host, |_| projection());
    for frames in [1, 6] {
        let name = format!("voxels of a tilted wall, {frames} frames, against f64");
        table.case("precision", name, On::Both, |on| voxels(on, frames));
    }
    table.case("precision", "ray-cast depth of a tilted wall", On::Both, |on| {
        let plane = Shape::Plane { normal: WALL, offset: 0.0 };
        raycast(on, plane, 0.0, "of a voxel; end of search 0.01, curvature of distances 0.01")
    });
    table.case("precision", "ray-cast depth of a ball", On::Both, |on| {
        let (centre, radius) = (Vec3::ZERO, 0.4);
        let what =
            "of a voxel, seen below 60 degrees; chords of pixels and voxels over a curved surface";
        raycast(on, Shape::Sphere { centre, radius }, 1.0 / f64::from(radius), what)
    });
    for (name, side_views) in [("main view", 0), ("three views", 2)] {
        let name = format!("transfer of a furnished corner against f64, {name}");
        table.case("precision", name, On::Both, |on| transfer_of_a_corner(on, side_views));
    }
}

/// Every camera from a wide fish-eye's middle to a telescope, at depths from 1 mm to 1 km.
fn projection() -> Outcome {
    let mut worst = Found::new(0.0, 1.0, "");
    for (f, c) in [(1e-2, 0.5), (50.0, 31.5), (525.0, 319.5), (1e5, 1e4), (525.0, -1e5)] {
        let pinhole = Pinhole { width: 640, height: 480, fx: f, fy: f, cx: c, cy: c };
        let view = View::perspective(pinhole, Pose::identity());
        for (u, v) in [(0.0, 0.0), (319.25, 17.75), (639.0, 479.0)] {
            for depth_m in [1e-3f32, 0.4, 1.0, 8.0, 1e3] {
                let point = view.unproject(Vec2::new(u, v), depth_m);
                let exact = ray(&pinhole, u.into(), v.into()) * f64::from(depth_m);
                // one difference, one quotient, one product
                let unprojected = (point.as_dvec3() - exact).abs()
                    / exact.abs().max(DVec3::splat(f64::MIN_POSITIVE));
                let limit = 3.0 * ROUNDING;
                worst = worst.worse(Found::new(
                    unprojected.max_element() / limit,
                    1.0,
                    format!("of 3 roundings, unprojected: f {f}, depth {depth_m} m"),
                ));
                let Some(back) = view.project(point) else { return Err("behind".into()) };
                // a product, a quotient and a sum more, of offsets from the principal point
                let (offset, size) = (f64::from(u - c).abs(), f64::from(u).abs());
                let limit = ROUNDING * (5.0 * offset + size.max(offset) + f64::from(c).abs());
                worst = worst.worse(Found::new(
                    f64::from((back.x - u).abs()) / limit,
                    1.0,
                    format!("of its roundings, there and back: f {f}, c {c}, depth {depth_m} m"),
                ));
            }
        }
    }
    Ok(worst)
}

const WALL: Vec3 = Vec3::new(0.0, -0.96, 0.28);

fn volume_params() -> VolumeParams {
    VolumeParams { resolution: 64, color: false, ..VolumeParams::default() }
}

/// In front of the origin.
fn wall_view() -> View {
    View::perspective(camera(SIZE), look_at([0.1, -1.2, 0.15], [0.0, 0.0, 0.0]))
}

/// The picture of a scene whose depth is moved back by some metres.
fn seen(scene: &AnalyticScene, view: &View, back_m: f32) -> RgbdFrame {
    let depth_m = scene.render(view).depth_m;
    grey_frame(image(SIZE, |x, y| match depth_m[(x, y)] {
        d if d > 0.0 => d + back_m,
        _ => 0.0,
    }))
}

fn voxels(on: Device, frames: usize) -> Outcome {
    let (scene, view) =
        (AnalyticScene::new([Shape::Plane { normal: WALL, offset: 0.0 }]), wall_view());
    let pictures: Vec<_> = (0..frames).map(|k| seen(&scene, &view, 0.002 * k as f32)).collect();
    let mut map = Map::new(on, &volume_params())?;
    for picture in &pictures {
        map.integrate(picture, &view)?;
    }
    let volume = map.into_host()?;
    let truncation_m = f64::from(volume.truncation_m());
    // A place in the picture and its depth round by 1 um. A stored distance rounds by half a step, and at each
    // later frame by half a step more, of which its average keeps (n - 1) / n.
    let step_m = truncation_m / f64::from(i16::MAX);
    let bound = 1e-6 + step_m * 0.25 * (frames as f64 + 1.0);
    let (mut worst, mut compared) = (0.0f64, 0);
    for (at, exact_m) in averages(&volume, &view, &pictures) {
        let Some(voxel) = volume.voxel(at) else { return Err(format!("{at:?} was not seen")) };
        if usize::from(voxel.weight) != frames {
            return Err(format!("{at:?} has weight {}", voxel.weight));
        }
        worst = worst.max((f64::from(voxel.distance_m) - exact_m).abs());
        compared += 1;
    }
    if compared < 3000 {
        return Err(format!("only {compared} voxels to compare"));
    }
    Ok(Found::new(
        worst,
        bound,
        format!("m, of {compared} voxels; 1 um and {frames} roundings to 16 bits"),
    ))
}

/// The mean distance, in f64, of voxels that all pictures see within nine tenths of the truncation distance.
fn averages(volume: &TsdfVolume, view: &View, pictures: &[RgbdFrame]) -> Vec<([usize; 3], f64)> {
    let resolution = volume.params().resolution;
    let voxel_m = f64::from(volume.params().side_m) / resolution as f64;
    let first = volume.bounds().0.as_dvec3() + 0.5 * voxel_m;
    let truncation_m = f64::from(volume.truncation_m());
    let view_from_world = view.world_from_view.inverse();
    let camera = camera(SIZE);
    let mut found = Vec::new();
    for k in 0..resolution.pow(3) {
        let at = [k % resolution, k / resolution % resolution, k / resolution.pow(2)];
        let centre = first + voxel_m * DVec3::from(at.map(|v| v as f64));
        let p = view_from_world * nalgebra::Point3::new(centre.x, centre.y, centre.z);
        let u = f64::from(camera.fx) * p.x / p.z + f64::from(camera.cx);
        let v = f64::from(camera.fy) * p.y / p.z + f64::from(camera.cy);
        let distances: Option<Vec<f64>> = pictures
            .iter()
            .map(|picture| Some(bilinear(picture, u, v)? - p.z))
            .map(|distance| distance.filter(|d| d.abs() < 0.9 * truncation_m))
            .collect();
        if let Some(distances) = distances.filter(|_| p.z > 0.0) {
            found.push((at, distances.iter().sum::<f64>() / distances.len() as f64));
        }
    }
    found
}

/// Between four pixels that all have depth.
fn bilinear(picture: &RgbdFrame, u: f64, v: f64) -> Option<f64> {
    let (x, y) = (u.floor(), v.floor());
    let inside =
        x >= 0.0 && y >= 0.0 && x + 1.0 < SIZE.width as f64 && y + 1.0 < SIZE.height as f64;
    if !inside {
        return None;
    }
    let depth =
        |dx: usize, dy: usize| f64::from(picture.depth_m[(x as usize + dx, y as usize + dy)]);
    let taps = [depth(0, 0), depth(1, 0), depth(0, 1), depth(1, 1)];
    let (fx, fy) = (u - x, v - y);
    let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
    let value = mix(mix(taps[0], taps[1], fx), mix(taps[2], taps[3], fx), fy);
    taps.iter().all(|&d| d > 0.0).then_some(value)
}

/// The shape is of this curvature, 1/m. Seen at an angle of cosine c, depth has the second derivatives
/// `curvature / c^3` and `curvature / c`; linear interpolation over a square of side h, of pixels and then of voxels,
/// is off by up to `h^2 / 8` of both.
fn raycast(on: Device, shape: Shape, curvature_1_m: f64, what: &str) -> Outcome {
    let (scene, view) = (AnalyticScene::new([shape]), wall_view());
    let mut map = Map::new(on, &volume_params())?;
    map.integrate(&seen(&scene, &view, 0.0), &view)?;
    let out = map.raycast(&view)?;
    let exact = scene.render(&view);
    let voxel_m = f64::from(volume_params().side_m) / 64.0;
    let (mut worst, mut compared) = (Found::new(0.0, 1.0, what), 0);
    for (x, y) in inner_pixels() {
        let (found, expected) = (out.depth_m[(x, y)], exact.depth_m[(x, y)]);
        let cosine = f64::from(cosine_to_eye(&exact, x, y));
        if found > 0.0 && expected > 0.0 && cosine > 0.5 {
            let pixel_m = f64::from(expected / camera(SIZE).fx);
            let bend_1_m = curvature_1_m * (1.0 / cosine.powi(3) + 1.0 / cosine);
            let chords_m = (pixel_m.powi(2) + voxel_m.powi(2)) / 8.0 * bend_1_m;
            let error = f64::from(found - expected).abs() / voxel_m;
            worst = worst.worse(Found::new(error, 0.02 + chords_m / voxel_m, what));
            compared += 1;
        }
    }
    if compared < 300 {
        return Err(format!("only {compared} pixels to compare"));
    }
    Ok(worst)
}

/// A voxel away from the border, where averages lack pixels.
fn inner_pixels() -> impl Iterator<Item = (usize, usize)> {
    (3..SIZE.height - 3).flat_map(|y| (3..SIZE.width - 3).map(move |x| (x, y)))
}

fn cosine_to_eye(buffer: &GBuffer, x: usize, y: usize) -> f32 {
    let towards_eye = buffer.view.towards_eye(Vec2::new(x as f32, y as f32));
    let world = buffer.view.world_from_view_f32().transform_vector3(towards_eye);
    buffer.normals.at(x, y).dot(world)
}

fn transfer_of_a_corner(on: Device, side_views: usize) -> Outcome {
    let scene = AnalyticScene::corner();
    let main = scene.render(&corner_view(SIZE));
    let sides: Vec<GBuffer> = side_buffers(&scene)?.into_iter().take(side_views).collect();
    let params = TransferParams::default();
    let found = transfer(on, &params, &main, &sides)?;
    let oracle = TransferOracle::new(&params, &main, &sides)?;
    let (mut beyond, mut worst, mut hidden) = (0usize, 0.0f64, 0usize);
    // A place in a view rounds by 2^-22 m, the cosine of a surface at 5 cm by 1e-5, K by 1e-5 / chi = 1e-4, and a
    // direction has a fifth of all shares. A sample at the rim of a pixel or just at a depth limit falls to either
    // side, and then changes all 16 coefficients of its point.
    const TRANSFER_ROUNDING: f64 = 2e-5;
    const AT_A_RIM: f64 = 2e-3;
    for (x, y) in (0..SIZE.height).flat_map(|y| (0..SIZE.width).map(move |x| (x, y))) {
        let exact = oracle.at(x, y);
        hidden += usize::from(exact.hidden);
        for (a, b) in found.at(x, y).iter().zip(exact.coefficients) {
            let error = (f64::from(*a) - b).abs();
            match error > TRANSFER_ROUNDING {
                true => beyond += 1,
                false => worst = worst.max(error),
            }
        }
    }
    if hidden < 300 {
        return Err(format!("only {hidden} points have an occluder"));
    }
    let share = beyond as f64 / found.coefficients.len() as f64;
    let what = format!("share beyond 2e-5 (samples at a rim); the others {worst:.1e} at most");
    Ok(Found::new(share, AT_A_RIM, what))
}

/// From above and from the side, parallel.
fn side_buffers(scene: &AnalyticScene) -> Fallible<Vec<GBuffer>> {
    use kinlight::math::{Orthographic, Projection};
    let size = Size::new(48, 48);
    let projection = Projection::Orthographic(Orthographic {
        width: size.width,
        height: size.height,
        pixels_per_m: 24.0,
        cx: 23.5,
        cy: 23.5,
    });
    let poses =
        [look_at([0.05, -0.02, 2.0], [0.0, 0.0, 0.0]), look_at([1.9, 0.1, 0.5], [0.0, 0.0, 0.4])];
    Ok(poses.map(|world_from_view| scene.render(&View { projection, world_from_view })).into())
}
