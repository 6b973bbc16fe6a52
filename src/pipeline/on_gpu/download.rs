//! Intermediate buffers come back to be looked at, and only then.

use super::GpuPipeline;
use crate::geometry::GBuffer;
use crate::gpu::{GpuError, GpuGBuffer};
use crate::image::Image;
use crate::pipeline::{Buffer, BufferValues, PipelineError};

impl GpuPipeline {
    /// As [`crate::pipeline::Pipeline::buffer`].
    pub(super) fn download(&self, which: Buffer) -> Result<Option<BufferValues>, PipelineError> {
        let geometry = |buffer: &GpuGBuffer, part: fn(GBuffer) -> BufferValues| {
            buffer.download(&self.gpu).map(|buffer| Some(part(buffer)))
        };
        let found = match which {
            Buffer::SensorDepth => self.sensor_depth().map(Some),
            Buffer::ModelDepth => match &self.map {
                Some(map) => geometry(&map.surface.main, |b| BufferValues::DepthM(b.depth_m)),
                None => Ok(None),
            },
            _ if !self.composed_last => Ok(None),
            Buffer::Depth => geometry(&self.last.real, |b| BufferValues::DepthM(b.depth_m)),
            Buffer::Normals => {
                geometry(self.last.merged_geometry(), |b| BufferValues::Normals(b.normals))
            }
            Buffer::Origin => {
                geometry(self.last.merged_geometry(), |b| BufferValues::Origins(b.origin))
            }
            Buffer::Shading => self.shading(false),
            Buffer::VirtualShading => self.shading(true),
        };
        Ok(found?)
    }

    fn sensor_depth(&self) -> Result<BufferValues, GpuError> {
        let picture = &self.last.frame.depth_m;
        let depth_m = picture.buffer().download(&self.gpu)?;
        Ok(BufferValues::DepthM(Image::from_vec(picture.size(), depth_m)))
    }

    /// R, or R' with virtual objects.
    fn shading(&self, with_virtual: bool) -> Result<Option<BufferValues>, GpuError> {
        let Some(light) = &self.light else { return Ok(None) };
        let (gpu, last) = (&*self.gpu, &self.last);
        if !last.changed {
            let mut commands = gpu.commands();
            commands.clear(last.merged.layer.texels.buffer());
            commands.submit()?;
        }
        let input = last.compose_input(&self.settings, &light.light);
        let shading = self.compositor.shading_buffers(gpu, &input)?;
        let wanted = if with_virtual { shading.merged } else { shading.real };
        Ok(Some(BufferValues::Light(wanted)))
    }
}
