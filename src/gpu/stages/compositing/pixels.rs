//! From full-resolution shading to display pixels.

use super::grid::pair;
use super::lamp::LampUniform;
use super::{Frame, GpuComposeInput, GpuPicture};
use crate::compositing::{
    CompositingParams, Compositor, MAX_RATIO, MAX_VISIBILITY, SHOULDER, SRGB,
};
use crate::gpu::{Commands, Constant, Gpu, GpuBuffer, GpuError, GpuImage, Shader, uniform};
use crate::image::Size;
use crate::math::color::LINEAR_FROM_SRGB8;

uniform! {
    struct VirtualLightUniform {
        lamp: LampUniform,
        size: [u32; 2],
        mean_albedo: f32,
        pad: u32,
    }
}

uniform! {
    struct PixelsUniform {
        size: [u32; 2],
        floor: f32,
        mean_albedo: f32,
    }
}

pub fn virtual_light_shader(planes: usize, visibility: bool, antialias: bool) -> Shader {
    Shader::new("compositing/virtual_light")
        .with_u32("PLANES", planes)
        .with("MAX_VISIBILITY", Constant::F32(MAX_VISIBILITY))
        .with_bool("VISIBILITY", visibility)
        .with_bool("ANTIALIAS", antialias)
        .with("SHOULDER", Constant::F32(SHOULDER))
}

pub fn pixels_shader(planes: usize, compositor: Compositor) -> Shader {
    let (codes, begins) = SRGB.tables();
    let decoder = LINEAR_FROM_SRGB8.len();
    Shader::new("compositing/pixels")
        .with_u32("PLANES", planes)
        .with_bool("DIFFERENCE", compositor == Compositor::Difference)
        .with("MAX_RATIO", Constant::F32(MAX_RATIO))
        .with_u32("BEGINS", decoder)
        .with_u32("CODES", decoder + begins.len())
        .with_u32("BUCKETS", codes.len() - 1)
}

pub struct Pixels {
    antialias: bool,
    compositor: Compositor,
    /// Linear light of virtual pixels and covered shares.
    virtual_light: GpuImage<[f32; 4]>,
    tables: GpuBuffer<f32>,
}

impl Pixels {
    pub fn new(gpu: &Gpu, params: &CompositingParams, size: Size) -> Result<Self, GpuError> {
        let (codes, begins) = SRGB.tables();
        let codes: Vec<f32> = codes.iter().copied().map(f32::from).collect();
        let tables = [&LINEAR_FROM_SRGB8[..], &begins, &codes].concat();
        Ok(Self {
            antialias: params.antialias,
            compositor: params.compositor,
            virtual_light: GpuImage::new(gpu, "virtual light", size)?,
            tables: GpuBuffer::from_slice(gpu, "sRGB tables", &tables)?,
        })
    }

    /// Light of virtual pixels; turns what `shading` holds of them into R'.
    pub fn light(
        &self,
        commands: &mut Commands<'_>,
        frame: &Frame,
        input: &GpuComposeInput,
        shading: &GpuBuffer<[f32; 4]>,
    ) -> Result<(), GpuError> {
        let light = VirtualLightUniform {
            lamp: LampUniform::new(&frame.lamp),
            size: pair(frame.size),
            mean_albedo: input.mean_albedo,
            pad: 0,
        };
        commands
            .pass(&virtual_light_shader(frame.planes, frame.visibility, self.antialias))?
            .uniform(&light)?
            .read(&input.merged.surface)?
            .read(&input.merged.origin)?
            .read(input.layer)?
            .write(shading)?
            .write(&self.virtual_light)?
            .over(frame.size)
    }

    /// `means` holds the exposure where the compositor needs it.
    pub fn write(
        &self,
        commands: &mut Commands<'_>,
        frame: &Frame,
        input: &GpuComposeInput,
        (shading, means): (&GpuBuffer<[f32; 4]>, &GpuBuffer<[f32; 4]>),
        out: &GpuPicture,
    ) -> Result<(), GpuError> {
        let pixels = PixelsUniform {
            size: pair(frame.size),
            floor: frame.lamp.floor,
            mean_albedo: input.mean_albedo,
        };
        commands
            .pass(&pixels_shader(frame.planes, self.compositor))?
            .uniform(&pixels)?
            .read(&input.frame.color_srgb)?
            .read(shading)?
            .read(&self.virtual_light)?
            .read(&self.tables)?
            .read(means)?
            .write(&out.bytes)?
            .over_count(frame.size.pixels())
    }
}
