//! Both backends on the same frames.

use super::*;
use crate::capture::RgbdFrame;
use crate::geometry::{GBuffer, Origin};
use crate::gpu::parity::Difference;
use crate::gpu::stages::test_support::{gpu, upload_frame};
use crate::image::Image;
use crate::lighting::{Batch, Rejection, Samples, Seen, ShLight};
use crate::math::color::srgb8_from_linear;
use crate::math::random::Rng;
use crate::transfer::test_support::{camera, desk, transferred};
use crate::transfer::{TransferMap, TransferParams};

/// A desk under a known light, with everything that makes a pixel useless.
struct Scene {
    frame: RgbdFrame,
    surface: GBuffer,
    transfer: TransferMap,
}

/// Ambient light and a lamp; `towards` need not be of unit length.
fn lamp(bands: usize, towards: Vec3, brightness: f32) -> ShLight {
    let lobe = sh::basis(towards.normalize(), bands);
    let coefficients = (0..sh::coefficients(bands))
        .map(|i| [brightness * (if i == 0 { 1.0 } else { 0.0 } + 0.4 * lobe[i]); 3])
        .collect();
    ShLight { bands, coefficients }
}

impl Scene {
    fn new((width, height): (usize, usize), bands: usize, step: usize, light: &ShLight) -> Self {
        let mut rng = Rng::new(&[9]);
        let mut surface = desk().render(&camera(width, height));
        let size = surface.size();
        let params = TransferParams { bands, subsampling: 1, directions: 16, ..Default::default() };
        let every_pixel = transferred(&params, &surface, &[]);
        let params = TransferParams { subsampling: step, ..params };
        let transfer = transferred(&params, &surface, &[]);
        let mut color = Image::new(size, [0.0; 3]);
        for k in 0..size.pixels() {
            let at = (k % width, k / width);
            let albedo = if at.0 / 9 % 2 == 0 { [0.8, 0.5, 0.4] } else { [0.4, 0.5, 0.7] };
            let row = every_pixel.at(at.0, at.1);
            let dot = |c: usize| -> f32 {
                row.iter().zip(&light.coefficients).map(|(t, light)| t * light[c]).sum()
            };
            color[at] =
                [0, 1, 2].map(|c| (albedo[c] * dot(c) * (0.98 + 0.04 * rng.uniform())).max(0.0));
            match (20.0 * rng.uniform()) as usize {
                0 => color[at] = [1.0; 3],
                1 => color[at] = [0.0; 3],
                2 => surface.origin[at] = Origin::Sensor,
                3 => surface.origin[at] = Origin::Virtual,
                4 => surface.depth_m[at] = 0.0,
                5 => color[at][1] = f32::NAN,
                6 => surface.normals.set(at.0, at.1, Vec3::new(f32::NAN, 0.0, 1.0)),
                _ => {}
            }
        }
        let codes = color.as_slice().iter().map(|c| c.map(srgb8_from_linear)).collect();
        let frame = RgbdFrame {
            color_srgb: Image::from_vec(size, codes),
            intensity: Image::new(size, 0.0),
            depth_m: Image::new(size, 0.0),
            color,
            ..RgbdFrame::default()
        };
        Self { frame, surface, transfer }
    }

    fn seen(&self) -> Seen<'_> {
        Seen { frame: &self.frame, surface: &self.surface, transfer: &self.transfer }
    }

    fn pass(&self, gpu: &Gpu, params: &LightParams) -> LightSamplesPass {
        let TransferMap { bands, step, .. } = self.transfer;
        LightSamplesPass::new(gpu, params, self.surface.size(), bands, step).unwrap()
    }

    fn run(&self, gpu: &Gpu, pass: &mut LightSamplesPass) {
        let mut surface = GpuGBuffer::empty(gpu, self.surface.view).unwrap();
        surface.upload(gpu, &self.surface);
        let TransferMap { bands, step, .. } = self.transfer;
        let transfer = GpuTransferMap::new(gpu, bands, step, self.surface.size()).unwrap();
        transfer.upload(gpu, &self.transfer);
        let mut commands = gpu.commands();
        let frame = upload_frame(gpu, &self.frame);
        pass.run(&mut commands, &frame, &surface, &transfer).unwrap();
        commands.submit().unwrap();
    }
}

fn batch() -> Batch {
    let mut batch = Batch::default();
    batch.clear();
    batch
}

#[test]
fn the_same_samples_are_picked() {
    let Some(gpu) = gpu() else { return };
    let every_pixel = LightParams { stride: 1, ..LightParams::default() };
    let sensor_too = LightParams { model_only: false, ..every_pixel.clone() };
    let cases = [
        ((160, 120), 4, 1, LightParams::default()),
        ((160, 120), 5, 1, sensor_too),
        ((67, 43), 3, 1, every_pixel.clone()),
        ((67, 43), 6, 2, LightParams { stride: 5, ..LightParams::default() }),
        ((67, 43), 1, 4, every_pixel.clone()),
        ((1, 1), 4, 1, every_pixel),
    ];
    for (size, bands, step, params) in cases {
        let scene = Scene::new(size, bands, step, &lamp(bands, Vec3::new(0.3, -0.5, 1.0), 1.0));
        let (mut samples, mut expected, mut found) = (Samples::default(), batch(), batch());
        let counts = samples.find(&scene.seen(), &params);
        samples.pick(&scene.seen(), 0.5, &mut expected);
        let mut pass = scene.pass(gpu, &params);
        scene.run(gpu, &mut pass);
        let picked = pass.take(gpu).unwrap().unwrap();
        picked.fill(0.5, &mut found);

        assert_eq!(picked.counts, counts);
        assert_eq!(found.count, expected.count);
        if size.0 > 1 {
            assert!(found.count > 50 && counts.saturated > 0 && counts.dark > 0, "{counts:?}");
        }
        assert!(size.0 < 160 || counts.used > 2 * samples_per_frame(bands), "a choice is made");
        for (a, b) in expected.packets.iter().zip(&found.packets) {
            assert_eq!((a.position, a.seen, a.class), (b.position, b.seen, b.class));
            assert_eq!((a.present, a.normal_bin), (b.present, b.normal_bin));
        }
        if found.count > 0 {
            let (a, b) = (expected.transfer.as_flattened(), found.transfer.as_flattened());
            // half a step, and the rounding of the division
            let difference = Difference::of(a, b, 0.501 / 32767.0);
            println!("{size:?} {bands} bands: {counts:?}, transfer {difference}");
            assert!(difference.is_within(0.0));
        }
    }
}

/// Frame after frame: the same light, a flash, and another light that stays.
#[test]
fn the_light_is_that_of_the_cpu_through_changes() {
    let Some(gpu) = gpu() else { return };
    let size = (160, 120);
    let params = LightParams::default();
    let (left, right) = (Vec3::new(-0.8, -0.5, 0.7), Vec3::new(0.8, -0.4, 0.8));
    let made = |towards, brightness| Scene::new(size, 4, 1, &lamp(4, towards, brightness));
    let (first, flash, second) = (made(left, 0.8), made(left, 1.3), made(right, 0.5));
    let frames = [&first, &first, &flash, &first, &second, &second, &second];
    let (mut cpu, mut with_gpu) = (LightEstimator::new(&params), LightEstimator::new(&params));
    let mut pass = first.pass(gpu, &params);
    let mut seen_rejections = 0;
    for (k, scene) in frames.into_iter().enumerate() {
        let expected = cpu.estimate(&scene.frame, &scene.surface, &scene.transfer, None);
        scene.run(gpu, &mut pass);
        let found = pass.estimate(gpu, &mut with_gpu, None).unwrap().unwrap();
        assert_eq!(found.rejection, expected.rejection, "frame {k}");
        assert_eq!((found.changed, found.pixels), (expected.changed, expected.pixels), "frame {k}");
        seen_rejections += usize::from(found.rejection == Some(Rejection::Unconfirmed));
        let [a, b] = [&expected, &found].map(|e| e.light.dominant_direction().unwrap());
        let angle = a.cross(b).length().atan2(a.dot(b)).to_degrees();
        println!("frame {k}: {angle:.5} degrees apart, {:?}", found.rejection);
        // Half a step of 2^-15 in each coefficient of transfer, a mean over a thousand samples of it: measured
        // 0.0042 in this scene.
        assert!(angle < 0.02, "frame {k}: {angle} degrees");
    }
    assert_eq!(seen_rejections, 2, "the flash, and the first frame of the second light");
    assert!(pass.estimate(gpu, &mut with_gpu, None).unwrap().is_none(), "no frame is left");
}
