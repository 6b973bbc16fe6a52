//! Both backends on the same voxels, surfaces and objects.

use super::*;
use crate::capture::RgbdFrame;
use crate::fusion::{Lattice, TsdfVolume, VolumeParams};
use crate::geometry::GBuffer;
use crate::gpu::stages::test_support::{gpu, upload_frame};
use crate::image::Image;
use crate::parity::tolerances::{TRACED_MERGED_TRANSFER, TRACED_TRANSFER};
use crate::scene::Rasteriser;
use crate::transfer::test_support::{camera, desk, fence, look_at, perspective};
use crate::transfer::{RayTracedTransfer, TransferMap, TransferMethod};
use glam::Vec3;

/// A desk as a volume of 2 m on the device, and the same voxels on the CPU.
struct Room {
    on_device: GpuVolume,
    cpu: TsdfVolume,
}

impl Room {
    fn new(gpu: &Gpu, resolution: usize) -> Self {
        let params = VolumeParams { resolution, color: false, ..VolumeParams::default() };
        let lattice = Lattice::new(&params, Vec3::new(0.0, 0.0, 0.6)).unwrap();
        let mut on_device = GpuVolume::new(gpu, &params, lattice).unwrap();
        for eye in [[0.9, -1.3, 0.9], [-0.9, -1.2, 0.8], [0.3, -0.2, 2.0]] {
            let view = perspective(160, 120, look_at(eye.into(), Vec3::new(0.0, 0.1, 0.1)));
            let depth_m = desk().render(&view).depth_m;
            let frame = RgbdFrame {
                color_srgb: Image::new(view.size(), [0; 3]),
                color: Image::new(view.size(), [0.0; 3]),
                intensity: Image::new(view.size(), 0.0),
                depth_m,
                ..RgbdFrame::default()
            };
            let mut commands = gpu.commands();
            on_device.integrate(&mut commands, &upload_frame(gpu, &frame), 0, &view).unwrap();
            commands.submit().unwrap();
        }
        let cpu = on_device.download(gpu).unwrap();
        Self { on_device, cpu }
    }
}

/// What a camera sees, without and with objects.
struct Shot {
    real: GBuffer,
    merged: GBuffer,
    objects: VirtualScene,
}

impl Shot {
    fn new(view: View, objects: VirtualScene) -> Self {
        let real = desk().render(&view);
        let mut merged = GBuffer::empty(view);
        Rasteriser::default().draw(&objects, &real, &mut merged, &mut Default::default());
        Self { real, merged, objects }
    }

    /// Two fences, each with a model of its own.
    fn with_fences((width, height): (usize, usize)) -> Self {
        let mut objects = fence(Vec3::new(0.1, -0.4, 0.0));
        objects.objects.extend(fence(Vec3::new(-0.2, -0.5, 0.1)).objects);
        Self::new(camera(width, height), objects)
    }
}

/// Transfer of the real scene, and with objects.
type Transfers = [Vec<f32>; 2];

/// The stage on the device, with its buffers.
struct Stage<'g> {
    gpu: &'g Gpu,
    pass: TracedTransferPass,
    real: GpuTransferMap,
    merged: GpuTransferMap,
}

impl<'g> Stage<'g> {
    fn new(gpu: &'g Gpu, params: &TransferParams, room: &Room, size: Size) -> Self {
        let set = DirectionSet::new(params).unwrap();
        let pass = TracedTransferPass::new(gpu, params, &set, &room.on_device, size).unwrap();
        let (real, merged) = (pass.new_map(gpu).unwrap(), pass.new_map(gpu).unwrap());
        Self { gpu, pass, real, merged }
    }

    fn run(&mut self, room: &Room, shot: &Shot) -> Transfers {
        let [real, merged] = [&shot.real, &shot.merged].map(|buffer| {
            let mut out = GpuGBuffer::empty(self.gpu, buffer.view).unwrap();
            out.upload(self.gpu, buffer);
            out
        });
        for map in [&self.real, &self.merged] {
            // whatever was there before must not matter
            map.coefficients.upload(self.gpu, &vec![7.0; map.coefficients.len()]);
        }
        let mut commands = self.gpu.commands();
        self.pass.transfer(&mut commands, &room.on_device, &real, &self.real).unwrap();
        self.pass
            .transfer_with_virtual(
                &mut commands,
                &room.on_device,
                &shot.objects,
                (&real, &merged),
                &self.real,
                &self.merged,
            )
            .unwrap();
        commands.submit().unwrap();
        [&self.real, &self.merged].map(|map| map.coefficients.download(self.gpu).unwrap())
    }
}

fn on_device(gpu: &Gpu, params: &TransferParams, room: &Room, shot: &Shot) -> Transfers {
    Stage::new(gpu, params, room, shot.real.size()).run(room, shot)
}

fn on_cpu(params: &TransferParams, room: &Room, shot: &Shot) -> Transfers {
    let mut stage = RayTracedTransfer::new(params).unwrap();
    let (mut real, mut merged) = (TransferMap::default(), TransferMap::default());
    stage.transfer(&room.cpu, &shot.real, &mut real);
    let buffers = (&shot.real, &shot.merged);
    stage.transfer_with_virtual(&room.cpu, &shot.objects, buffers, &real, &mut merged);
    [real.coefficients, merged.coefficients]
}

fn params(bands: usize, directions: usize, subsampling: usize) -> TransferParams {
    let method = TransferMethod::RayTraced;
    TransferParams { method, bands, directions, subsampling, ..TransferParams::default() }
}

fn refined(params: TransferParams) -> TransferParams {
    TransferParams { refine: true, ..params }
}

fn cases() -> [((usize, usize), TransferParams); 8] {
    let short = TransferParams { ray_length_m: 0.15, ..params(4, 32, 1) };
    [
        ((67, 43), params(4, 32, 1)),
        ((67, 43), params(2, 70, 3)),
        ((67, 43), short.clone()),
        ((160, 120), refined(params(3, 32, 4))),
        ((67, 43), refined(TransferParams { subsampling: 5, ..short })),
        ((67, 43), refined(params(1, 33, 64))),
        ((1, 1), params(4, 32, 1)),
        ((1, 1), refined(params(2, 16, 4))),
    ]
}

#[test]
fn transfer_is_that_of_the_cpu() {
    let Some(gpu) = gpu() else { return };
    for resolution in [64, 128] {
        let room = Room::new(gpu, resolution);
        for (size, params) in cases() {
            let shot = Shot::with_fences(size);
            let expected = on_cpu(&params, &room, &shot);
            let found = on_device(gpu, &params, &room, &shot);
            for (what, cpu, found) in [
                (&TRACED_TRANSFER, &expected[0], &found[0]),
                (&TRACED_MERGED_TRANSFER, &expected[1], &found[1]),
            ] {
                let (difference, within) = what.compare(gpu, cpu, found);
                let what = what.stage;
                let TransferParams { bands, directions, subsampling, refine, .. } = params;
                let case = format!(
                    "{what}, {size:?}, {resolution} voxels, {bands} bands, {directions} directions, \
                     step {subsampling}, refine {refine}: {difference}"
                );
                println!("{case}");
                assert!(within, "{case}");
            }
            // there is something to compare
            assert!(size == (1, 1) || expected[0] != expected[1], "{size:?} {params:?}");
        }
    }
}

#[test]
fn rays_meet_what_they_meet_on_the_cpu() {
    let Some(gpu) = gpu() else { return };
    for (resolution, directions) in [(64, 100), (256, 32)] {
        let room = Room::new(gpu, resolution);
        let (params, shot) = (params(4, directions, 1), Shot::with_fences((67, 43)));
        let mut cpu = RayTracedTransfer::new(&params).unwrap();
        cpu.transfer(&room.cpu, &shot.real, &mut TransferMap::default());
        let mut stage = Stage::new(gpu, &params, &room, shot.real.size());
        stage.run(&room, &shot);
        let found = stage.pass.level.real.hits.download(gpu).unwrap();
        let (points, words) = (shot.real.size().pixels(), directions.div_ceil(32));
        let mut counts = [0, 0];
        for (at, bits) in cpu.hits().iter().enumerate() {
            let other = found[at % words * points + at / words];
            counts[0] += bits.count_ones();
            counts[1] += (bits ^ other).count_ones();
        }
        let [hits, differ] = counts;
        println!("{resolution} voxels: {differ} of {hits} rays that are stopped differ");
        assert!(hits as usize > points / 2, "{hits}");
        let few = TRACED_TRANSFER.on(gpu).share;
        assert!(f64::from(differ) <= few * f64::from(hits), "{differ} of {hits}");
    }
}

#[test]
fn without_objects_in_reach_the_real_pass_is_copied() {
    let Some(gpu) = gpu() else { return };
    let room = Room::new(gpu, 64);
    for objects in [VirtualScene::default(), fence(Vec3::new(30.0, 0.0, 0.0))] {
        let shot = Shot::new(camera(67, 43), objects);
        for params in [params(4, 32, 1), refined(params(4, 32, 4))] {
            let [real, merged] = on_device(gpu, &params, &room, &shot);
            assert!(real.iter().any(|&c| c != 0.0));
            assert_eq!(real, merged);
        }
    }
}

#[test]
fn hits_of_the_real_pass_are_used_again_and_the_bits_are_those_of_a_whole_pass() {
    let Some(gpu) = gpu() else { return };
    let room = Room::new(gpu, 64);
    let shot = Shot::with_fences((67, 43));
    for params in [params(4, 32, 1), refined(params(4, 32, 4))] {
        let [_, merged] = on_device(gpu, &params, &room, &shot);
        // the real buffer knows nothing, so every point is traced anew
        let real = GBuffer::empty(shot.real.view);
        let whole = Shot { real, merged: shot.merged.clone(), objects: shot.objects.clone() };
        let [nothing, anew] = on_device(gpu, &params, &room, &whole);
        assert!(nothing.iter().all(|&c| c == 0.0));
        assert_eq!(merged, anew);
    }
}

#[test]
fn objects_come_move_and_go() {
    let Some(gpu) = gpu() else { return };
    let room = Room::new(gpu, 64);
    let params = refined(params(2, 32, 4));
    let first = fence(Vec3::new(0.1, -0.4, 0.0));
    let mut both = first.clone();
    both.objects.insert(0, fence(Vec3::new(-0.2, -0.5, 0.1)).objects.remove(0));
    // the same model twice
    let twin = first.objects[0].clone();
    let mut three = both.clone();
    three.objects.push(twin);
    let mut stage = Stage::new(gpu, &params, &room, camera(67, 43).size());
    for objects in [first, three, VirtualScene::default(), both] {
        let shot = Shot::new(camera(67, 43), objects);
        let [_, expected] = on_cpu(&params, &room, &shot);
        let [_, found] = stage.run(&room, &shot);
        let (difference, within) = TRACED_MERGED_TRANSFER.compare(gpu, &expected, &found);
        assert!(within, "{difference}");
    }
}

#[test]
fn broken_pixels_have_no_transfer_and_far_ones_see_the_sky() {
    let Some(gpu) = gpu() else { return };
    let room = Room::new(gpu, 64);
    let mut shot = Shot::with_fences((67, 43));
    let bad = [f32::NAN, f32::INFINITY, -1.0, f32::MIN_POSITIVE, 1e30, f32::NEG_INFINITY];
    for buffer in [&mut shot.real, &mut shot.merged] {
        for k in 0..300 {
            let (x, y) = (k * 7 % 67, k * 13 % 43);
            match k % 3 {
                0 => buffer.depth_m[(x, y)] = bad[k % 6],
                1 => buffer.normals.x[(x, y)] = bad[k % 6],
                _ => buffer.normals.set(x, y, Vec3::ZERO),
            }
        }
    }
    for params in [params(3, 32, 1), refined(params(3, 32, 4))] {
        let expected = on_cpu(&params, &room, &shot);
        let found = on_device(gpu, &params, &room, &shot);
        for (cpu, found) in expected.iter().zip(&found) {
            let (difference, within) = TRACED_TRANSFER.compare(gpu, cpu, found);
            assert!(within, "{difference}");
        }
    }
}

#[test]
fn a_picture_without_pixels_is_no_trouble() {
    let Some(gpu) = gpu() else { return };
    let room = Room::new(gpu, 8);
    let view = perspective(0, 0, crate::math::Pose::identity());
    let empty = || GBuffer::empty(view);
    let shot = Shot { real: empty(), merged: empty(), objects: fence(Vec3::ZERO) };
    let set = refined(params(2, 16, 4));
    let mut stage = Stage::new(gpu, &set, &room, view.size());
    assert_eq!(stage.pass.image.pixels(), 0);
    stage.run(&room, &shot);
}
