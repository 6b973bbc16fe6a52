//! Sums of one iteration of the alignment: each workgroup adds up its pixels, a second pass the workgroups,
//! both in a fixed order. The totals are f32; the CPU adds its partial sums in f64.

use super::Lens;
use super::pyramid::Level;
use crate::gpu::{
    Commands, Constant, Gpu, GpuBuffer, GpuError, GpuGBuffer, ReadBack, Shader, uniform,
};
use crate::math::{Pinhole, Pose, affine_from_pose};
use crate::tracking::{DEPTH_NOISE, Gates, Sums, TERMS, rows_of_inverse};
use glam::{Mat3, Mat4};

uniform! {
    struct SumsUniform {
        model_from_camera: [[f32; 4]; 4],
        model_from_world: [[f32; 4]; 4],
        frame: Lens,
        model: Lens,
        max_distance_m: f32,
        min_cosine: f32,
        huber_sigmas: f32,
        pad: u32,
    }
}

uniform! {
    struct TotalsUniform {
        partials: u32,
        pad: u32,
    }
}

/// Pixels that an invocation adds up, and invocations of a workgroup.
const ITEMS: usize = 8;
const LANES: usize = 64;

fn sums_shader() -> Shader {
    Shader::new("tracking/sums")
        .with_u32("ITEMS", ITEMS)
        .with_u32("LANES", LANES)
        .with_u32("TERMS", TERMS)
        .with("NOISE_FLOOR_M", Constant::F32(DEPTH_NOISE.floor_m))
        .with("NOISE_GROWTH", Constant::F32(DEPTH_NOISE.growth))
        .with("NOISE_NEAREST_M", Constant::F32(DEPTH_NOISE.nearest_m))
}

fn totals_shader() -> Shader {
    Shader::new("tracking/totals").with_u32("TERMS", TERMS)
}

#[cfg(test)]
pub(super) fn shaders() -> Vec<Shader> {
    vec![sums_shader(), totals_shader()]
}

/// Adds up a level's pixels.
pub(super) struct AlignmentSums {
    sums: Shader,
    totals_of: Shader,
    partials: GpuBuffer<f32>,
    totals: GpuBuffer<f32>,
    read_back: ReadBack<f32>,
}

fn workgroups(pixels: usize) -> usize {
    pixels.div_ceil(ITEMS * LANES)
}

impl AlignmentSums {
    /// For levels of up to this many pixels.
    pub fn new(gpu: &Gpu, pixels: usize) -> Result<Self, GpuError> {
        let partials = workgroups(pixels) * TERMS;
        Ok(Self {
            sums: sums_shader(),
            totals_of: totals_shader(),
            partials: GpuBuffer::new(gpu, "partial sums of the alignment", partials)?,
            totals: GpuBuffer::new(gpu, "sums of the alignment", TERMS)?,
            read_back: ReadBack::new(gpu, "sums of the alignment", TERMS)?,
        })
    }

    /// Sums over all pixels of `level`, moved by `model_from_camera`; submits `commands`, and waits.
    /// `model_camera` is the perspective projection of `model`; both pictures have pixels.
    pub fn evaluate(
        &mut self,
        commands: &mut Commands<'_>,
        level: &Level,
        model: &GpuGBuffer,
        model_camera: &Pinhole,
        model_from_camera: &Pose,
        gates: &Gates,
    ) -> Result<Sums, GpuError> {
        let rotation = rows_of_inverse(&model.view.world_from_view);
        let params = SumsUniform {
            model_from_camera: Mat4::from(affine_from_pose(model_from_camera)).to_cols_array_2d(),
            model_from_world: Mat4::from_mat3(Mat3::from_cols_array_2d(&rotation).transpose())
                .to_cols_array_2d(),
            frame: Lens::new(&level.camera),
            model: Lens::new(model_camera),
            max_distance_m: gates.max_distance_m,
            min_cosine: gates.min_cosine,
            huber_sigmas: gates.huber_sigmas,
            pad: 0,
        };
        let workgroups = workgroups(level.camera.size().pixels());
        commands
            .pass(&self.sums)?
            .uniform(&params)?
            .read(&level.surface)?
            .read(&model.surface)?
            .write(&self.partials)?
            .workgroups([workgroups as u32, 1, 1])?;
        commands
            .pass(&self.totals_of)?
            .uniform(&TotalsUniform { partials: workgroups as u32, pad: 0 })?
            .read(&self.partials)?
            .write(&self.totals)?
            .workgroups([1; 3])?;
        self.read_back.request(commands, &self.totals, TERMS);
        commands.flush()?;
        let totals = self.read_back.take(commands.gpu())?.unwrap_or_default();
        let mut terms = [0.0; TERMS];
        terms.copy_from_slice(&totals);
        Ok(Sums::from_terms(terms))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::RgbdFrame;
    use crate::geometry::GBuffer;
    use crate::gpu::stages::test_support::{gpu, upload_frame};
    use crate::gpu::stages::tracking::pyramid::FramePyramid;
    use crate::gpu::stages::tracking::test_scene::{camera, corner_frame, corner_pose, motion};
    use crate::math::View;
    use crate::math::random::Rng;
    use crate::scene::analytic::{AnalyticScene, Shape};
    use crate::tracking::{ModelView, Pyramid, Reduction, TrackingParams};

    /// The CPU's and the GPU's sums of each level, finest first.
    fn both(
        gpu: &Gpu,
        frame: &RgbdFrame,
        model: &GBuffer,
        model_from_camera: &Pose,
    ) -> Vec<(Sums, Sums)> {
        let params = TrackingParams::default();
        let gates = Gates::new(&params, 1.0);
        let size = frame.depth_m.size();
        let frame_camera = camera(size.width, size.height);
        let model_camera = camera(model.size().width, model.size().height);
        let mut cpu = Pyramid::new(&params, frame_camera);
        cpu.update(&frame.depth_m);

        let pyramid = FramePyramid::new(gpu, &params, frame_camera).unwrap();
        let mut commands = gpu.commands();
        pyramid.record(&mut commands, &upload_frame(gpu, frame)).unwrap();
        commands.submit().unwrap();
        let mut on_device = GpuGBuffer::empty(gpu, model.view).unwrap();
        on_device.upload(gpu, model);
        let mut sums = AlignmentSums::new(gpu, size.pixels()).unwrap();
        let mut reduction = Reduction::default();
        let model_view = ModelView::new(model, model_camera);
        let levels = cpu.levels.iter().zip(&pyramid.levels);
        levels
            .map(|(cpu, level)| {
                let expected = reduction.accumulate(cpu, &model_view, model_from_camera, &gates);
                let evaluated = sums.evaluate(
                    &mut gpu.commands(),
                    level,
                    &on_device,
                    &model_camera,
                    model_from_camera,
                    &gates,
                );
                (expected, evaluated.unwrap())
            })
            .collect()
    }

    /// f32 sums of up to 8 + 64 + 38 + 8 terms in a row are within 120 * 2^-24 = 7e-6 of the f64 sums, in
    /// units of the sum of what is added, positive or not.
    const TOLERANCE: f64 = 1e-5;

    fn assert_equal(cpu: &Sums, gpu: &Sums) {
        let counts = |s: &Sums| [s.partners(), s.seen(), s.valid()];
        assert_eq!(counts(cpu), counts(gpu));
        let a = (cpu.a() - gpu.a()).norm() / cpu.a().norm().max(f64::MIN_POSITIVE);
        // Cauchy-Schwarz: the sum of |w J r|, as weights are at most 1
        let squares = cpu.rms_m().powi(2) * cpu.partners();
        let most = (cpu.a().trace() * squares).sqrt().max(f64::MIN_POSITIVE);
        let b = (cpu.b() - gpu.b()).norm() / most;
        assert!(a < TOLERANCE && b < TOLERANCE, "A {a:e}, b {b:e}");
        let rms = (cpu.rms_m() - gpu.rms_m()).abs();
        assert!(rms <= TOLERANCE * cpu.rms_m(), "{rms:e} of {}", cpu.rms_m());
        if cpu.partners() > 0.0 {
            let depth = (cpu.mean_depth_m() - gpu.mean_depth_m()).abs();
            assert!(depth <= TOLERANCE * cpu.mean_depth_m(), "{depth:e}");
        }
    }

    #[test]
    fn sums_equal_the_cpus_at_any_pose() {
        let Some(gpu) = gpu() else { return };
        for (width, height) in [(160, 120), (67, 43)] {
            let frame = corner_frame(camera(width, height), 8);
            let view = View::perspective(camera(width, height), corner_pose());
            let mut model = AnalyticScene::corner().render(&view);
            let mut rng = Rng::new(&[5]);
            for i in 0..model.size().pixels() / 40 {
                let pixel = rng.next_u32() as usize % model.size().pixels();
                // what a picture of a map must never hold, but the CPU can bear
                match i % 4 {
                    0 => model.depth_m.as_mut_slice()[pixel] = 0.0,
                    1 => model.depth_m.as_mut_slice()[pixel] = f32::NAN,
                    2 => model.depth_m.as_mut_slice()[pixel] = f32::INFINITY,
                    _ => model.normals.y.as_mut_slice()[pixel] = f32::NAN,
                }
            }
            for (step, least) in [
                // not the model's own: there pixels of coarse levels fall on borders between pixels
                (motion([0.001, 0.0005, -0.0007], [0.05, 0.03, -0.04]), 0.7),
                (motion([0.02, -0.015, 0.025], [1.0, -1.5, 2.0]), 0.5),
                (motion([-0.05, 0.02, 0.01], [-3.0, 1.0, -0.5]), 0.3),
                (motion([0.3, -0.4, 0.2], [10.0, 20.0, -15.0]), 0.0),
            ] {
                for (cpu, gpu) in both(gpu, &frame, &model, &step) {
                    assert_equal(&cpu, &gpu);
                    let share = cpu.partners() / cpu.valid();
                    assert!(share > least || cpu.valid() < 1000.0, "{share} of {least}");
                }
            }
        }
    }

    #[test]
    fn a_model_picture_of_another_size() {
        let Some(gpu) = gpu() else { return };
        let frame = corner_frame(camera(67, 43), 8);
        let view = View::perspective(camera(101, 75), corner_pose());
        let model = AnalyticScene::corner().render(&view);
        for (cpu, gpu) in both(gpu, &frame, &model, &motion([0.01; 3], [0.5; 3])) {
            assert!(cpu.partners() > 0.5 * cpu.valid());
            assert_equal(&cpu, &gpu);
        }
    }

    #[test]
    fn a_wall_leaves_the_same_motions_open() {
        let Some(gpu) = gpu() else { return };
        let camera = camera(67, 43);
        let wall = AnalyticScene::new([Shape::Plane { normal: -glam::Vec3::Z, offset: -1.5 }]);
        let pose = Pose::identity();
        let frame = crate::gpu::stages::tracking::test_scene::frame(&wall, camera, pose, 2);
        let model = wall.render(&View::perspective(camera, pose));
        for (cpu, gpu) in both(gpu, &frame, &model, &motion([0.0, 0.0, 0.01], [0.2, 0.3, 0.0])) {
            assert!(cpu.partners() > 0.5 * cpu.valid());
            assert_equal(&cpu, &gpu);
            // the motions that stay open have eigenvalues that are nothing but rounding
            let smallest = |s: &Sums| {
                let mut values = s.a().symmetric_eigenvalues().data.0[0];
                values.sort_by(f64::total_cmp);
                values[2] / values[5]
            };
            assert!(smallest(&cpu) < 1e-6 && smallest(&gpu) < 1e-6);
        }
    }

    #[test]
    fn hardly_any_depth() {
        let Some(gpu) = gpu() else { return };
        let mut frame = corner_frame(camera(67, 43), 8);
        let model =
            AnalyticScene::corner().render(&View::perspective(camera(67, 43), corner_pose()));
        let (valid, step) = (frame.depth_m.clone(), Pose::identity());
        frame.depth_m.fill(0.0);
        for (cpu, gpu) in both(gpu, &frame, &model, &step) {
            assert_eq!((cpu.valid(), gpu.valid()), (0.0, 0.0));
            assert_equal(&cpu, &gpu);
        }
        // one pixel has no normal, three in a corner have one
        for (dx, dy) in [(0, 0), (1, 0), (0, 1)] {
            frame.depth_m[(30 + dx, 20 + dy)] = valid[(30, 20)].max(1.0);
            let [(cpu, gpu), ..] = both(gpu, &frame, &model, &step)[..] else { panic!() };
            assert_equal(&cpu, &gpu);
        }
        // nothing in the model
        let nothing = GBuffer::empty(model.view);
        let frame = corner_frame(camera(67, 43), 8);
        for (cpu, gpu) in both(gpu, &frame, &nothing, &step) {
            assert!(gpu.valid() > 0.0 && gpu.seen() == 0.0);
            assert_equal(&cpu, &gpu);
        }
    }
}
