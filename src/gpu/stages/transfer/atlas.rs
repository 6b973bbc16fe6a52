//! The pixels of all views one after the other, so that a shader has them in one binding.

use super::uniforms::{LimitsUniform, MAX_VIEWS};
use crate::gpu::{Commands, Gpu, GpuBuffer, GpuError, GpuGBuffer, GpuImage, Shader, ViewUniform};
use crate::math::View;
use bytemuck::Pod;

/// A main buffer and its auxiliary buffers.
pub type GpuBuffers<'a> = (&'a GpuGBuffer, &'a [GpuGBuffer]);

/// Radiance that leaves the pixels of a main buffer and of its auxiliary buffers: linear RGB, the
/// fourth value is not used.
pub type GpuRadiance<'a> = (&'a GpuImage<[f32; 4]>, &'a [GpuImage<[f32; 4]>]);

/// Words that tell where the virtual pixels of a view are; `EXTENT_WORDS` in `transfer/emitter.wgsl`.
const EXTENT_WORDS: usize = 5;

pub fn limits_shader() -> Shader {
    Shader::new("transfer/limits")
}

pub fn insert_shader() -> Shader {
    Shader::new("transfer/insert")
}

/// What samples are looked up in.
pub struct Atlas {
    bias_m: f32,
    /// Views of the real scene, and the first pixel of each.
    views: Vec<(View, usize)>,
    /// Depth beyond which samples are hidden, by real surfaces, and by virtual ones too.
    pub real_limits_m: GpuBuffer<f32>,
    pub limits_m: GpuBuffer<f32>,
    /// Surface and radiance of pixels of the merged buffers.
    pub emitters: GpuBuffer<[f32; 8]>,
    pub extents: GpuBuffer<u32>,
}

impl Atlas {
    pub fn new(gpu: &Gpu, bias_m: f32) -> Result<Self, GpuError> {
        Ok(Self {
            bias_m,
            views: Vec::with_capacity(MAX_VIEWS),
            real_limits_m: GpuBuffer::new(gpu, "depth limits", 1)?,
            limits_m: GpuBuffer::new(gpu, "depth limits with virtual surfaces", 1)?,
            emitters: GpuBuffer::new(gpu, "emitters", 1)?,
            extents: GpuBuffer::new(gpu, "virtual pixels", EXTENT_WORDS * MAX_VIEWS)?,
        })
    }

    pub fn views(&self) -> &[(View, usize)] {
        &self.views
    }

    /// Shows buffers without virtual surfaces.
    ///
    /// # Panics
    /// If there are more views than [`MAX_VIEWS`].
    pub fn show(
        &mut self,
        commands: &mut Commands<'_>,
        (main, auxiliary): GpuBuffers,
    ) -> Result<(), GpuError> {
        assert!(auxiliary.len() < MAX_VIEWS, "{} auxiliary views", auxiliary.len());
        self.views.clear();
        let mut pixels = 0;
        for buffer in std::iter::once(main).chain(auxiliary) {
            self.views.push((buffer.view, pixels));
            pixels += buffer.size().pixels();
        }
        grow(commands.gpu(), &mut self.real_limits_m, pixels)?;
        for (i, buffer) in std::iter::once(main).chain(auxiliary).enumerate() {
            commands
                .pass(&limits_shader())?
                .uniform(&self.limits_of(i))?
                .read(&buffer.surface)?
                .write(&self.real_limits_m)?
                .over(buffer.size())?;
        }
        Ok(())
    }

    /// Adds virtual surfaces; `merged` must differ from the buffers of [`Self::show`] in these alone.
    ///
    /// # Panics
    /// If sizes or the number of buffers differ.
    pub fn insert(
        &mut self,
        commands: &mut Commands<'_>,
        (main, auxiliary): GpuBuffers,
        radiance: Option<GpuRadiance>,
    ) -> Result<(), GpuError> {
        let sizes = std::iter::once(main).chain(auxiliary).map(GpuGBuffer::size);
        assert!(self.views.iter().map(|(view, _)| view.size()).eq(sizes), "merged buffers");
        grow(commands.gpu(), &mut self.limits_m, self.real_limits_m.len())?;
        grow(commands.gpu(), &mut self.emitters, self.real_limits_m.len())?;
        commands.clear(&self.extents);
        for (i, buffer) in std::iter::once(main).chain(auxiliary).enumerate() {
            let radiance = radiance.map(|(main, auxiliary)| match i.checked_sub(1) {
                None => main,
                Some(k) => &auxiliary[k],
            });
            // without radiance it is not used, but something must be bound
            let radiance = radiance.unwrap_or(&buffer.surface);
            assert_eq!(radiance.size(), buffer.size(), "radiance of a buffer");
            commands
                .pass(&insert_shader())?
                .uniform(&self.limits_of(i))?
                .read(&buffer.surface)?
                .read(&buffer.origin)?
                .read(radiance)?
                .read(&self.real_limits_m)?
                .write(&self.limits_m)?
                .write(&self.emitters)?
                .write(&self.extents)?
                .over(buffer.size())?;
        }
        Ok(())
    }

    fn limits_of(&self, i: usize) -> LimitsUniform {
        let (view, first) = &self.views[i];
        LimitsUniform {
            view: ViewUniform::new(view),
            bias_m: self.bias_m,
            first: *first as u32,
            extent: i as u32,
            pad: 0,
        }
    }
}

/// Makes room, and forgets what was there where there was too little.
fn grow<T: Pod>(gpu: &Gpu, buffer: &mut GpuBuffer<T>, len: usize) -> Result<(), GpuError> {
    if buffer.len() < len {
        *buffer = GpuBuffer::new(gpu, buffer.label(), len)?;
    }
    Ok(())
}
