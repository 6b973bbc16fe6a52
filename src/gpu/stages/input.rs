//! The Input stage: a raw frame goes up once, in the bytes it was recorded in.

use crate::capture::{ColorFilter, InputParams, RawFrame, RgbdFrame, input_tables};
use crate::gpu::{Commands, Gpu, GpuBuffer, GpuError, GpuImage, Shader, uniform};
use crate::image::{Image, Size};
use crate::timing::Stage;
use std::ops::Range;

uniform! {
    struct ColorUniform {
        size: [u32; 2],
        smoothing: u32,
        pad: u32,
    }
}

uniform! {
    /// Limits of valid depth as bit patterns, which order positive numbers as their values do.
    struct DepthUniform {
        pixels: u32,
        min_bits: u32,
        max_bits: u32,
        pad: u32,
    }
}

/// A frame on the device, as [`crate::capture::RgbdFrame`].
pub struct FramePictures {
    pub size: Size,
    /// The camera image as recorded: rows of three bytes a pixel, without padding, four bytes a word.
    pub color_srgb: GpuBuffer<u32>,
    /// Noise-filtered linear-light RGB in [0, 1]; the fourth value is encoded luma in 8-bit steps.
    pub color: GpuImage<[f32; 4]>,
    /// z-depth in metres; missing = 0.0.
    pub depth_m: GpuImage<f32>,
}

impl FramePictures {
    pub fn new(gpu: &Gpu, size: Size) -> Result<Self, GpuError> {
        Ok(Self {
            size,
            color_srgb: GpuBuffer::new(gpu, "recorded colour", (3 * size.pixels()).div_ceil(4))?,
            color: GpuImage::new(gpu, "linear colour", size)?,
            depth_m: GpuImage::new(gpu, "depth", size)?,
        })
    }

    /// Sets all pictures to those of a frame that was prepared on the host.
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn upload(&self, gpu: &Gpu, frame: &RgbdFrame) {
        self.color_srgb.upload_bytes(gpu, frame.color_srgb.as_slice().as_flattened());
        self.depth_m.upload(gpu, &frame.depth_m);
        let light = frame.color.as_slice().iter().zip(frame.intensity.as_slice());
        let color = light.map(|(&[r, g, b], &steps)| [r, g, b, steps]).collect();
        self.color.upload(gpu, &Image::from_vec(frame.color.size(), color));
    }
}

pub(super) fn shaders() -> [Shader; 2] {
    let roots = input_tables().steps_from_root.len() - 2;
    [Shader::new("input/color").with_u32("ROOTS", roots), Shader::new("input/depth")]
}

/// Uploads frames and filters them.
pub struct InputPass {
    params: InputParams,
    color: Shader,
    depth: Shader,
    /// Linear light of the 256 codes, then the curve of encoded intensity.
    tables: GpuBuffer<f32>,
}

impl InputPass {
    pub fn new(gpu: &Gpu, params: &InputParams) -> Result<Self, GpuError> {
        let tables = input_tables();
        let [color, depth] = shaders();
        Ok(Self {
            params: params.clone(),
            color,
            depth,
            tables: GpuBuffer::from_slice(
                gpu,
                "sRGB curves",
                &[&tables.linear_from_code[..], tables.steps_from_root].concat(),
            )?,
        })
    }

    /// Uploads `raw` and records the passes that make `out` of it.
    ///
    /// # Panics
    /// If the sizes of `raw` and `out` differ.
    pub fn run(
        &self,
        commands: &mut Commands<'_>,
        raw: &RawFrame,
        out: &FramePictures,
    ) -> Result<(), GpuError> {
        let (gpu, size) = (commands.gpu(), out.size);
        assert_eq!(raw.color.size(), size, "colour of the frame");
        out.color_srgb.upload_bytes(gpu, raw.color.as_slice().as_flattened());
        out.depth_m.upload(gpu, &raw.depth_m);

        commands.stage(Stage::Input);
        let limits = DepthUniform {
            pixels: size.pixels() as u32,
            min_bits: self.params.min_depth_m.max(f32::MIN_POSITIVE).to_bits(),
            max_bits: self.params.max_depth_m.to_bits(),
            pad: 0,
        };
        commands
            .pass(&self.depth)?
            .uniform(&limits)?
            .write(&out.depth_m)?
            .over_count(size.pixels())?;
        let color = ColorUniform {
            size: [size.width as u32, size.height as u32],
            smoothing: match self.params.color_filter {
                ColorFilter::None => 0,
                ColorFilter::Gaussian => 1,
                ColorFilter::Median => 2,
            },
            pad: 0,
        };
        commands
            .pass(&self.color)?
            .uniform(&color)?
            .read(&self.tables)?
            .read(&out.color_srgb)?
            .write(&out.color)?
            .over(size)
    }

    /// How much of a raw depth picture passes this stage and lies within `range_m`, 0 to 1: counted on the
    /// host, so that nobody has to wait for it.
    pub fn depth_share(&self, depth_m: &Image<f32>, range_m: &Range<f32>) -> f32 {
        let passing = self.params.min_depth_m..=self.params.max_depth_m;
        let depths = depth_m.as_slice().iter();
        let usable = depths.filter(|&d| passing.contains(d) & range_m.contains(d)).count();
        usable as f32 / depth_m.size().pixels().max(1) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::InputStage;
    use crate::gpu::stages::test_support::gpu;
    use crate::math::random::Rng;
    use crate::parity::tolerances::{INPUT_COLOR, INPUT_INTENSITY};

    fn raw(size: Size, seed: u32) -> RawFrame {
        let mut rng = Rng::new(&[seed]);
        let color = (0..size.pixels()).map(|_| [0; 3].map(|_: i32| rng.next_u32() as u8)).collect();
        let special = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, -0.0, 1e-40, 0.2, 8.0];
        let depth = (0..size.pixels()).map(|i| match special.get(i % 16) {
            Some(&special) => special,
            None => 10.0 * rng.uniform(),
        });
        RawFrame {
            index: 0,
            timestamp_s: 0.0,
            color: Image::from_vec(size, color),
            depth_m: Image::from_vec(size, depth.collect()),
            world_from_camera: None,
            exposure_s: None,
        }
    }

    #[test]
    fn input_equals_the_cpu_up_to_the_border() {
        let Some(gpu) = gpu() else { return };
        let sizes = [(67, 43), (1, 1), (1, 5), (3, 1), (2, 3), (160, 120)];
        for (width, height) in sizes {
            let size = Size::new(width, height);
            for color_filter in [ColorFilter::None, ColorFilter::Gaussian, ColorFilter::Median] {
                let params = InputParams { color_filter, ..InputParams::default() };
                let frame = raw(size, 7);
                let pictures = FramePictures::new(gpu, size).unwrap();
                let pass = InputPass::new(gpu, &params).unwrap();
                let mut commands = gpu.commands();
                pass.run(&mut commands, &frame, &pictures).unwrap();
                commands.submit().unwrap();
                let color = pictures.color.buffer().download(gpu).unwrap();
                let depth_m = pictures.depth_m.buffer().download(gpu).unwrap();

                let range_m = 0.3..4.0;
                let share = pass.depth_share(&frame.depth_m, &range_m);
                let mut expected = RgbdFrame::default();
                InputStage::new(&params).prepare(frame, &mut expected);
                let rgb: Vec<f32> = color.iter().flat_map(|c| [c[0], c[1], c[2]]).collect();
                let steps: Vec<f32> = color.iter().map(|c| c[3]).collect();
                assert_eq!(depth_m, expected.depth_m.as_slice());
                let usable = depth_m.iter().filter(|d| range_m.contains(*d)).count();
                assert_eq!(share, usable as f32 / size.pixels() as f32);
                let light = expected.color.as_slice().as_flattened();
                let (found, within) = INPUT_COLOR.compare(gpu, light, &rgb);
                assert!(within, "{size} {color_filter:?} colour: {found}");
                let intensity = expected.intensity.as_slice();
                let (found, within) = INPUT_INTENSITY.compare(gpu, intensity, &steps);
                assert!(within, "{size} {color_filter:?} intensity: {found}");
            }
        }
    }
}
