//! The same scenes through both rasterisers.

mod scenes;

use super::models::Vertex;
use super::*;
use crate::compositing::VirtualLayer;
use crate::geometry::GBuffer;
use crate::gpu::StageTimer;
use crate::gpu::pipeline::compare_struct;
use crate::gpu::stages::test_support::gpu;
use crate::image::Image;
use crate::parity::tolerances::{RASTER_COLOR, RASTER_DEPTH, RASTER_NORMAL, RASTER_ORIGIN};
use crate::scene::raster::tests::{at, cuboid, moved, ortho, pinhole, sphere, wall};
use crate::scene::{Model, Placement, Rasteriser, SurfaceAnchor, VirtualObject};
use glam::{Vec2, Vec3};
use std::sync::Arc;

const SIZES: [(usize, usize); 3] = [(67, 43), (160, 120), (1, 1)];

struct Picture {
    merged: GBuffer,
    layer: VirtualLayer,
}

fn on_cpu(scene: &VirtualScene, real: &GBuffer) -> Picture {
    let (mut merged, mut layer) = (GBuffer::empty(real.view), VirtualLayer::default());
    Rasteriser::default().draw(scene, real, &mut merged, &mut layer);
    Picture { merged, layer }
}

/// A view on the device.
struct OnDevice {
    real: GpuGBuffer,
    merged: GpuGBuffer,
    layer: GpuVirtualLayer,
}

impl OnDevice {
    /// What is drawn into is full of wrong values.
    fn new(gpu: &Gpu, from: &GBuffer) -> Self {
        let mut real = GpuGBuffer::empty(gpu, from.view).unwrap();
        real.upload(gpu, from);
        let merged = GpuGBuffer::empty(gpu, from.view).unwrap();
        let layer = GpuVirtualLayer::empty(gpu, from.size()).unwrap();
        let wrong = Image::new(from.size(), [7.7; 4]);
        merged.surface.upload(gpu, &wrong);
        merged.origin.upload(gpu, &Image::new(from.size(), 3));
        layer.texels.upload(gpu, &wrong);
        Self { real, merged, layer }
    }

    fn draw(
        &mut self,
        commands: &mut Commands<'_>,
        pass: &mut RasterPass,
        view: usize,
        scene: &VirtualScene,
    ) -> Drawn {
        let out = (&mut self.merged, &self.layer);
        pass.draw(commands, view, scene, &self.real, out).unwrap()
    }

    fn download(&self, gpu: &Gpu) -> Picture {
        let size = self.merged.size();
        let texels = self.layer.texels.buffer().download(gpu).unwrap();
        let albedo = texels.iter().map(|&[r, g, b, _]| [r, g, b]).collect();
        let coverage = texels.iter().map(|&[.., coverage]| coverage).collect();
        let layer = VirtualLayer {
            albedo: Image::from_vec(size, albedo),
            coverage: Image::from_vec(size, coverage),
        };
        Picture { merged: self.merged.download(gpu).unwrap(), layer }
    }
}

fn on_gpu(gpu: &Gpu, pass: &mut RasterPass, scene: &VirtualScene, real: &GBuffer) -> Picture {
    let mut on_device = OnDevice::new(gpu, real);
    let mut commands = gpu.commands();
    on_device.draw(&mut commands, pass, 0, scene);
    commands.submit().unwrap();
    on_device.download(gpu)
}

fn same(a: &GBuffer, b: &GBuffer) -> bool {
    a.view == b.view && a.depth_m == b.depth_m && a.normals == b.normals && a.origin == b.origin
}

/// Whatever is no number differs.
fn differ(a: f32, b: f32, tolerance: f32) -> bool {
    let difference = (a - b).abs();
    difference.is_nan() || difference > tolerance
}

/// Pixels that differ.
#[derive(Clone, Copy, Debug, Default)]
struct Count {
    pixels: usize,
    /// Pixels that the CPU covers.
    covered: usize,
    /// Another origin, depth or normal at the centre.
    surfaces: usize,
    /// Another number of visible samples, and those where it is not just one.
    coverage: usize,
    coverage_far: usize,
    colors: usize,
    /// Largest differences of those that count as equal, metres and unit vectors.
    depth_m: f32,
    normal: f32,
}

impl Count {
    fn of(cpu: &Picture, gpu: &Picture) -> Self {
        let mut count = Self { pixels: cpu.merged.size().pixels(), ..Self::default() };
        let size = cpu.merged.size();
        let [most_m, most_normal, most_color] =
            [&RASTER_DEPTH, &RASTER_NORMAL, &RASTER_COLOR].map(|t| t.software.largest as f32);
        for at in (0..size.height).flat_map(|y| (0..size.width).map(move |x| (x, y))) {
            let normal = |p: &Picture| p.merged.normals.at(at.0, at.1);
            let depth_m = (cpu.merged.depth_m[at] - gpu.merged.depth_m[at]).abs();
            let normal = (normal(cpu) - normal(gpu)).length();
            let same_origin = cpu.merged.origin[at] == gpu.merged.origin[at];
            if same_origin && depth_m <= most_m && normal <= most_normal {
                count.depth_m = count.depth_m.max(depth_m);
                count.normal = count.normal.max(normal);
            } else {
                count.surfaces += 1;
            }
            let (a, b) = (cpu.layer.coverage[at], gpu.layer.coverage[at]);
            count.covered += usize::from(a > 0.0);
            count.coverage += usize::from(a != b);
            count.coverage_far += usize::from(differ(a, b, 1.0 / 8.0));
            let [cpu, gpu] = [cpu, gpu].map(|p| p.layer.albedo[at]);
            let other = (0..3).any(|c| differ(cpu[c], gpu[c], most_color));
            count.colors += usize::from(a > 0.0 && b > 0.0 && other);
        }
        count
    }

    /// And where coverage differs, by one sample.
    fn check(&self, name: &str) {
        let few = (self.pixels as f64 * RASTER_ORIGIN.software.share) as usize;
        assert!(self.surfaces <= few && self.colors <= few, "{name}: {self:?}");
        assert!(self.coverage <= few + 1 && self.coverage_far == 0, "{name}: {self:?}");
    }
}

#[test]
fn scenes_look_the_same() {
    let Some(gpu) = gpu() else { return };
    let mut pass = RasterPass::new(gpu).unwrap();
    let (mut total, mut pictures) = (Count::default(), 0);
    for (width, height) in SIZES {
        for view in [pinhole(width, height), ortho(width, height, 0.7 * width as f32)] {
            for (name, objects) in scenes::all() {
                let scene = VirtualScene::from_objects(objects);
                for real in [wall(view, 1.7), GBuffer::empty(view)] {
                    let cpu = on_cpu(&scene, &real);
                    let count = Count::of(&cpu, &on_gpu(gpu, &mut pass, &scene, &real));
                    count.check(&format!("{name}, {:?}", view.projection));
                    pictures += 1;
                    total.pixels += count.pixels;
                    total.covered += count.covered;
                    total.surfaces += count.surfaces;
                    total.coverage += count.coverage;
                    total.colors += count.colors;
                    total.depth_m = total.depth_m.max(count.depth_m);
                    total.normal = total.normal.max(count.normal);
                }
            }
        }
    }
    println!("{pictures} pictures: {total:?}");
    assert!(total.covered > total.pixels / 4, "{total:?}");
}

#[test]
fn views_that_are_turned_or_mirrored() {
    let Some(gpu) = gpu() else { return };
    let mut pass = RasterPass::new(gpu).unwrap();
    let mut mirrored = moved(pinhole(67, 43));
    if let crate::math::Projection::Perspective(camera) = &mut mirrored.projection {
        camera.fx = -camera.fx;
    }
    for view in [moved(pinhole(67, 43)), moved(ortho(67, 43, 50.0)), mirrored] {
        let place = view.world_from_view_f32().transform_point3(Vec3::new(0.05, -0.03, 1.0));
        for object in [sphere(0.4, 5), sphere(0.3, 24), cuboid(Vec3::new(0.2, 0.15, 0.3))] {
            let scene = VirtualScene::from_objects([at(object, place)]);
            let real = GBuffer::empty(view);
            let cpu = on_cpu(&scene, &real);
            let count = Count::of(&cpu, &on_gpu(gpu, &mut pass, &scene, &real));
            assert!(count.covered > 300, "{count:?}");
            count.check(&format!("{:?}", view.projection));
        }
    }
}

#[test]
fn the_object_of_the_demo_sequence() {
    let Some(gpu) = gpu() else { return };
    let (scene, real) = scenes::demo();
    let mut pass = RasterPass::new(gpu).unwrap();
    let cpu = on_cpu(&scene, &real);
    let count = Count::of(&cpu, &on_gpu(gpu, &mut pass, &scene, &real));
    println!("{count:?}");
    assert!(count.covered > 1000, "{count:?}");
    count.check("demo");
}

#[test]
fn a_thousand_objects() {
    let Some(gpu) = gpu() else { return };
    let scene = VirtualScene::from_objects(scenes::thousand());
    let real = wall(pinhole(67, 43), 3.0);
    let cpu = on_cpu(&scene, &real);
    let mut pass = RasterPass::new(gpu).unwrap();
    let mut on_device = OnDevice::new(gpu, &real);
    let mut commands = gpu.commands();
    let drawn = on_device.draw(&mut commands, &mut pass, 0, &scene);
    commands.submit().unwrap();
    assert_eq!(drawn.objects, 1000);
    let count = Count::of(&cpu, &on_device.download(gpu));
    assert!(count.covered > 700, "{count:?}");
    count.check("a thousand");
}

#[test]
fn nothing_virtual_leaves_every_bit() {
    let Some(gpu) = gpu() else { return };
    let mut pass = RasterPass::new(gpu).unwrap();
    let pending = VirtualObject {
        model: sphere(0.3, 8),
        placement: Placement::Pending(SurfaceAnchor::new(Vec2::ZERO, 0, 0.0, 1.0, None)),
    };
    let empty = Arc::new(Model::new("empty", vec![]).unwrap());
    let beyond = |place: Vec3| at(sphere(0.5, 8), place);
    let cases = [
        vec![],
        vec![at(empty, Vec3::Z)],
        vec![pending],
        vec![beyond(-2.0 * Vec3::Z)],
        vec![beyond(Vec3::new(30.0, 0.0, 2.0)), beyond(Vec3::new(-30.0, 30.0, 2.0))],
        // behind the real wall
        vec![beyond(Vec3::new(0.0, 0.0, 2.3))],
        vec![beyond(Vec3::new(f32::INFINITY, 0.0, 1.0)), beyond(Vec3::splat(f32::NAN))],
    ];
    for (width, height) in SIZES {
        for view in [pinhole(width, height), ortho(width, height, 40.0)] {
            let real = wall(view, 1.7);
            for objects in &cases {
                let scene = VirtualScene::from_objects(objects.clone());
                let picture = on_gpu(gpu, &mut pass, &scene, &real);
                assert!(same(&picture.merged, &real));
                assert!(picture.layer.coverage.as_slice().iter().all(|&c| c == 0.0));
            }
        }
    }
}

#[test]
fn scenes_may_change_and_views_share_a_submission() {
    let Some(gpu) = gpu() else { return };
    let mut pass = RasterPass::new(gpu).unwrap();
    let reals = [wall(pinhole(67, 43), 1.7), wall(ortho(67, 43, 50.0), 1.7)];
    let mut views = reals.each_ref().map(|real| OnDevice::new(gpu, real));
    let (small, large) = (sphere(0.1, 12), cuboid(Vec3::splat(0.3)));
    for objects in [
        vec![at(small.clone(), Vec3::Z)],
        vec![at(small.clone(), Vec3::Z), at(large.clone(), Vec3::new(0.1, 0.1, 1.3))],
        vec![at(large, Vec3::new(-0.1, 0.0, 1.1))],
        vec![],
        vec![at(sphere(0.2, 6), Vec3::Z)],
    ] {
        let scene = VirtualScene::from_objects(objects);
        let mut commands = gpu.commands();
        for (number, view) in views.iter_mut().enumerate() {
            view.draw(&mut commands, &mut pass, number, &scene);
        }
        commands.submit().unwrap();
        for (real, view) in reals.iter().zip(&views) {
            Count::of(&on_cpu(&scene, real), &view.download(gpu)).check("changed");
        }
    }
}

#[test]
fn drawing_is_timed() {
    let Some(gpu) = gpu() else { return };
    let Some(mut timer) = StageTimer::new(gpu).unwrap() else { return };
    let mut pass = RasterPass::new(gpu).unwrap();
    let mut view = OnDevice::new(gpu, &wall(pinhole(67, 43), 1.7));
    let scene = VirtualScene::from_objects([at(sphere(0.3, 8), Vec3::Z)]);
    let mut commands = gpu.commands().timed(Some(&timer));
    view.draw(&mut commands, &mut pass, 0, &scene);
    commands.submit_timed(Some(&mut timer)).unwrap();
    let times = timer.take(gpu).unwrap().unwrap();
    assert!(times.get(Stage::Rendering) > std::time::Duration::ZERO);
    assert_eq!(times.get(Stage::Rendering), times.update());
}

#[test]
fn structs_of_storage_buffers_are_laid_out_as_in_rust() {
    for shader in shaders().iter().chain(&drawing_shaders()) {
        compare_struct::<Part>(shader).unwrap();
        compare_struct::<Vertex>(shader).unwrap();
    }
}
