mod integrate;
mod pool;
mod raycast;
mod surface;
mod timing;

use super::GpuVolume;
use crate::capture::RgbdFrame;
use crate::fusion::tests::{arc, camera, look_at, orthographic, render};
use crate::fusion::{FusionError, Lattice, TsdfVolume, VolumeParams};
use crate::geometry::GBuffer;
use crate::gpu::Gpu;
use crate::gpu::stages::test_support::{gpu, upload_frame};
use crate::image::Image;
use crate::math::View;
use crate::math::random::Rng;
use crate::scene::analytic::AnalyticScene;
use glam::Vec3;

/// The same volume twice.
struct Pair<'g> {
    gpu: &'g Gpu,
    cpu: TsdfVolume,
    on_device: GpuVolume,
}

impl<'g> Pair<'g> {
    fn new(gpu: &'g Gpu, params: &VolumeParams) -> Self {
        let centre = Vec3::new(0.0, 0.0, 0.4);
        let lattice = Lattice::new(params, centre).unwrap();
        Self {
            gpu,
            cpu: TsdfVolume::new(params, centre).unwrap(),
            on_device: GpuVolume::new(gpu, params, lattice).unwrap(),
        }
    }

    fn integrate(&mut self, frame: &RgbdFrame, view: &View) {
        self.cpu.integrate(frame, view).unwrap();
        let mut commands = self.gpu.commands();
        let pictures = upload_frame(self.gpu, frame);
        self.on_device.integrate(&mut commands, &pictures, 0, view).unwrap();
        commands.submit().unwrap();
    }
}

fn volume_params(resolution: usize) -> VolumeParams {
    VolumeParams { resolution, ..VolumeParams::default() }
}

/// A frame that holds this depth, and noise as its colour.
fn colored(mut frame: RgbdFrame) -> RgbdFrame {
    let (size, mut rng) = (frame.depth_m.size(), Rng::new(&[5]));
    frame.color_srgb = Image::from_vec(
        size,
        (0..size.pixels()).map(|_| [0; 3].map(|_: i32| rng.next_u32() as u8)).collect(),
    );
    frame.color = Image::new(size, [0.2; 3]);
    frame.intensity = Image::new(size, 0.0);
    frame
}

/// How two pictures differ.
#[derive(Debug, Default)]
struct Differences {
    surface: usize,
    /// Pixels where just one has a surface, or depths differ by more than the tolerance.
    rim: usize,
    depth_m: f32,
    /// Largest length of the difference of normals.
    normal: f32,
}

impl Differences {
    fn of(cpu: &GBuffer, gpu: &GBuffer, tolerance_m: f32) -> Self {
        let mut found = Self::default();
        for (x, y) in
            (0..cpu.size().height).flat_map(|y| (0..cpu.size().width).map(move |x| (x, y)))
        {
            let (a, b) = (cpu.depth_m[(x, y)], gpu.depth_m[(x, y)]);
            assert_eq!(gpu.origin[(x, y)] as u8, u8::from(b > 0.0));
            found.surface += usize::from(a > 0.0);
            let difference = (a - b).abs();
            if (a > 0.0) == (b > 0.0) && difference <= tolerance_m {
                found.depth_m = found.depth_m.max(difference);
                let normal = (cpu.normals.at(x, y) - gpu.normals.at(x, y)).length();
                found.normal = found.normal.max(normal);
            } else {
                found.rim += 1;
            }
        }
        found
    }

    /// Same operations in the same order give the same depths, up to a rounding of the tiles' ranges, and
    /// normals that are sums in another order. A device that fuses multiplications with additions or
    /// divides less exactly may end the search for a crossing a step earlier or later, at 0.01 voxels
    /// from it, and may miss a surface at its rim.
    fn assert_small(&self, gpu: &Gpu, case: &str) {
        let (rim, depth_m, normal) = if gpu.summary().is_software() {
            (0, 1e-6, 1e-5)
        } else {
            (self.surface / 200, 1e-3, 0.05)
        };
        let is_small = self.rim <= rim && self.depth_m <= depth_m && self.normal <= normal;
        assert!(is_small, "{case}: {self:?}");
    }
}
