//! Draws virtual objects into geometry buffers, as [`crate::scene::Rasteriser`].
//!
//! ```text
//! 8 draws, shifted so that each sees one of the CPU's sample positions -> numbers of the nearest triangles
//! -> one pass over the objects' pixels: visibility against the real depth, shading
//! ```
//!
//! Which triangle is nearest is found by the device's own rasteriser; depth, normal and colour are
//! computed from the triangle's corners as on the CPU. What can differ is therefore the triangle at
//! samples that lie on an edge but for a step of the grid that the device rounds corners to: 1/256
//! pixel as on the CPU where it has 8 bits for them, which WebGPU does not promise.

mod models;
mod parts;
#[cfg(test)]
mod tests;
mod window;

use super::GpuVirtualLayer;
use crate::gpu::{
    Commands, Constant, Gpu, GpuBuffer, GpuError, GpuGBuffer, SampleTargets, Shader, ViewUniform,
    Window, uniform,
};
use crate::image::Size;
use crate::math::View;
use crate::scene::VirtualScene;
use crate::scene::raster::{CROSSING_RANGE, DEPTH_BIAS, MAX_SLOPE, NEAR_M, SAMPLES, sample_offset};
use crate::timing::Stage;
use models::GpuModels;
use parts::{Part, PartList};

uniform! {
    struct DrawUniform {
        clip_from_pixels: [f32; 2],
        sample_offset: [f32; 2],
        far_m: f32,
        perspective: u32,
        pad0: u32,
        pad1: u32,
    }
}

uniform! {
    struct ResolveUniform {
        view: ViewUniform,
        offsets: [[f32; 4]; 4],
        first_pixel: [u32; 2],
        pixels: [u32; 2],
        parts: u32,
        pad0: u32,
        pad1: u32,
        pad2: u32,
    }
}

fn draw_shader(masked: bool) -> Shader {
    Shader::new("raster/draw")
        .with_bool("MASKED", masked)
        .with("NEAR_M", Constant::F32(NEAR_M))
        .with_u32("MAX_TAPS", crate::scene::TEXTURE_TAPS)
}

fn resolve_shader() -> Shader {
    Shader::new("raster/resolve")
        .with_u32("SAMPLES", SAMPLES)
        .with("NEAR_M", Constant::F32(NEAR_M))
        .with_u32("MAX_TAPS", crate::scene::TEXTURE_TAPS)
        .with("DEPTH_BIAS", Constant::F32(DEPTH_BIAS))
        .with("CROSSING_RANGE", Constant::F32(CROSSING_RANGE))
        .with("MAX_SLOPE", Constant::F32(MAX_SLOPE))
}

#[cfg(test)]
pub(super) fn shaders() -> Vec<Shader> {
    vec![resolve_shader()]
}

#[cfg(test)]
pub(super) fn drawing_shaders() -> Vec<Shader> {
    [false, true].map(draw_shader).into()
}

/// What was drawn, as far as the host knows.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Drawn {
    /// Objects that may be in the picture.
    pub objects: usize,
    /// Outside, the picture is that of the real scene.
    pub window: Window,
}

/// The rasteriser: models, and targets of every size of picture that was drawn.
pub struct RasterPass {
    models: GpuModels,
    /// One list a view.
    parts: Vec<GpuBuffer<Part>>,
    targets: Vec<SampleTargets>,
}

impl RasterPass {
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self { models: GpuModels::new(gpu)?, parts: Vec::new(), targets: Vec::new() })
    }

    /// Sets `merged` to `real` with the virtual surfaces that are nearer, and `layer` to their base colour
    /// and coverage. Objects that wait for a place are not drawn.
    ///
    /// `view` counts the views of a submission: no two may have the same number.
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn draw(
        &mut self,
        commands: &mut Commands<'_>,
        view: usize,
        scene: &VirtualScene,
        real: &GpuGBuffer,
        (merged, layer): (&mut GpuGBuffer, &GpuVirtualLayer),
    ) -> Result<Drawn, GpuError> {
        let (gpu, size) = (commands.gpu(), real.size());
        let sizes = [real.view.size(), merged.size(), layer.size()];
        assert_eq!(sizes, [size; 3], "sizes of the rasteriser");
        commands.stage(Stage::Rendering);
        merged.view = real.view;
        commands.copy(real.surface.buffer(), merged.surface.buffer(), size.pixels());
        commands.copy(real.origin.buffer(), merged.origin.buffer(), size.pixels());
        commands.clear(layer.as_ref());
        self.models.follow(gpu, scene)?;
        let list = PartList::new(scene, &real.view, &self.models);
        let drawn = Drawn { objects: list.objects, window: list.window.clone() };
        if list.window.is_empty() || list.parts.is_empty() {
            return Ok(drawn);
        }
        let parts = uploaded(&mut self.parts, view, gpu, &list.parts)?;
        let targets = targets(&mut self.targets, gpu, size)?;
        for sample in 0..SAMPLES {
            let params = draw_uniform(&real.view, &list, sample);
            commands
                .drawing(&draw_shader(list.masked()))?
                .uniform(&params)?
                .read(&self.models.vertices)?
                .read(&self.models.triangles)?
                .read(parts)?
                .read(&self.models.texels)?
                .into_layer(targets, sample, &list.window, &list.draws)?;
        }
        commands
            .pass(&resolve_shader())?
            .uniform(&resolve_uniform(&real.view, &list))?
            .layers(targets)?
            .read(&self.models.vertices)?
            .read(&self.models.triangles)?
            .read(parts)?
            .read(&self.models.texels)?
            .read(&real.surface)?
            .write(&merged.surface)?
            .write(&merged.origin)?
            .write(layer)?
            .over(list.window.size())?;
        Ok(drawn)
    }
}

/// The list of a view, grown where it has too little room.
fn uploaded<'b>(
    buffers: &'b mut Vec<GpuBuffer<Part>>,
    view: usize,
    gpu: &Gpu,
    parts: &[Part],
) -> Result<&'b GpuBuffer<Part>, GpuError> {
    let room = |count: usize| GpuBuffer::new(gpu, "parts of objects", count.next_power_of_two());
    while buffers.len() <= view {
        buffers.push(room(1)?);
    }
    if buffers[view].len() < parts.len() {
        buffers[view] = room(parts.len())?;
    }
    buffers[view].upload(gpu, parts);
    Ok(&buffers[view])
}

fn targets<'t>(
    known: &'t mut Vec<SampleTargets>,
    gpu: &Gpu,
    size: Size,
) -> Result<&'t SampleTargets, GpuError> {
    let at = match known.iter().position(|targets| targets.size() == size) {
        Some(at) => at,
        None => {
            known.push(SampleTargets::new(gpu, size, SAMPLES)?);
            known.len() - 1
        }
    };
    Ok(&known[at])
}

fn draw_uniform(view: &View, list: &PartList, sample: usize) -> DrawUniform {
    let size = view.size();
    DrawUniform {
        clip_from_pixels: [2.0 / size.width as f32, 2.0 / size.height as f32],
        sample_offset: sample_offset(sample).to_array(),
        far_m: list.far_m,
        perspective: u32::from(view.is_perspective()),
        pad0: 0,
        pad1: 0,
    }
}

fn resolve_uniform(view: &View, list: &PartList) -> ResolveUniform {
    const { assert!(SAMPLES == 8, "two samples in each of four columns") };
    let offsets = std::array::from_fn(|column| {
        let [a, b] = [2 * column, 2 * column + 1].map(sample_offset);
        [a.x, a.y, b.x, b.y]
    });
    let Window { columns, rows } = &list.window;
    ResolveUniform {
        view: ViewUniform::new(view),
        offsets,
        first_pixel: [columns.start as u32, rows.start as u32],
        pixels: [columns.len() as u32, rows.len() as u32],
        parts: list.parts.len() as u32,
        pad0: 0,
        pad1: 0,
        pad2: 0,
    }
}
