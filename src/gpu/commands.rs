//! Passes, recorded one after the other and submitted together.

use super::device::ARENA_BYTES;
use super::pipeline::{Access, Pipeline};
use super::profile::Profile;
use super::roofline::Work;
use super::stage_timer::{PassMarks, StageTimer};
use super::{Gpu, GpuBuffer, GpuError, SampleTargets, Shader, Uniform};
use crate::image::Size;
use crate::timing::Stage;
use bytemuck::Pod;
use std::sync::Arc;

/// Alignment of uniform bindings that every device accepts.
const UNIFORM_ALIGNMENT: usize = 256;

/// What is recorded for one submission.
pub struct Commands<'g> {
    gpu: &'g Gpu,
    pub(super) encoder: wgpu::CommandEncoder,
    parameters: Vec<u8>,
    pub(super) stage: Stage,
    pub(super) marks: Option<PassMarks>,
    /// Copies and clears since the last pass.
    pub(super) copies: Option<Work>,
}

impl<'g> Commands<'g> {
    pub(super) fn new(gpu: &'g Gpu) -> Self {
        let encoder = gpu.device().create_command_encoder(&Default::default());
        Self {
            gpu,
            encoder,
            parameters: Vec::new(),
            stage: Stage::Input,
            marks: None,
            copies: None,
        }
    }

    /// Measures passes from here on, where there is a timer, over all submissions until
    /// [`Self::submit_timed`].
    pub fn timed(mut self, timer: Option<&StageTimer>) -> Self {
        // passes that are measured one by one have queries of their own
        let timer = timer.filter(|_| self.gpu.profiling().is_none());
        self.marks = timer.map(StageTimer::marks);
        self
    }

    /// Whether the passes that follow are measured, where there is a timer.
    pub fn measure(&mut self, on: bool) {
        if let Some(marks) = &mut self.marks {
            marks.paused = !on;
        }
    }

    pub fn gpu(&self) -> &'g Gpu {
        self.gpu
    }

    /// The passes that follow are part of this stage.
    pub fn stage(&mut self, stage: Stage) -> &mut Self {
        self.stage = stage;
        self
    }

    /// Starts a pass; its bindings are given in the order of their numbers in the shader.
    pub fn pass(&mut self, shader: &Shader) -> Result<Pass<'_, 'g>, GpuError> {
        let pipeline = self.gpu.pipeline(shader)?;
        Ok(Pass { commands: self, pipeline, bound: Vec::new() })
    }

    /// Starts drawing; bindings as in [`Self::pass`].
    pub fn drawing(
        &mut self,
        shader: &Shader,
    ) -> Result<Pass<'_, 'g, wgpu::RenderPipeline>, GpuError> {
        let pipeline = self.gpu.drawing_pipeline(shader)?;
        Ok(Pass { commands: self, pipeline, bound: Vec::new() })
    }

    /// Copies the first `len` values.
    pub fn copy<T: Pod>(&mut self, from: &GpuBuffer<T>, to: &GpuBuffer<T>, len: usize) {
        let bytes = (len * size_of::<T>()) as u64;
        self.note_copy(bytes, bytes);
        self.encoder.copy_buffer_to_buffer(from.raw(), 0, to.raw(), 0, bytes);
    }

    /// Zeros the whole buffer.
    pub fn clear<T: Pod>(&mut self, buffer: &GpuBuffer<T>) {
        self.note_copy(0, buffer.raw().size());
        self.encoder.clear_buffer(buffer.raw(), 0, None);
    }

    pub(super) fn note_copy(&mut self, bytes_read: u64, bytes_written: u64) {
        let work = Work { bytes_read, bytes_written, ..Work::default() };
        self.copies = Some(self.copies.unwrap_or_default() + work);
    }

    /// Hands everything to the device; `timer`, the one that was given to [`Self::timed`], has the
    /// times when the device is done.
    pub fn submit_timed(mut self, timer: Option<&mut StageTimer>) -> Result<(), GpuError> {
        if let (Some(marks), Some(timer)) = (self.marks.take(), timer) {
            timer.finish(marks, &mut self);
        }
        self.submit()
    }

    /// Hands everything to the device.
    pub fn submit(mut self) -> Result<(), GpuError> {
        match self.gpu.profiling() {
            Some(profile) => profile.before(&mut self),
            None => self.gpu.hand_over(self.encoder, &self.parameters).map(|_| ()),
        }
    }

    /// Hands what is recorded so far to the device, and goes on recording.
    pub fn flush(&mut self) -> Result<wgpu::SubmissionIndex, GpuError> {
        if let Some(profile) = self.gpu.profiling() {
            profile.before(self)?;
        }
        let recorded = self.take_recorded();
        self.gpu.hand_over(recorded, &std::mem::take(&mut self.parameters))
    }

    /// Submits what is recorded so far, and waits for the device; a pass may be in the making.
    pub(super) fn flush_and_wait(&mut self) -> Result<(), GpuError> {
        let recorded = self.take_recorded();
        // all parameters again, as passes to come have places behind them
        self.gpu.hand_over(recorded, &self.parameters)?;
        self.gpu.wait()
    }

    fn take_recorded(&mut self) -> wgpu::CommandEncoder {
        let next = self.gpu.device().create_command_encoder(&Default::default());
        std::mem::replace(&mut self.encoder, next)
    }
}

enum Bound {
    /// Offset and bytes in the arena.
    Uniform(u64, u64),
    Storage(wgpu::Buffer),
    Layers(wgpu::TextureView),
}

/// One dispatch, or one set of draws, in the making.
#[must_use = "a pass runs when it is dispatched"]
pub struct Pass<'c, 'g, R = wgpu::ComputePipeline> {
    pub(super) commands: &'c mut Commands<'g>,
    pub(super) pipeline: Arc<Pipeline<R>>,
    bound: Vec<Bound>,
}

impl<R> Pass<'_, '_, R> {
    pub fn uniform<T: Uniform>(mut self, value: &T) -> Result<Self, GpuError> {
        self.pipeline.expect_uniform::<T>(self.bound.len())?;
        let parameters = &mut self.commands.parameters;
        let offset = parameters.len().next_multiple_of(UNIFORM_ALIGNMENT);
        let end = (offset + size_of::<T>()).next_multiple_of(4);
        if end as u64 > ARENA_BYTES {
            let what = "parameters of one submission".to_owned();
            return Err(GpuError::OutOfMemory { what });
        }
        parameters.resize(end, 0);
        parameters[offset..offset + size_of::<T>()].copy_from_slice(bytemuck::bytes_of(value));
        self.bound.push(Bound::Uniform(offset as u64, size_of::<T>() as u64));
        Ok(self)
    }

    /// A storage buffer that the shader only reads.
    pub fn read<T: Pod>(self, buffer: &impl AsRef<GpuBuffer<T>>) -> Result<Self, GpuError> {
        self.bind(Access::Read, buffer.as_ref())
    }

    /// A storage buffer that the shader writes, or reads and writes.
    pub fn write<T: Pod>(self, buffer: &impl AsRef<GpuBuffer<T>>) -> Result<Self, GpuError> {
        self.bind(Access::ReadWrite, buffer.as_ref())
    }

    fn bind<T: Pod>(mut self, access: Access, buffer: &GpuBuffer<T>) -> Result<Self, GpuError> {
        self.pipeline.expect(self.bound.len(), access)?;
        if buffer.is_empty() {
            let problem = format!("{} is empty", buffer.label());
            return Err(self.pipeline.binding_error(self.bound.len(), problem));
        }
        self.bound.push(Bound::Storage(buffer.raw().clone()));
        Ok(self)
    }

    /// All layers that were drawn into.
    pub fn layers(mut self, targets: &SampleTargets) -> Result<Self, GpuError> {
        self.pipeline.expect(self.bound.len(), Access::Layers)?;
        self.bound.push(Bound::Layers(targets.all_layers().clone()));
        Ok(self)
    }

    /// What was bound, which must be all that the shader wants.
    pub(super) fn bind_group(&self) -> Result<wgpu::BindGroup, GpuError> {
        let (gpu, pipeline, bound) = (self.commands.gpu, &self.pipeline, &self.bound);
        let wanted = pipeline.reflection.bindings.len();
        if bound.len() != wanted {
            let problem = format!("{} bindings are given, the shader has {wanted}", bound.len());
            return Err(pipeline.binding_error(bound.len(), problem));
        }
        let entries: Vec<_> = bound.iter().enumerate().map(|(i, b)| b.entry(gpu, i)).collect();
        Ok(gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(pipeline.shader.file),
            layout: &pipeline.layout,
            entries: &entries,
        }))
    }
}

impl Pass<'_, '_> {
    /// One invocation a pixel, rounded up to whole workgroups.
    pub fn over(self, size: Size) -> Result<(), GpuError> {
        self.over_3d([size.width, size.height, 1])
    }

    /// One invocation for each of `count`, rounded up to whole workgroups.
    pub fn over_count(self, count: usize) -> Result<(), GpuError> {
        self.over_3d([count, 1, 1])
    }

    /// One invocation a cell, rounded up to whole workgroups.
    pub fn over_3d(self, cells: [usize; 3]) -> Result<(), GpuError> {
        let workgroup = self.pipeline.reflection.workgroup;
        let groups = std::array::from_fn(|i| cells[i].div_ceil(workgroup[i] as usize) as u32);
        self.workgroups(groups)
    }

    /// Runs this many workgroups; none is an error, as it would silently do nothing.
    pub fn workgroups(self, groups: [u32; 3]) -> Result<(), GpuError> {
        self.dispatch(groups.contains(&0), groups, |pass| {
            pass.dispatch_workgroups(groups[0], groups[1], groups[2]);
        })
    }

    /// Runs as many workgroups as the first three values of `groups` say.
    pub fn workgroups_from(self, groups: &GpuBuffer<u32>) -> Result<(), GpuError> {
        self.dispatch(false, [1; 3], |pass| pass.dispatch_workgroups_indirect(groups.raw(), 0))
    }

    fn dispatch(
        mut self,
        empty: bool,
        groups: [u32; 3],
        run: impl FnOnce(&mut wgpu::ComputePass<'_>),
    ) -> Result<(), GpuError> {
        let profile = self.commands.gpu.profiling();
        if let (Some(profile), Some(_)) = (profile, &self.pipeline.counted) {
            self.bound.push(Bound::Storage(profile.counts().raw().clone()));
        }
        let group = self.bind_group()?;
        let Self { commands, pipeline, .. } = self;
        let most = commands.gpu.limits().max_compute_workgroups_per_dimension;
        if empty || groups.iter().any(|&n| n > most) {
            let problem = format!("{groups:?} workgroups; 1 to {most} can be run");
            return Err(GpuError::Shader { shader: pipeline.shader.file.to_owned(), problem });
        }
        let stage = commands.stage;
        if let Some(profile) = profile {
            profile.before(commands)?;
        }
        let timestamp_writes = match profile.and_then(Profile::queries) {
            Some(query_set) => Some(wgpu::ComputePassTimestampWrites {
                query_set,
                beginning_of_pass_write_index: Some(0),
                end_of_pass_write_index: Some(1),
            }),
            None => commands.marks.as_mut().and_then(|m| m.next(stage)),
        };
        let mut pass = commands.encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some(pipeline.shader.file),
            timestamp_writes,
        });
        pass.set_pipeline(&pipeline.raw);
        pass.set_bind_group(0, &group, &[]);
        run(&mut pass);
        drop(pass);
        match (profile, &pipeline.counted) {
            (Some(profile), counted) => {
                let counted = counted.as_ref().ok_or_else(Work::default);
                profile.after(commands, &pipeline.shader, groups, counted)
            }
            (None, _) => Ok(()),
        }
    }
}

impl Bound {
    fn entry<'a>(&'a self, gpu: &'a Gpu, number: usize) -> wgpu::BindGroupEntry<'a> {
        let resource = match self {
            Self::Uniform(offset, bytes) => wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                buffer: &gpu.arena,
                offset: *offset,
                size: std::num::NonZeroU64::new(*bytes),
            }),
            Self::Storage(buffer) => buffer.as_entire_binding(),
            Self::Layers(view) => wgpu::BindingResource::TextureView(view),
        };
        wgpu::BindGroupEntry { binding: number as u32, resource }
    }
}
