use super::*;
use crate::fusion::EmptySpace;
use crate::gpu::GpuGBuffer;
use crate::gpu::stages::{EmptySpacePass, RayCaster};

/// Views are taken of the device's own voxels, so that it is rays alone that differ.
struct Room<'g> {
    gpu: &'g Gpu,
    cpu: TsdfVolume,
    on_device: GpuVolume,
}

impl<'g> Room<'g> {
    fn new(gpu: &'g Gpu, resolution: usize) -> Self {
        let mut pair = Pair::new(gpu, &volume_params(resolution));
        let (scene, mut rng) = (AnalyticScene::corner(), Rng::new(&[3]));
        for pose in arc(4) {
            let view = View::perspective(camera(160, 120), pose);
            let mut frame = render(&scene, &view);
            // rough enough for every way to a normal
            for depth_m in frame.depth_m.as_mut_slice() {
                *depth_m += 0.004 * rng.normal() * *depth_m;
                *depth_m *= f32::from(u8::from(rng.uniform() > 0.1));
            }
            pair.integrate(&colored(frame), &view);
        }
        let cpu = pair.on_device.download(gpu).unwrap();
        Self { gpu, cpu, on_device: pair.on_device }
    }

    fn cast(&self, caster: &mut RayCaster, view: &View) -> (GBuffer, GBuffer) {
        let mut expected = GBuffer::empty(*view);
        self.cpu.raycast(view, &mut expected);
        let mut out = GpuGBuffer::empty(self.gpu, *view).unwrap();
        let mut commands = self.gpu.commands();
        caster.cast(&mut commands, &self.on_device, view, &mut out).unwrap();
        commands.submit().unwrap();
        (expected, out.download(self.gpu).unwrap())
    }
}

fn views() -> Vec<(&'static str, View)> {
    let target = Vec3::new(-0.1, 0.2, 0.2);
    let side = |eye| look_at(eye, target);
    let near = side(Vec3::new(1.1, -0.9, 0.9));
    vec![
        ("perspective", View::perspective(camera(67, 43), near)),
        ("one pixel", View::perspective(camera(1, 1), near)),
        ("within", View::perspective(camera(160, 120), side(Vec3::new(0.3, -0.2, 0.5)))),
        ("far away", View::perspective(camera(67, 43), side(Vec3::new(5.0, -7.0, 4.0)))),
        ("away", View::perspective(camera(67, 43), look_at(Vec3::X * 2.0, Vec3::X * 9.0))),
        ("orthographic", orthographic(67, 2.0, side(Vec3::new(1.0, -2.0, 1.8)))),
        // along an axis of the volume
        ("straight", orthographic(64, 2.2, look_at(Vec3::new(0.0, -2.0, 0.4), Vec3::Z * 0.4))),
    ]
}

#[test]
fn views_are_those_of_the_cpu() {
    let Some(gpu) = gpu() else { return };
    for resolution in [64, 128] {
        let room = Room::new(gpu, resolution);
        // too small for all views but one: it grows
        let mut caster = RayCaster::new(gpu, crate::image::Size::new(1, 1)).unwrap();
        for (name, view) in views() {
            let (cpu, out) = room.cast(&mut caster, &view);
            let found = Differences::of(&cpu, &out, 1e-3);
            assert_eq!(found.surface > 0, name != "away", "{name}");
            found.assert_small(gpu, &format!("{name} at {resolution}"));
        }
    }
}

#[test]
fn nothing_is_seen_in_an_empty_volume() {
    let Some(gpu) = gpu() else { return };
    let Pair { cpu, on_device, .. } = Pair::new(gpu, &volume_params(64));
    let mut caster = RayCaster::new(gpu, crate::image::Size::new(67, 43)).unwrap();
    let room = Room { gpu, cpu, on_device };
    for (name, view) in views() {
        let (cpu, out) = room.cast(&mut caster, &view);
        let found = Differences::of(&cpu, &out, 0.0);
        assert_eq!((found.surface, found.rim), (0, 0), "{name}");
    }
}

#[test]
fn empty_space_is_that_of_the_cpu() {
    let Some(gpu) = gpu() else { return };
    for resolution in [8, 64, 256] {
        let mut pair = Pair::new(gpu, &volume_params(resolution));
        let pass = EmptySpacePass::new(gpu, &pair.on_device).unwrap();
        // one ray's worth of surface in the last volume, so that there is more around than is followed
        let size = if resolution == 256 { 1 } else { 67 };
        let view = View::perspective(camera(size, size), arc(1).next().unwrap());
        pair.integrate(&colored(render(&AnalyticScene::corner(), &view)), &view);
        let mut expected = EmptySpace::default();
        expected.survey(&pair.cpu);
        let mut commands = gpu.commands();
        pass.survey(&mut commands, &pair.on_device).unwrap();
        commands.submit().unwrap();
        let found = pass.distances().download(gpu).unwrap();
        let expected: Vec<u32> = expected.distances().iter().map(|&d| d.into()).collect();
        assert!(expected.contains(&0), "{resolution}");
        assert!(resolution < 256 || expected.contains(&16), "no block is far away");
        assert_eq!(found, expected, "{resolution}");
    }
}
