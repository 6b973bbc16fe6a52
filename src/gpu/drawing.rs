//! Triangles through the rasteriser of the device: what [`super::pipeline`] and [`super::commands`] are for
//! compute shaders.

use super::pipeline::{Pipeline, Reflection, parse};
use super::profile::Profile;
use super::roofline::Work;
use super::{Gpu, GpuError, Pass, Shader};
use crate::image::Size;
use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;
use wgpu::{ShaderStages, TextureFormat, TextureUsages, TextureViewDimension};

/// Numbers of triangles.
const NUMBER_FORMAT: TextureFormat = TextureFormat::R32Uint;
const DEPTH_FORMAT: TextureFormat = TextureFormat::Depth32Float;

/// Layers of one number a pixel, 0 where nothing was drawn; all share one depth buffer.
pub struct SampleTargets {
    size: Size,
    layers: Vec<wgpu::TextureView>,
    all: wgpu::TextureView,
    depth: wgpu::TextureView,
}

impl SampleTargets {
    pub fn new(gpu: &Gpu, size: Size, layers: usize) -> Result<Self, GpuError> {
        let most = gpu.limits().max_texture_dimension_2d;
        if size.width.max(size.height) > most as usize || size.pixels() == 0 {
            let what = format!("a picture of {size}: it may be 1 to {most} pixels wide and high");
            return Err(GpuError::OutOfMemory { what });
        }
        let texture = |label, format, layers: usize, usage| {
            gpu.device().create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d {
                    width: size.width as u32,
                    height: size.height as u32,
                    depth_or_array_layers: layers as u32,
                },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: usage | TextureUsages::RENDER_ATTACHMENT,
                view_formats: &[],
            })
        };
        let numbers = texture("triangles", NUMBER_FORMAT, layers, TextureUsages::TEXTURE_BINDING);
        let depth = texture("nearness", DEPTH_FORMAT, 1, TextureUsages::empty());
        let layer = |layer: usize| {
            numbers.create_view(&wgpu::TextureViewDescriptor {
                dimension: Some(TextureViewDimension::D2),
                base_array_layer: layer as u32,
                array_layer_count: Some(1),
                ..Default::default()
            })
        };
        let made = Self {
            size,
            layers: (0..layers).map(layer).collect(),
            all: numbers.create_view(&wgpu::TextureViewDescriptor {
                dimension: Some(TextureViewDimension::D2Array),
                ..Default::default()
            }),
            depth: depth.create_view(&Default::default()),
        };
        gpu.check()?;
        Ok(made)
    }

    pub fn size(&self) -> Size {
        self.size
    }

    pub(super) fn all_layers(&self) -> &wgpu::TextureView {
        &self.all
    }
}

/// Columns and rows of a picture.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Window {
    pub columns: Range<usize>,
    pub rows: Range<usize>,
}

impl Window {
    pub fn size(&self) -> Size {
        Size::new(self.columns.len(), self.rows.len())
    }

    pub fn is_empty(&self) -> bool {
        self.columns.is_empty() || self.rows.is_empty()
    }
}

/// Vertices of whole triangles, and the instance whose number they are drawn with.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Draw {
    pub vertices: Range<u32>,
    pub instance: u32,
}

/// Of the rasteriser's own work nothing is counted: a number for each pixel is written, and an index for
/// each vertex is read. Depth need not leave the device's tiles.
fn drawing_work(window: &Window, draws: &[Draw]) -> Work {
    let vertices: usize = draws.iter().map(|draw| draw.vertices.len()).sum();
    Work {
        invocations: vertices as u64,
        bytes_read: 4 * vertices as u64,
        bytes_written: 4 * window.size().pixels() as u64,
        ..Work::default()
    }
}

impl Pass<'_, '_, wgpu::RenderPipeline> {
    /// Clears a layer and draws into the pixels of `window`, in the order of the list. Of two triangles the
    /// one with greater depth stays, of equal ones the first.
    ///
    /// # Panics
    /// If there is no such layer, or the window is not within it.
    pub fn into_layer(
        self,
        targets: &SampleTargets,
        layer: usize,
        window: &Window,
        draws: &[Draw],
    ) -> Result<(), GpuError> {
        let size = targets.size;
        let fits = window.columns.end <= size.width && window.rows.end <= size.height;
        assert!(fits && !window.is_empty(), "{window:?} of {size}");
        let group = self.bind_group()?;
        let Self { commands, pipeline, .. } = self;
        let stage = commands.stage;
        let profile = commands.gpu().profiling();
        if let Some(profile) = profile {
            profile.before(commands)?;
        }
        let timestamp_writes = match profile.and_then(Profile::queries) {
            Some(query_set) => Some(wgpu::RenderPassTimestampWrites {
                query_set,
                beginning_of_pass_write_index: Some(0),
                end_of_pass_write_index: Some(1),
            }),
            None => commands.marks.as_mut().and_then(|m| m.next_drawing(stage)),
        };
        let mut pass = commands.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some(pipeline.shader.file),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &targets.layers[layer],
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                    store: wgpu::StoreOp::Store,
                },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &targets.depth,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(0.0),
                    store: wgpu::StoreOp::Discard,
                }),
                stencil_ops: None,
            }),
            timestamp_writes,
            occlusion_query_set: None,
            multiview_mask: None,
        });
        pass.set_pipeline(&pipeline.raw);
        pass.set_bind_group(0, &group, &[]);
        let [x, y] = [window.columns.start as u32, window.rows.start as u32];
        pass.set_scissor_rect(x, y, window.columns.len() as u32, window.rows.len() as u32);
        for draw in draws {
            pass.draw(draw.vertices.clone(), draw.instance..draw.instance + 1);
        }
        drop(pass);
        let Some(profile) = profile else { return Ok(()) };
        let pixels = [window.columns.len() as u32, window.rows.len() as u32, 1];
        profile.after(commands, &pipeline.shader, pixels, Err(drawing_work(window, draws)))
    }
}

impl Pipeline<wgpu::RenderPipeline> {
    pub(super) fn compile_drawing(gpu: &Gpu, shader: &Shader) -> Result<Arc<Self>, GpuError> {
        let module = parse(shader)?;
        let reflection = Reflection::of_drawing(shader, &module)?;
        let module = gpu.device().create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(shader.file),
            source: wgpu::ShaderSource::Naga(Cow::Owned(module)),
        });
        Self::with(gpu, shader, reflection, None, ShaderStages::VERTEX_FRAGMENT, |layout| {
            gpu.device().create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(shader.file),
                layout: Some(layout),
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some("vertex_main"),
                    compilation_options: Default::default(),
                    buffers: &[],
                },
                // both sides are seen
                primitive: wgpu::PrimitiveState { cull_mode: None, ..Default::default() },
                depth_stencil: Some(wgpu::DepthStencilState {
                    format: DEPTH_FORMAT,
                    depth_write_enabled: Some(true),
                    depth_compare: Some(wgpu::CompareFunction::Greater),
                    stencil: Default::default(),
                    bias: Default::default(),
                }),
                multisample: Default::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some("fragment_main"),
                    compilation_options: Default::default(),
                    targets: &[Some(NUMBER_FORMAT.into())],
                }),
                multiview_mask: None,
                cache: None,
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::stages::test_support::gpu;

    #[test]
    fn what_does_not_fit_is_an_error() {
        let Some(gpu) = gpu() else { return };
        let wide = Size::new(gpu.limits().max_texture_dimension_2d as usize + 1, 1);
        for size in [wide, Size::new(0, 7)] {
            let error = SampleTargets::new(gpu, size, 8).err().unwrap();
            assert!(error.to_string().contains(&size.to_string()), "{error}");
        }
        let mut commands = gpu.commands();
        let computes = Shader::new("exitant/radiance");
        let error = commands.drawing(&computes).err().unwrap();
        assert!(error.to_string().contains("vertex_main"), "{error}");

        let shader = crate::gpu::stages::drawing_shaders().remove(0);
        let targets = SampleTargets::new(gpu, Size::new(3, 2), 1).unwrap();
        let window = Window { columns: 0..3, rows: 0..2 };
        let unbound = commands.drawing(&shader).unwrap().into_layer(&targets, 0, &window, &[]);
        assert!(unbound.unwrap_err().to_string().contains("0 bindings are given"));
    }
}
