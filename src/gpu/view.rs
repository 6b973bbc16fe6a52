//! Views and geometry buffers on the device.

use super::{Gpu, GpuError, GpuImage, uniform};
use crate::geometry::{GBuffer, Origin};
use crate::image::{Image, Size};
use crate::math::View;
use glam::Mat4;

uniform! {
    /// [`View`] for `shaders/shared/view.wgsl`.
    pub struct ViewUniform {
        world_from_view: [[f32; 4]; 4],
        view_from_world: [[f32; 4]; 4],
        scale: [f32; 2],
        centre: [f32; 2],
        size: [u32; 2],
        perspective: u32,
        pad: u32,
    }
}

impl ViewUniform {
    pub fn new(view: &View) -> Self {
        let (scale, centre) = view.scale_and_centre();
        let size = view.size();
        Self {
            world_from_view: Mat4::from(view.world_from_view_f32()).to_cols_array_2d(),
            view_from_world: Mat4::from(view.view_from_world_f32()).to_cols_array_2d(),
            scale: scale.to_array(),
            centre: centre.to_array(),
            size: [size.width as u32, size.height as u32],
            perspective: u32::from(view.is_perspective()),
            pad: 0,
        }
    }
}

/// A [`GBuffer`] on the device.
pub struct GpuGBuffer {
    pub view: View,
    /// World normal, zero where missing, and z-depth in metres, 0.0 where missing.
    pub surface: GpuImage<[f32; 4]>,
    /// [`Origin`] as a number.
    pub origin: GpuImage<u32>,
}

impl GpuGBuffer {
    /// Nothing seen.
    pub fn empty(gpu: &Gpu, view: View) -> Result<Self, GpuError> {
        let size = view.size();
        Ok(Self {
            view,
            surface: GpuImage::new(gpu, "geometry buffer", size)?,
            origin: GpuImage::new(gpu, "origins", size)?,
        })
    }

    pub fn size(&self) -> Size {
        self.surface.size()
    }

    /// # Panics
    /// If the sizes differ.
    pub fn upload(&mut self, gpu: &Gpu, from: &GBuffer) {
        self.view = from.view;
        let n = &from.normals;
        let normals = n.x.as_slice().iter().zip(n.y.as_slice()).zip(n.z.as_slice());
        let surface = normals.zip(from.depth_m.as_slice()).map(|(((x, y), z), d)| [*x, *y, *z, *d]);
        self.surface.upload(gpu, &Image::from_vec(from.size(), surface.collect()));
        let origin = from.origin.as_slice().iter().map(|&o| o as u32).collect();
        self.origin.upload(gpu, &Image::from_vec(from.size(), origin));
    }

    /// Everything, now: for tests and for what is wanted once.
    pub fn download(&self, gpu: &Gpu) -> Result<GBuffer, GpuError> {
        let mut out = GBuffer::empty(self.view);
        for (i, [x, y, z, d]) in self.surface.buffer().download(gpu)?.into_iter().enumerate() {
            out.normals.x.as_mut_slice()[i] = x;
            out.normals.y.as_mut_slice()[i] = y;
            out.normals.z.as_mut_slice()[i] = z;
            out.depth_m.as_mut_slice()[i] = d;
        }
        let origins = self.origin.buffer().download(gpu)?;
        for (out, number) in out.origin.as_mut_slice().iter_mut().zip(origins) {
            *out = match number {
                1 => Origin::Model,
                2 => Origin::Sensor,
                3 => Origin::Virtual,
                _ => Origin::None,
            };
        }
        Ok(out)
    }
}
