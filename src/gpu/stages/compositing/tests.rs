//! Both backends on the same made input.

use super::*;
use crate::compositing::CompositingStage;
use crate::compositing::test_support::{Case, MEAN_ALBEDO, SIZE, all_params, ball, bare, shadow};
use crate::geometry::Origin;
use crate::gpu::parity::Difference;
use crate::gpu::stages::test_support::{gpu, upload_frame};
use crate::math::random::Rng;
use crate::transfer::IndirectMap;

/// A case on the device.
struct OnDevice {
    frame: FramePictures,
    merged: GpuGBuffer,
    layer: GpuVirtualLayer,
    real_transfer: GpuTransferMap,
    merged_transfer: GpuTransferMap,
    indirect: Option<GpuIndirectMap>,
    light: ShLight,
    step: usize,
}

impl OnDevice {
    fn new(gpu: &Gpu, case: &Case) -> Self {
        let (size, step) = (case.merged.size(), case.real_transfer.step);
        let mut frame = case.frame.clone();
        frame.color = Image::new(size, [0.0; 3]);
        frame.intensity = Image::new(size, 0.0);
        frame.depth_m = Image::new(size, 0.0);
        let mut merged = GpuGBuffer::empty(gpu, case.merged.view).unwrap();
        merged.upload(gpu, &case.merged);
        let layer = GpuVirtualLayer::empty(gpu, size).unwrap();
        layer.upload(gpu, &case.layer);
        let transfer = |map| {
            let on_device = GpuTransferMap::new(gpu, 4, step, size).unwrap();
            on_device.upload(gpu, map);
            on_device
        };
        let indirect = case.indirect.as_ref().map(|map| {
            let on_device = GpuIndirectMap::new(gpu, step, size).unwrap();
            on_device.upload(gpu, map);
            on_device
        });
        Self {
            frame: upload_frame(gpu, &frame),
            merged,
            layer,
            real_transfer: transfer(&case.real_transfer),
            merged_transfer: transfer(&case.merged_transfer),
            indirect,
            light: case.light.clone(),
            step,
        }
    }

    fn input(&self) -> GpuComposeInput<'_> {
        GpuComposeInput {
            frame: &self.frame,
            merged: &self.merged,
            layer: &self.layer,
            real_transfer: &self.real_transfer,
            merged_transfer: &self.merged_transfer,
            indirect: self.indirect.as_ref(),
            light: &self.light,
            mean_albedo: MEAN_ALBEDO,
        }
    }

    fn pass(&self, gpu: &Gpu, params: &CompositingParams) -> CompositingPass {
        CompositingPass::new(gpu, params, self.merged.size(), self.step).unwrap()
    }

    fn compose(&self, gpu: &Gpu, params: &CompositingParams) -> Image<[u8; 3]> {
        let out = GpuPicture::new(gpu, self.merged.size()).unwrap();
        let mut read_back = PictureReadBack::new(gpu, self.merged.size()).unwrap();
        let mut commands = gpu.commands();
        self.pass(gpu, params).run(&mut commands, &self.input(), &out).unwrap();
        read_back.request(&mut commands, &out);
        commands.submit().unwrap();
        read_back.take(gpu).unwrap().unwrap()
    }
}

fn random_picture(case: &mut Case, rng: &mut Rng) {
    for pixel in case.frame.color_srgb.as_mut_slice() {
        *pixel = std::array::from_fn(|_| rng.next_u32() as u8);
    }
}

/// Holes, and surfaces without a normal.
fn damage(case: &mut Case) {
    let size = case.merged.size();
    for k in (3..size.pixels()).step_by(41) {
        let (x, y) = (k % size.width, k / size.width);
        if k % 3 == 0 {
            case.merged.normals.set(x, y, glam::Vec3::ZERO);
        } else if case.merged.origin[(x, y)] != Origin::Virtual {
            case.merged.depth_m[(x, y)] = 0.0;
            case.merged.normals.set(x, y, glam::Vec3::ZERO);
            case.merged.origin[(x, y)] = Origin::None;
        }
    }
}

/// A ball in coloured light with a noisy shadow and soft edges, in front of a random picture.
fn noisy_ball(size: Size, step: usize, has_bounce: bool) -> Case {
    let mut rng = Rng::new(&[size.width as u32, step as u32]);
    let mut case = ball(size, step, shadow);
    random_picture(&mut case, &mut rng);
    for rgb in &mut case.light.coefficients {
        *rgb = [rgb[0], 0.8 * rgb[1], 0.6 * rgb[2] + 0.02 * rng.normal()];
    }
    let pairs = case.real_transfer.coefficients.iter_mut();
    for (real, merged) in pairs.zip(&mut case.merged_transfer.coefficients) {
        let noise = 0.02 * rng.normal();
        let jitter = if *real == *merged { 0.0 } else { 0.02 * rng.normal() };
        *real += noise;
        *merged += noise + jitter;
    }
    let origin = case.merged.origin.clone();
    let is_virtual = |x: usize, y: usize| origin[(x, y)] == Origin::Virtual;
    for (x, y) in case.pixels() {
        let left = is_virtual(x.saturating_sub(1), y);
        let below = is_virtual(x, (y + 1).min(size.height - 1));
        if is_virtual(x, y) != left || is_virtual(x, y) != below {
            case.layer.coverage[(x, y)] = rng.uniform();
        }
    }
    for albedo in case.layer.albedo.as_mut_slice() {
        // so bright that some pixels are compressed
        *albedo = albedo.map(|a| 2.5 * a * rng.uniform());
    }
    if has_bounce {
        let grid = case.real_transfer.grid;
        let special = [[f32::NAN, -1.0, 0.1], [0.0; 3], [0.0; 3], [0.0; 3]];
        let rgb = (0..grid.pixels()).map(|k| match special.get(k % 8) {
            Some(&special) => special,
            None => [0.05, 0.03, 0.02].map(|b| b * rng.uniform()),
        });
        case.indirect = Some(IndirectMap { step, grid, rgb: rgb.collect() });
    }
    damage(&mut case);
    case
}

fn codes(picture: &Image<[u8; 3]>) -> Vec<f32> {
    picture.as_slice().as_flattened().iter().map(|&code| f32::from(code)).collect()
}

fn each_case(mut check: impl FnMut(&Gpu, &Case, &str)) {
    let Some(gpu) = gpu() else { return };
    for (width, height) in [(67, 43), (1, 1), (1, 9), (5, 3)] {
        for step in STEPS {
            for has_bounce in [false, true] {
                let case = noisy_ball(Size::new(width, height), step, has_bounce);
                check(gpu, &case, &format!("{width}x{height}, step {step}, bounce {has_bounce}"));
            }
        }
    }
}

const STEPS: [usize; 2] = [1, 4];

#[test]
fn pictures_agree() {
    each_case(|gpu, case, name| {
        let on_device = OnDevice::new(gpu, case);
        for antialias in [true, false] {
            for params in all_params() {
                let params = CompositingParams { antialias, ..params };
                let mut expected = Image::default();
                CompositingStage::new(&params).compose(&case.input(), &mut expected);
                let found = on_device.compose(gpu, &params);
                // codes are rounded: what lies between two may fall to either
                let found = Difference::of(&codes(&expected), &codes(&found), 1.0);
                println!("{name} {params:?}: {found}");
                assert!(found.is_within(1e-3), "{name} {params:?}: {found}");
            }
        }
    });
}

#[test]
fn shading_agrees() {
    each_case(|gpu, case, name| {
        let on_device = OnDevice::new(gpu, case);
        for params in all_params() {
            let expected = CompositingStage::new(&params).shading_buffers(&case.input());
            let pass = on_device.pass(gpu, &params);
            let found = pass.shading_buffers(gpu, &on_device.input()).unwrap();
            for (which, cpu, gpu) in
                [("R", &expected.real, &found.real), ("R'", &expected.merged, &found.merged)]
            {
                let (cpu, gpu) = (cpu.as_slice().as_flattened(), gpu.as_slice().as_flattened());
                let found = Difference::of(cpu, gpu, 5e-6);
                println!("{name} {params:?} {which}: {found}");
                assert!(found.is_within(0.0), "{name} {params:?} {which}: {found}");
            }
        }
    });
}

#[test]
fn without_objects_the_picture_is_the_recorded_one_byte_for_byte() {
    let Some(gpu) = gpu() else { return };
    let mut rng = Rng::new(&[9]);
    for size in [SIZE, Size::new(1, 1), Size::new(2, 1), Size::new(7, 3)] {
        for step in STEPS {
            let mut case = bare(size, step);
            random_picture(&mut case, &mut rng);
            for t in &mut case.real_transfer.coefficients {
                *t += 0.2 * rng.normal();
            }
            case.merged_transfer = case.real_transfer.clone();
            damage(&mut case);
            for has_bounce in [false, true] {
                if has_bounce {
                    case.set_bounce([0.0; 3]);
                }
                let on_device = OnDevice::new(gpu, &case);
                for params in all_params() {
                    let found = on_device.compose(gpu, &params);
                    assert!(found == case.frame.color_srgb, "{size}, step {step}, {params:?}");
                }
            }
        }
    }
}
