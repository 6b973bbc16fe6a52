//! Typed memory on the device.

use super::memory::{Share, mib};
use super::{Gpu, GpuError};
use crate::image::{Image, Size};
use bytemuck::Pod;
use std::marker::PhantomData;
use wgpu::BufferUsages;

/// `len` values of type `T`.
pub struct GpuBuffer<T> {
    raw: wgpu::Buffer,
    _share: Share,
    len: usize,
    label: &'static str,
    holds: PhantomData<T>,
}

impl GpuBuffer<u32> {
    /// Writes bytes to the buffer's start, the last word filled up with zeros.
    ///
    /// # Panics
    /// If there are more bytes than the buffer has.
    pub fn upload_bytes(&self, gpu: &Gpu, bytes: &[u8]) {
        assert!(bytes.len() <= 4 * self.len, "{}: {} bytes", self.label, bytes.len());
        let (whole, rest) = bytes.split_at(bytes.len() / 4 * 4);
        if !whole.is_empty() {
            gpu.write(&self.raw, 0, whole);
        }
        if !rest.is_empty() {
            let mut last = [0; 4];
            last[..rest.len()].copy_from_slice(rest);
            gpu.write(&self.raw, whole.len() as u64, &last);
        }
    }
}

impl<T: Pod> GpuBuffer<T> {
    /// Zeros. At least one value is there, since a binding can't be empty.
    pub fn new(gpu: &Gpu, label: &'static str, len: usize) -> Result<Self, GpuError> {
        Self::with_usage(gpu, label, len, BufferUsages::empty())
    }

    /// As [`Self::new`], usable as more than storage and copies.
    pub fn with_usage(
        gpu: &Gpu,
        label: &'static str,
        len: usize,
        more: BufferUsages,
    ) -> Result<Self, GpuError> {
        let bytes = (len.max(1) * size_of::<T>()).next_multiple_of(4) as u64;
        let refused = |reason: String| {
            let what = format!("{label} needs {}, and {} {reason}", mib(bytes), gpu.summary().name);
            GpuError::OutOfMemory { what }
        };
        let most = gpu.limits().max_storage_buffer_binding_size;
        if bytes > most {
            return Err(refused(format!("binds {} at most", mib(most))));
        }
        let share = gpu.memory.take(label, bytes)?;
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC | more;
        let scope = gpu.device().push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let raw = gpu.device().create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: bytes,
            usage,
            mapped_at_creation: false,
        });
        if let Some(error) = pollster::block_on(scope.pop()) {
            return Err(refused(format!("has no room for it: {error}")));
        }
        gpu.check()?;
        Ok(Self { raw, _share: share, len, label, holds: PhantomData })
    }

    /// With these values.
    pub fn from_slice(gpu: &Gpu, label: &'static str, values: &[T]) -> Result<Self, GpuError> {
        let buffer = Self::new(gpu, label, values.len())?;
        buffer.upload(gpu, values);
        Ok(buffer)
    }

    /// Writes the first `values.len()` values, before the next commands that are submitted.
    ///
    /// # Panics
    /// If there are more values than the buffer has, or their bytes are no multiple of 4.
    pub fn upload(&self, gpu: &Gpu, values: &[T]) {
        assert!(
            values.len() <= self.len,
            "{}: {} values for {}",
            self.label,
            values.len(),
            self.len
        );
        if !values.is_empty() {
            gpu.write(&self.raw, 0, bytemuck::cast_slice(values));
        }
    }

    pub fn len(&self) -> usize {
        self.len
    }

    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    pub fn label(&self) -> &'static str {
        self.label
    }

    pub fn raw(&self) -> &wgpu::Buffer {
        &self.raw
    }
}

/// Rows of values of type `T`, without padding, as [`Image`].
pub struct GpuImage<T> {
    buffer: GpuBuffer<T>,
    size: Size,
}

impl<T: Pod> GpuImage<T> {
    /// Zeros.
    pub fn new(gpu: &Gpu, label: &'static str, size: Size) -> Result<Self, GpuError> {
        Ok(Self { buffer: GpuBuffer::new(gpu, label, size.pixels())?, size })
    }

    pub fn from_image(gpu: &Gpu, label: &'static str, image: &Image<T>) -> Result<Self, GpuError> {
        let made = Self::new(gpu, label, image.size())?;
        made.upload(gpu, image);
        Ok(made)
    }

    /// Writes all pixels, before the next commands that are submitted.
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn upload(&self, gpu: &Gpu, image: &Image<T>) {
        assert_eq!(image.size(), self.size, "{}", self.buffer.label);
        self.buffer.upload(gpu, image.as_slice());
    }

    pub fn size(&self) -> Size {
        self.size
    }

    pub fn buffer(&self) -> &GpuBuffer<T> {
        &self.buffer
    }
}

impl<T> AsRef<GpuBuffer<T>> for GpuBuffer<T> {
    fn as_ref(&self) -> &GpuBuffer<T> {
        self
    }
}

impl<T> AsRef<GpuBuffer<T>> for GpuImage<T> {
    fn as_ref(&self) -> &GpuBuffer<T> {
        &self.buffer
    }
}
