//! Both backends on the same made input.

use super::*;
use crate::compositing::CompositingStage;
use crate::compositing::test_support::{
    Case, MEAN_ALBEDO, SIZE, all_params, ball, bare, light, shadow,
};
use crate::geometry::Origin;
use crate::gpu::parity::Difference;
use crate::gpu::stages::test_support::{gpu, upload_frame};
use crate::math::random::Rng;
use crate::parity::tolerances::COMPOSITING;
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
    for k in (3..size.pixels()).step_by(5) {
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
    // virtual pixels far from a virtual grid point
    for k in (11..size.pixels()).step_by(37) {
        case.merged.origin[(k % size.width, k / size.width)] = Origin::Virtual;
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
        *albedo = albedo.map(|a| 8.0 * a * rng.uniform());
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

fn on_cpu(case: &Case, params: &CompositingParams) -> Image<[u8; 3]> {
    let mut out = Image::default();
    CompositingStage::new(params).compose(&case.input(), &mut out);
    out
}

/// Codes are rounded: what lies between two may fall to either. And a pixel whose summed weight is near the
/// least one may take the nearest point in place of the mean.
fn assert_pictures_agree(cpu: &Image<[u8; 3]>, gpu: &Image<[u8; 3]>, name: &str) {
    let codes = |picture: &Image<[u8; 3]>| -> Vec<f32> {
        picture.as_slice().as_flattened().iter().map(|&code| f32::from(code)).collect()
    };
    let limit = COMPOSITING.software;
    let found = Difference::of(&codes(cpu), &codes(gpu), limit.largest);
    println!("{name}: {found}");
    assert!(found.is_within(limit.share), "{name}: {found}");
}

const STEPS: [usize; 3] = [1, 4, 8];

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

#[test]
fn pictures_agree() {
    each_case(|gpu, case, name| {
        let on_device = OnDevice::new(gpu, case);
        for antialias in [true, false] {
            for params in all_params() {
                let params = CompositingParams { antialias, ..params };
                let expected = on_cpu(case, &params);
                let pairs = expected.as_slice().iter().zip(case.frame.color_srgb.as_slice());
                let changed = pairs.filter(|(a, b)| a != b).count();
                // the ball and its shadow
                assert!(changed > 200 || case.merged.size() != SIZE, "{name}: {changed}");
                let found = on_device.compose(gpu, &params);
                assert_pictures_agree(&expected, &found, &format!("{name} {params:?}"));
            }
        }
    });
}

#[test]
fn the_exposure_of_many_points_agrees() {
    let Some(gpu) = gpu() else { return };
    let mut case = noisy_ball(Size::new(300, 270), 1, false);
    // the log-average takes every second of these points, and those are darker
    for k in (0..81_000).filter(|k| k % 300 % 2 == 0 && k / 300 % 2 == 0) {
        for map in [&mut case.real_transfer, &mut case.merged_transfer] {
            map.coefficients[16 * k..][..16].iter_mut().for_each(|t| *t *= 0.3);
        }
    }
    let params =
        CompositingParams { compositor: Compositor::Difference, ..CompositingParams::default() };
    let found = OnDevice::new(gpu, &case).compose(gpu, &params);
    assert_pictures_agree(&on_cpu(&case, &params), &found, "300x270");
}

/// Largest difference of R and R', which are below 2. Rounding of f32 at 1 is 6e-8. A dot product of 16 terms
/// is off by at most 16 of those, a weighted mean by 9 more. Weights only move the mean: the distance from the
/// tangent plane is a difference of terms up to 0.1 m at a depth of 1.5 m, so off by 2e-8 m; over the
/// tolerance of 0.03 m and to the fourth power that is 3e-6 of a weight, of 0.3 that neighbours differ by.
/// From visibility back to shading are four more operations.
const SHADING_TOLERANCE: f64 = 4e-6;

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
                let found = Difference::of(cpu, gpu, SHADING_TOLERANCE);
                println!("{name} {params:?} {which}: {found}");
                // near the least summed weight a pixel may take the nearest point in place of the mean
                assert!(found.is_within(1e-3), "{name} {params:?} {which}: {found}");
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

#[test]
fn a_used_pass_gives_what_a_new_one_gives() {
    let Some(gpu) = gpu() else { return };
    let cases = [
        noisy_ball(SIZE, 4, true),
        noisy_ball(SIZE, 4, false),
        bare(SIZE, 4),
        noisy_ball(SIZE, 4, true),
    ];
    for params in all_params() {
        let pass = CompositingPass::new(gpu, &params, SIZE, 4).unwrap();
        let out = GpuPicture::new(gpu, SIZE).unwrap();
        let mut read_back = PictureReadBack::new(gpu, SIZE).unwrap();
        for case in &cases {
            let on_device = OnDevice::new(gpu, case);
            let mut commands = gpu.commands();
            pass.run(&mut commands, &on_device.input(), &out).unwrap();
            read_back.request(&mut commands, &out);
            commands.submit().unwrap();
            let found = read_back.take(gpu).unwrap().unwrap();
            assert!(found == on_device.compose(gpu, &params), "{params:?}");
        }
    }
}

#[test]
fn broken_light_and_pictures_stay_in_bounds() {
    let Some(gpu) = gpu() else { return };
    let scaled = |factor: f32| {
        let coefficients = light().coefficients.iter().map(|c| c.map(|v| v * factor)).collect();
        ShLight { bands: 4, coefficients }
    };
    let lights = [
        ShLight::default(),
        ShLight { bands: 2, coefficients: vec![[0.3, 0.2, -0.9]; 4] },
        scaled(-1.0),
        scaled(f32::NAN),
        scaled(1e30),
        scaled(1e-30),
    ];
    let cases = STEPS.into_iter().flat_map(|step| [f32::INFINITY, 0.2].map(|red| (step, red)));
    for (step, red) in cases {
        let mut case = ball(Size::new(33, 21), step, shadow);
        case.set_bounce([red, f32::NAN, -1.0]);
        for (light, code) in lights.iter().flat_map(|light| [(light, 0), (light, 255)]) {
            case.light = light.clone();
            case.frame.color_srgb.fill([code; 3]);
            let on_device = OnDevice::new(gpu, &case);
            for params in all_params() {
                let name = format!("step {step}, bounce {red}, {light:?}, {params:?}");
                let pass = on_device.pass(gpu, &params);
                let buffers = pass.shading_buffers(gpu, &on_device.input()).unwrap();
                let all = buffers.real.as_slice().iter().chain(buffers.merged.as_slice());
                assert!(all.flatten().all(|v| v.is_finite()), "{name}");
                let found = on_device.compose(gpu, &params);
                // A black real pixel stays black: there is no albedo to light.
                for (x, y) in case.pixels().filter(|&(x, y)| !case.is_virtual(x, y)) {
                    assert!(code > 0 || found[(x, y)] == [0; 3], "{name}");
                }
                // The CPU's filters let the largest number of all overflow.
                if red.is_finite() {
                    assert_pictures_agree(&on_cpu(&case, &params), &found, &name);
                }
            }
        }
    }
}
