//! Both backends on the same scenes.

use super::*;
use crate::geometry::{GBuffer, Origin};
use crate::gpu::GpuGBuffer;
use crate::gpu::stages::test_support::gpu;
use crate::image::Image;
use crate::math::View;
use crate::math::random::Rng;
use crate::parity::tolerances::{BOUNCE, MERGED_TRANSFER, TRANSFER, Tolerance};
use crate::parity::upload;
use crate::scene::analytic::{AnalyticScene, Shape};
use crate::transfer::test_support::{auxiliary_views, camera, desk, stage, transferred};
use crate::transfer::{Buffers, IndirectMap, TransferMap};
use glam::Vec3;

/// A scene, and the same with a ball, whose surfaces are virtual.
struct Scene {
    real: (GBuffer, Vec<GBuffer>),
    merged: (GBuffer, Vec<GBuffer>),
    radiance: (Image<[f32; 3]>, Vec<Image<[f32; 3]>>),
}

impl Scene {
    fn new((width, height): (usize, usize), side_views: usize) -> Self {
        let centre = Vec3::new(0.15, -0.5, 0.1);
        Self::with_object((width, height), side_views, Shape::Sphere { centre, radius: 0.08 })
    }

    fn with_object((width, height): (usize, usize), side_views: usize, object: Shape) -> Self {
        let mut rng = Rng::new(&[5, width as u32]);
        let views = auxiliary_views(48);
        let main = rendered(&camera(width, height), object, &mut rng);
        let auxiliary: Vec<_> =
            views[..side_views].iter().map(|v| rendered(v, object, &mut rng)).collect();
        let mut light = |buffer: &GBuffer| {
            let values = (0..buffer.size().pixels()).map(|_| [0; 3].map(|_| rng.uniform()));
            Image::from_vec(buffer.size(), values.collect())
        };
        Self {
            radiance: (light(&main.0), auxiliary.iter().map(|(real, _)| light(real)).collect()),
            real: (main.0, auxiliary.iter().map(|(real, _)| real.clone()).collect()),
            merged: (main.1, auxiliary.into_iter().map(|(_, merged)| merged).collect()),
        }
    }

    fn real(&self) -> Buffers<'_> {
        (&self.real.0, &self.real.1)
    }

    fn merged(&self) -> Buffers<'_> {
        (&self.merged.0, &self.merged.1)
    }
}

/// Without and with the object. Depth is noisy, missing here and there, and some surfaces have no normal.
fn rendered(view: &View, object: Shape, rng: &mut Rng) -> (GBuffer, GBuffer) {
    let mut with_object = desk();
    with_object.shapes.push(object);
    let object = AnalyticScene::new([object]);
    let (mut real, drawn) = (desk().render(view), with_object.render(view));
    let alone = object.render(view);
    for k in 0..view.size().pixels() {
        let at = (k % view.size().width, k / view.size().width);
        match rng.uniform() {
            v if v < 0.05 => {
                real.depth_m[at] = 0.0;
                real.normals.set(at.0, at.1, Vec3::ZERO);
                real.origin[at] = Origin::None;
            }
            v if v < 0.1 => real.normals.set(at.0, at.1, Vec3::ZERO),
            v => real.depth_m[at] *= 1.0 + 0.004 * (v - 0.5),
        }
    }
    let mut merged = real.clone();
    for k in 0..view.size().pixels() {
        let at = (k % view.size().width, k / view.size().width);
        if drawn.depth_m[at] > 0.0 && drawn.depth_m[at] == alone.depth_m[at] {
            merged.depth_m[at] = drawn.depth_m[at];
            merged.normals.set(at.0, at.1, drawn.normals.at(at.0, at.1));
            merged.origin[at] = Origin::Virtual;
        }
    }
    (real, merged)
}

fn uploaded_all(gpu: &Gpu, (main, auxiliary): Buffers) -> (GpuGBuffer, Vec<GpuGBuffer>) {
    (upload::buffer(gpu, main).unwrap(), upload::buffers(gpu, auxiliary).unwrap())
}

/// Transfer of the real scene, transfer with virtual surfaces, and the bounce.
struct Results {
    real: Vec<f32>,
    merged: Vec<f32>,
    indirect: Vec<f32>,
}

fn on_device(gpu: &Gpu, params: &TransferParams, scene: &Scene, with_radiance: bool) -> Results {
    let (main, auxiliary) = uploaded_all(gpu, scene.real());
    let (merged_main, merged_auxiliary) = uploaded_all(gpu, scene.merged());
    let (light, lights) = upload::radiance(gpu, (&scene.radiance.0, &scene.radiance.1)).unwrap();
    let radiance = with_radiance.then_some((&light, &lights[..]));
    let set = DirectionSet::new(params).unwrap();
    let mut pass = TransferPass::new(gpu, params, &BounceParams::default(), &set).unwrap();
    let map =
        || GpuTransferMap::new(gpu, params.bands, params.subsampling, scene.real.0.size()).unwrap();
    let (real, merged) = (map(), map());
    let indirect = GpuIndirectMap::new(gpu, params.subsampling, scene.real.0.size()).unwrap();
    // whatever was there before must not matter
    merged.coefficients.upload(gpu, &vec![7.0; merged.coefficients.len()]);
    indirect.light.upload(gpu, &vec![[7.0; 4]; indirect.light.len()]);
    let mut commands = gpu.commands();
    pass.transfer(&mut commands, (&main, &auxiliary), &real).unwrap();
    let buffers = (&merged_main, &merged_auxiliary[..]);
    pass.transfer_and_bounce(&mut commands, buffers, radiance, &real, &merged, &indirect).unwrap();
    commands.submit().unwrap();
    Results {
        real: real.coefficients.download(gpu).unwrap(),
        merged: merged.coefficients.download(gpu).unwrap(),
        indirect: flat(indirect.light.download(gpu).unwrap().iter().map(|&[r, g, b, _]| [r, g, b])),
    }
}

fn on_cpu(params: &TransferParams, scene: &Scene, with_radiance: bool) -> Results {
    let (mut real, mut merged) = (TransferMap::default(), TransferMap::default());
    let mut indirect = IndirectMap::default();
    let mut stage = stage(params);
    stage.transfer(scene.real().0, scene.real().1, &mut real);
    let radiance = with_radiance.then_some((&scene.radiance.0, &scene.radiance.1[..]));
    let buffers = (scene.real(), scene.merged());
    stage.transfer_and_bounce(buffers.0, buffers.1, radiance, &real, &mut merged, &mut indirect);
    Results {
        real: real.coefficients,
        merged: merged.coefficients,
        indirect: flat(indirect.rgb.into_iter()),
    }
}

fn flat(rgb: impl Iterator<Item = [f32; 3]>) -> Vec<f32> {
    rgb.flatten().collect()
}

fn params(bands: usize, directions: usize, subsampling: usize) -> TransferParams {
    TransferParams { bands, directions, subsampling, ..TransferParams::default() }
}

fn cases() -> [((usize, usize), usize, TransferParams); 8] {
    let sparse = TransferParams { samples: 1, jitter_tile: 3, ..params(6, 16, 2) };
    [
        ((67, 43), 4, params(4, 32, 1)),
        ((67, 43), 3, params(2, 64, 1)),
        ((160, 120), 4, params(4, 16, 4)),
        ((67, 43), 0, params(3, 32, 4)),
        ((67, 43), 1, params(5, 32, 4)),
        ((67, 43), 2, sparse),
        ((1, 1), 4, params(4, 32, 1)),
        ((5, 2), 0, params(1, 32, 4)),
    ]
}

/// Also says how far apart they are.
fn assert_near(
    device: &Gpu,
    what: &Tolerance,
    cpu: &[f32],
    gpu: &[f32],
    case: &((usize, usize), usize, TransferParams),
) {
    let ((width, height), side_views, TransferParams { bands, directions, subsampling, .. }) = case;
    let (found, within) = what.compare(device, cpu, gpu);
    let what = what.quantity;
    let case = format!(
        "{what}, {width}x{height}, {side_views} side views, {bands} bands, {directions} directions, \
         step {subsampling}: {found}"
    );
    println!("{case}");
    assert!(within, "{case}");
}

#[test]
fn transfer_and_bounce_are_those_of_the_cpu() {
    let Some(device) = gpu() else { return };
    for case in cases() {
        let (size, side_views, params) = &case;
        let scene = Scene::new(*size, *side_views);
        let (cpu, gpu) = (on_cpu(params, &scene, true), on_device(device, params, &scene, true));
        assert_near(device, &TRANSFER, &cpu.real, &gpu.real, &case);
        assert_near(device, &MERGED_TRANSFER, &cpu.merged, &gpu.merged, &case);
        assert_near(device, &BOUNCE, &cpu.indirect, &gpu.indirect, &case);
        if size.0 > 5 {
            // there is something to compare
            assert!(cpu.merged != cpu.real, "{case:?}");
            assert!(cpu.indirect.iter().any(|&light| light > 0.01), "{case:?}");
        }
    }
}

#[test]
fn without_virtual_pixels_transfer_is_copied_and_nothing_bounces() {
    let Some(gpu) = gpu() else { return };
    let far_away = Shape::Sphere { centre: Vec3::new(0.0, -9.0, 0.0), radius: 0.1 };
    let scene = Scene::with_object((67, 43), 2, far_away);
    assert_eq!(scene.real.0.origin, scene.merged.0.origin);
    let found = on_device(gpu, &params(4, 32, 1), &scene, true);
    assert_eq!(found.real, found.merged);
    assert!(found.indirect.iter().all(|&light| light == 0.0));
}

#[test]
fn without_radiance_there_is_no_bounce_but_transfer() {
    let Some(gpu) = gpu() else { return };
    let scene = Scene::new((67, 43), 2);
    let with = on_device(gpu, &params(4, 32, 2), &scene, true);
    let without = on_device(gpu, &params(4, 32, 2), &scene, false);
    assert_eq!(with.merged, without.merged);
    assert!(without.indirect.iter().all(|&light| light == 0.0));
}

#[test]
fn an_object_that_fills_the_view_is_no_trouble() {
    let Some(device) = gpu() else { return };
    // the camera is at (0.9, -1.3, 0.9), in front of it a wall
    let wall = Shape::Sphere { centre: Vec3::new(0.6, -0.85, 0.6), radius: 0.3 };
    let case = ((67, 43), 2, params(4, 32, 2));
    let scene = Scene::with_object(case.0, case.1, wall);
    let (cpu, gpu) = (on_cpu(&case.2, &scene, true), on_device(device, &case.2, &scene, true));
    assert_near(device, &MERGED_TRANSFER, &cpu.merged, &gpu.merged, &case);
    assert_near(device, &BOUNCE, &cpu.indirect, &gpu.indirect, &case);
}

#[test]
fn numbers_that_are_none_hide_nothing_and_have_no_transfer() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene::new((67, 43), 1);
    for buffer in [&mut scene.real.0, &mut scene.real.1[0]] {
        for (k, value) in [f32::NAN, f32::INFINITY, -1.0, 1e30].into_iter().enumerate() {
            buffer.depth_m[(3 + 5 * k, 20)] = value;
        }
        for (k, value) in [f32::NAN, f32::INFINITY, -1.0, 1e20].into_iter().enumerate() {
            buffer.normals.set(3 + 5 * k, 30, Vec3::new(value, 0.3, 0.1));
        }
    }
    let params = params(4, 32, 1);
    let cpu = transferred(&params, &scene.real.0, &scene.real.1).coefficients;
    let found = on_device(gpu, &params, &scene, false).real;
    assert!(found.iter().all(|value| value.is_finite()));
    assert_near(gpu, &TRANSFER, &cpu, &found, &((67, 43), 1, params));
}
