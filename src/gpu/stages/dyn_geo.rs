//! The DynGeo stage: D', D'', D''' and their normals, as [`crate::geometry::DynGeo`].

use super::FramePictures;
use crate::geometry::{DynGeoParams, NORMAL_MAX_SLOPE, NORMAL_REACH, window_taps};
use crate::gpu::{
    Commands, Constant, Gpu, GpuBuffer, GpuError, GpuGBuffer, GpuImage, Shader, ViewUniform,
    uniform,
};
use crate::image::Size;
use crate::timing::Stage;

uniform! {
    struct MergeUniform {
        size: [u32; 2],
        intensity_threshold: f32,
        close_m: f32,
    }
}

uniform! {
    struct MedianUniform {
        size: [u32; 2],
        intensity_threshold: f32,
        pad: u32,
    }
}

uniform! {
    struct ModelDepthUniform {
        pixels: u32,
        pad: u32,
    }
}

uniform! {
    struct NormalsUniform {
        view: ViewUniform,
        same_surface_m: f32,
        pad0: u32,
        pad1: u32,
        pad2: u32,
    }
}

/// A filter's window on the device, and the shader for that many taps.
struct Window {
    taps: GpuBuffer<[i32; 2]>,
    shader: Shader,
}

impl Window {
    fn new(gpu: &Gpu, taps: &[[i32; 2]], shader: Shader) -> Result<Self, GpuError> {
        Ok(Self { taps: GpuBuffer::from_slice(gpu, "window", taps)?, shader })
    }
}

fn merge_shader(taps: usize) -> Shader {
    Shader::new("dyn_geo/merge").with_u32("TAPS", taps).with_bool("GUIDED", true)
}

fn median_shader(taps: usize, guided: bool) -> Shader {
    Shader::new("dyn_geo/median").with_u32("TAPS", taps).with_bool("GUIDED", guided)
}

fn normals_shader() -> Shader {
    Shader::new("dyn_geo/normals")
        .with_u32("REACH", NORMAL_REACH as usize)
        .with("MAX_SLOPE", Constant::F32(NORMAL_MAX_SLOPE))
}

/// Windows that fit the cache of values and one that does not.
#[cfg(test)]
pub(super) fn shaders() -> Vec<Shader> {
    let mut all = vec![normals_shader(), Shader::new("dyn_geo/model_depth")];
    for taps in [1, 9, 25, 121] {
        all.extend([merge_shader(taps), median_shader(taps, true), median_shader(taps, false)]);
    }
    all
}

/// The stage, with what it keeps from frame to frame.
pub struct DynGeoPass {
    params: DynGeoParams,
    merge: Window,
    smooth: Window,
    denoise: Window,
    normals: Shader,
    /// Depth between two passes, taken in turn.
    between: [GpuImage<f32>; 2],
}

impl DynGeoPass {
    pub fn new(gpu: &Gpu, params: &DynGeoParams, size: Size) -> Result<Self, GpuError> {
        let merge = window_taps(params.merge_window, params.taps);
        let smooth = window_taps(params.smooth_window, params.taps);
        let denoise = window_taps(params.denoise_window, usize::MAX);
        Ok(Self {
            merge: Window::new(gpu, &merge, merge_shader(merge.len()))?,
            smooth: Window::new(gpu, &smooth, median_shader(smooth.len(), true))?,
            denoise: Window::new(gpu, &denoise, median_shader(denoise.len(), false))?,
            normals: normals_shader(),
            params: params.clone(),
            between: [
                GpuImage::new(gpu, "depth between filters", size)?,
                GpuImage::new(gpu, "depth between filters", size)?,
            ],
        })
    }

    /// Writes G_r to `out`: depth D''', world normals, origin. `model` is ray-cast into the camera of the
    /// frame. With all passes off, `out` is the model's depth with its normals.
    ///
    /// # Panics
    /// If pictures and buffers differ in size.
    pub fn run(
        &self,
        commands: &mut Commands<'_>,
        frame: &FramePictures,
        model: &GpuGBuffer,
        out: &mut GpuGBuffer,
    ) -> Result<(), GpuError> {
        let size = self.between[0].size();
        assert!([frame.size, model.size(), out.size()] == [size; 3], "sizes of the DynGeo stage");
        commands.stage(Stage::DynGeo);
        out.view = model.view;

        let pixels = [size.width as u32, size.height as u32];
        let [mut depth, mut spare] = self.between.each_ref();
        if self.params.merge {
            let merge = MergeUniform {
                size: pixels,
                intensity_threshold: self.params.intensity_threshold,
                close_m: self.params.depth_threshold_m,
            };
            commands
                .pass(&self.merge.shader)?
                .uniform(&merge)?
                .read(&self.merge.taps)?
                .read(&frame.color)?
                .read(&frame.depth_m)?
                .read(&model.surface)?
                .write(depth)?
                .over(size)?;
        } else {
            let all = ModelDepthUniform { pixels: size.pixels() as u32, pad: 0 };
            commands
                .pass(&Shader::new("dyn_geo/model_depth"))?
                .uniform(&all)?
                .read(&model.surface)?
                .write(depth)?
                .over_count(size.pixels())?;
        }
        let median = MedianUniform {
            size: pixels,
            intensity_threshold: self.params.intensity_threshold,
            pad: 0,
        };
        for (window, on) in
            [(&self.smooth, self.params.smooth), (&self.denoise, self.params.denoise)]
        {
            if on {
                commands
                    .pass(&window.shader)?
                    .uniform(&median)?
                    .read(&window.taps)?
                    .read(&frame.color)?
                    .read(depth)?
                    .write(spare)?
                    .over(size)?;
                std::mem::swap(&mut depth, &mut spare);
            }
        }
        let normals = NormalsUniform {
            view: ViewUniform::new(&model.view),
            same_surface_m: self.params.depth_threshold_m,
            pad0: 0,
            pad1: 0,
            pad2: 0,
        };
        commands
            .pass(&self.normals)?
            .uniform(&normals)?
            .read(depth)?
            .read(&model.surface)?
            .write(&out.surface)?
            .write(&out.origin)?
            .over(size)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::RgbdFrame;
    use crate::geometry::{DynGeo, GBuffer, Origin};
    use crate::gpu::stages::test_support::{gpu, upload_frame};
    use crate::image::Image;
    use crate::math::random::Rng;
    use crate::math::{Pinhole, Pose, View, pose_from_xyzw};
    use crate::parity::tolerances::DYNGEO_NORMAL;

    /// A slanted wall with a step and a ball's worth of noise, seen by sensor and model differently; holes in
    /// both, and an intensity edge that is not the depth's.
    fn scene(size: Size) -> (RgbdFrame, GBuffer) {
        let camera = Pinhole {
            width: size.width,
            height: size.height,
            fx: 150.0,
            fy: 148.0,
            cx: size.width as f32 / 2.0 - 0.5,
            cy: size.height as f32 / 2.0 - 0.3,
        };
        let pose =
            pose_from_xyzw([0.3, -0.2, 1.0], [0.1, -0.3, 0.2, 0.9]).unwrap_or(Pose::identity());
        let mut rng = Rng::new(&[11]);
        let mut frame = RgbdFrame {
            color_srgb: Image::new(size, [0; 3]),
            color: Image::new(size, [0.2; 3]),
            intensity: Image::new(size, 0.0),
            depth_m: Image::new(size, 0.0),
            ..RgbdFrame::default()
        };
        let mut model = GBuffer::empty(View::perspective(camera, pose));
        for (x, y) in (0..size.pixels()).map(|i| (i % size.width, i / size.width)) {
            let step = if x + y / 2 > size.width / 2 { 0.4 } else { 0.0 };
            let wall = 1.2 + 0.004 * x as f32 - 0.002 * y as f32 + step;
            let hole = |share: f32, rng: &mut Rng| rng.uniform() < share;
            frame.depth_m[(x, y)] =
                if hole(0.3, &mut rng) { 0.0 } else { wall + 0.02 * (rng.uniform() - 0.5) };
            frame.intensity[(x, y)] = 100.0 + 3.0 * rng.uniform() + if y > 20 { 40.0 } else { 0.0 };
            if !hole(0.2, &mut rng) {
                model.depth_m[(x, y)] = wall - if x < 12 { 0.3 } else { 0.001 };
                let n = glam::Vec3::new(rng.uniform() - 0.5, rng.uniform(), -1.0).normalize();
                model.normals.set(x, y, n);
                model.origin[(x, y)] = Origin::Model;
            }
        }
        (frame, model)
    }

    fn both(gpu: &Gpu, size: Size, params: &DynGeoParams) -> (GBuffer, GBuffer) {
        let (frame, model) = scene(size);
        let mut expected = GBuffer::empty(model.view);
        DynGeo::new(params).run(&frame, &model, &mut expected);

        let pictures = upload_frame(gpu, &frame);
        let mut on_device = GpuGBuffer::empty(gpu, model.view).unwrap();
        on_device.upload(gpu, &model);
        let mut out = GpuGBuffer::empty(gpu, model.view).unwrap();
        let pass = DynGeoPass::new(gpu, params, size).unwrap();
        let mut commands = gpu.commands();
        pass.run(&mut commands, &pictures, &on_device, &mut out).unwrap();
        commands.submit().unwrap();
        (expected, out.download(gpu).unwrap())
    }

    #[test]
    fn depth_is_exact_and_normals_are_close() {
        let Some(device) = gpu() else { return };
        let standard = DynGeoParams::default();
        let cases = [
            standard.clone(),
            DynGeoParams { merge: false, ..standard.clone() },
            DynGeoParams { smooth: false, denoise: false, ..standard.clone() },
            DynGeoParams { denoise_window: 10, smooth_window: 3, ..standard.clone() },
        ];
        for (width, height) in [(67, 43), (1, 1), (1, 9), (5, 2)] {
            for params in &cases {
                let (cpu, gpu) = both(device, Size::new(width, height), params);
                // medians choose one of the given values, so that nothing is rounded
                assert_eq!(cpu.depth_m, gpu.depth_m, "{width}x{height} {params:?}");
                assert_eq!(cpu.origin, gpu.origin);
                let pairs = [
                    (&cpu.normals.x, &gpu.normals.x),
                    (&cpu.normals.y, &gpu.normals.y),
                    (&cpu.normals.z, &gpu.normals.z),
                ];
                for (cpu, gpu) in pairs {
                    let (found, within) =
                        DYNGEO_NORMAL.compare(device, cpu.as_slice(), gpu.as_slice());
                    assert!(within, "{width}x{height} {params:?}: {found}");
                }
            }
        }
    }
}
