//! Filtered depth and normals of the newest frame at several resolutions, as
//! [`crate::tracking`] has them; depth that is no number is missing.

use super::Lens;
use crate::gpu::stages::FramePictures;
use crate::gpu::{Commands, Gpu, GpuBuffer, GpuError, GpuImage, Shader, uniform};
use crate::image::Size;
use crate::math::Pinhole;
use crate::tracking::{Bilateral, DEPTH_RANGE_M, TrackingParams, edge_m, level_cameras};

uniform! {
    struct BilateralUniform {
        size: [u32; 2],
        min_bits: u32,
        end_bits: u32,
        range_scale: f32,
        pad0: u32,
        pad1: u32,
        pad2: u32,
    }
}

uniform! {
    struct HalveUniform {
        size: [u32; 2],
        fine_width: u32,
        edge_m: f32,
    }
}

uniform! {
    struct LevelUniform {
        lens: Lens,
        edge_m: f32,
        pad0: u32,
        pad1: u32,
        pad2: u32,
    }
}

/// The filter's workgroups have this many pixels a side, and this much memory in f32.
const FILTER_GROUP: usize = 16;
const WORKGROUP_FLOATS: usize = 16384 / 4;

fn bilateral_shader(radius: usize) -> Shader {
    let tiled = (FILTER_GROUP + 2 * radius).pow(2) <= WORKGROUP_FLOATS;
    Shader::new("tracking/bilateral")
        .with_u32("RADIUS", radius)
        .with_u32("GROUP", FILTER_GROUP)
        .with_bool("TILED", tiled)
}

fn halve_shader() -> Shader {
    Shader::new("tracking/halve")
}

fn normals_shader() -> Shader {
    Shader::new("tracking/normals")
}

/// With a filter that is none, the usual one, the last that fits a workgroup's memory, and one that does not.
#[cfg(test)]
pub(super) fn shaders() -> Vec<Shader> {
    let filters = [0, 3, 24, 25].map(bilateral_shader);
    [&filters[..], &[halve_shader(), normals_shader()]].concat()
}

/// One resolution.
pub(super) struct Level {
    pub camera: Pinhole,
    depth_m: GpuImage<f32>,
    /// Unit normal in camera axes, facing the camera, zero where missing, and filtered depth in metres.
    pub surface: GpuImage<[f32; 4]>,
}

/// All resolutions of the newest frame, and what makes them.
pub(super) struct FramePyramid {
    bilateral: Shader,
    spatial: GpuBuffer<f32>,
    range_scale: f32,
    edge_m: f32,
    /// Finest first; none where the camera has no pixels.
    pub levels: Vec<Level>,
}

impl FramePyramid {
    pub fn new(gpu: &Gpu, params: &TrackingParams, camera: Pinhole) -> Result<Self, GpuError> {
        let filter = Bilateral::new(params);
        let level = |camera: Pinhole| {
            Ok(Level {
                camera,
                depth_m: GpuImage::new(gpu, "filtered depth", camera.size())?,
                surface: GpuImage::new(gpu, "frame surface", camera.size())?,
            })
        };
        Ok(Self {
            bilateral: bilateral_shader(filter.radius),
            spatial: GpuBuffer::from_slice(gpu, "weights of the depth filter", &filter.spatial)?,
            range_scale: filter.range_scale,
            edge_m: edge_m(params),
            levels: level_cameras(params, camera).map(level).collect::<Result<_, GpuError>>()?,
        })
    }

    /// Records the passes that fill [`Self::levels`].
    ///
    /// # Panics
    /// If the frame is not of the camera's size.
    pub fn record(
        &self,
        commands: &mut Commands<'_>,
        frame: &FramePictures,
    ) -> Result<(), GpuError> {
        let Some(finest) = self.levels.first() else { return Ok(()) };
        assert_eq!(frame.size, finest.camera.size(), "size of the frame");
        self.filter(commands, frame, finest)?;
        for pair in self.levels.windows(2) {
            self.halve(commands, &pair[0], &pair[1])?;
        }
        for level in &self.levels {
            self.normals(commands, level)?;
        }
        Ok(())
    }

    fn filter(
        &self,
        commands: &mut Commands<'_>,
        frame: &FramePictures,
        finest: &Level,
    ) -> Result<(), GpuError> {
        let size = finest.camera.size();
        let params = BilateralUniform {
            size: pixels(size),
            min_bits: DEPTH_RANGE_M.start.to_bits(),
            end_bits: DEPTH_RANGE_M.end.to_bits(),
            range_scale: self.range_scale,
            pad0: 0,
            pad1: 0,
            pad2: 0,
        };
        commands
            .pass(&self.bilateral)?
            .uniform(&params)?
            .read(&self.spatial)?
            .read(&frame.depth_m)?
            .write(&finest.depth_m)?
            .over(size)
    }

    fn halve(
        &self,
        commands: &mut Commands<'_>,
        fine: &Level,
        coarse: &Level,
    ) -> Result<(), GpuError> {
        let size = coarse.camera.size();
        let params = HalveUniform {
            size: pixels(size),
            fine_width: fine.camera.width as u32,
            edge_m: self.edge_m,
        };
        commands
            .pass(&halve_shader())?
            .uniform(&params)?
            .read(&fine.depth_m)?
            .write(&coarse.depth_m)?
            .over(size)
    }

    fn normals(&self, commands: &mut Commands<'_>, level: &Level) -> Result<(), GpuError> {
        let params = LevelUniform {
            lens: Lens::new(&level.camera),
            edge_m: self.edge_m,
            pad0: 0,
            pad1: 0,
            pad2: 0,
        };
        commands
            .pass(&normals_shader())?
            .uniform(&params)?
            .read(&level.depth_m)?
            .write(&level.surface)?
            .over(level.camera.size())
    }
}

fn pixels(size: Size) -> [u32; 2] {
    [size.width as u32, size.height as u32]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::RgbdFrame;
    use crate::gpu::parity::Difference;
    use crate::gpu::stages::test_support::{gpu, upload_frame};
    use crate::gpu::stages::tracking::test_scene::{camera, corner_frame};
    use crate::image::Image;
    use crate::tracking::Pyramid;

    /// Compares all levels; returns how many pixels have depth.
    fn compare(gpu: &Gpu, params: &TrackingParams, frame: &RgbdFrame) -> usize {
        let size = frame.depth_m.size();
        let camera = camera(size.width, size.height);
        let mut cpu = Pyramid::new(params, camera);
        let share = cpu.update(&frame.depth_m);

        let pictures = upload_frame(gpu, frame);
        let pyramid = FramePyramid::new(gpu, params, camera).unwrap();
        let mut commands = gpu.commands();
        pyramid.record(&mut commands, &pictures).unwrap();
        commands.submit().unwrap();
        let finest = pyramid.levels[0].surface.buffer().download(gpu).unwrap();
        let normals = finest.iter().filter(|s| s[2] < 0.0).count();
        let valid = finest.iter().filter(|s| s[3] > 0.0).count();
        // nearly all, where pixels have neighbours
        assert!(valid < 100 || normals > valid * 9 / 10, "{normals} normals of {valid}");
        assert_eq!(valid as f32 / size.pixels() as f32, share, "{size}");

        assert_eq!(pyramid.levels.len(), cpu.levels.len());
        for (cpu, level) in cpu.levels.iter().zip(&pyramid.levels) {
            let size = level.camera.size();
            assert_eq!(level.camera, cpu.camera);
            let surface = level.surface.buffer().download(gpu).unwrap();
            let plane = |of: usize| surface.iter().map(|s| s[of]).collect::<Vec<_>>();
            let rows = |row: &dyn Fn(usize) -> Vec<f32>| {
                (0..size.height).flat_map(|y| row(y)[..size.width].to_vec()).collect::<Vec<_>>()
            };
            let depth_m = rows(&|y| cpu.depth_m.row(y).to_vec());
            // two roundings of depths below 4 m; the filter's offsets are a few centimetres
            let depth = Difference::of(&depth_m, &plane(3), 5e-7);
            let missing = |depth: &[f32]| depth.iter().map(|&d| d == 0.0).collect::<Vec<_>>();
            assert!(depth.is_within(0.0), "{size} depth: {depth}");
            assert_eq!(missing(&depth_m), missing(&plane(3)));
            for axis in 0..3 {
                let cpu = rows(&|y| cpu.normal_rows(y)[axis].to_vec());
                // such differences of depth near 1 m, over 1 to 2 pixels, times the focal length
                let tolerance = 2.0 * 5e-7 * f64::from(level.camera.fx);
                let normal = Difference::of(&cpu, &plane(axis), tolerance);
                assert!(normal.is_within(0.0), "{size} axis {axis}: {normal}");
            }
        }
        valid
    }

    #[test]
    fn every_level_equals_the_cpus() {
        let Some(gpu) = gpu() else { return };
        let standard = TrackingParams::default();
        let deep = TrackingParams { iterations: vec![1; 5], ..standard.clone() };
        for (width, height) in [(67, 43), (160, 120), (1, 1), (5, 2)] {
            let mut frame = corner_frame(camera(width, height), 3);
            let special = [f32::NAN, f32::INFINITY, -1.0, 0.9e-3, 1e3, 1e-40, f32::NEG_INFINITY];
            let pixels = frame.depth_m.as_mut_slice().iter_mut().skip(7);
            for (depth, special) in pixels.step_by(19).zip(special) {
                *depth = special;
            }
            for params in [&standard, &deep] {
                assert!(compare(gpu, params, &frame) > 0);
            }
        }
    }

    #[test]
    fn filters_of_any_radius() {
        let Some(gpu) = gpu() else { return };
        let frame = corner_frame(camera(67, 43), 4);
        // none, and on both sides of what a workgroup's memory holds
        for filter_radius in [0, 1, 24, 25] {
            compare(gpu, &TrackingParams { filter_radius, ..Default::default() }, &frame);
        }
    }

    #[test]
    fn hardly_any_depth() {
        let Some(gpu) = gpu() else { return };
        let mut frame = corner_frame(camera(67, 43), 5);
        frame.depth_m = Image::new(frame.depth_m.size(), 0.0);
        assert_eq!(compare(gpu, &TrackingParams::default(), &frame), 0);
        frame.depth_m[(30, 20)] = 1.0;
        assert_eq!(compare(gpu, &TrackingParams::default(), &frame), 1);
    }

    #[test]
    fn a_camera_without_pixels_has_no_levels() {
        let Some(gpu) = gpu() else { return };
        let pyramid = FramePyramid::new(gpu, &TrackingParams::default(), camera(0, 0)).unwrap();
        let pictures = FramePictures::new(gpu, Size::new(0, 0)).unwrap();
        let mut commands = gpu.commands();
        pyramid.record(&mut commands, &pictures).unwrap();
        commands.submit().unwrap();
        assert!(pyramid.levels.is_empty());
    }
}
