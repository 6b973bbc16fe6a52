//! Values that come back from the device, without stopping it.

use super::{Commands, Gpu, GpuBuffer, GpuError};
use bytemuck::Pod;
use std::collections::VecDeque;
use std::marker::PhantomData;
use std::sync::{Arc, OnceLock};
use wgpu::{BufferUsages, MapMode};

/// Staging memory for up to `len` values, twice: one copy may be under way while the other is read.
pub struct ReadBack<T> {
    free: Vec<wgpu::Buffer>,
    under_way: VecDeque<UnderWay>,
    label: &'static str,
    len: usize,
    holds: PhantomData<T>,
}

struct UnderWay {
    staging: wgpu::Buffer,
    bytes: u64,
    values: usize,
    mapped: Arc<OnceLock<Result<(), String>>>,
}

impl<T: Pod> ReadBack<T> {
    pub fn new(gpu: &Gpu, label: &'static str, len: usize) -> Result<Self, GpuError> {
        let staging = |_| {
            gpu.device().create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: padded::<T>(len.max(1)),
                usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        let free = (0..2).map(staging).collect();
        gpu.check()?;
        Ok(Self { free, under_way: VecDeque::new(), label, len, holds: PhantomData })
    }

    /// Has the first `values` values of `buffer` copied when everything recorded so far is done; returns
    /// how many bytes that makes.
    ///
    /// # Panics
    /// If two copies are under way already, or more values are wanted than there is room for.
    pub fn request(
        &mut self,
        commands: &mut Commands<'_>,
        buffer: &GpuBuffer<T>,
        values: usize,
    ) -> u64 {
        assert!(values <= self.len.min(buffer.len()), "{}: {values} values", self.label);
        let staging = self.free.pop().expect("a copy is taken before the third is requested");
        let bytes = padded::<T>(values);
        let mapped = Arc::new(OnceLock::new());
        let result = mapped.clone();
        commands.note_copy(bytes, bytes);
        commands.encoder.copy_buffer_to_buffer(buffer.raw(), 0, &staging, 0, bytes);
        commands.encoder.map_buffer_on_submit(&staging, MapMode::Read, 0..bytes, move |mapped| {
            let _ = result.set(mapped.map_err(|e| e.to_string()));
        });
        commands.gpu().traffic.read_back(bytes as usize);
        self.under_way.push_back(UnderWay { staging, bytes, values, mapped });
        bytes
    }

    /// The values of the oldest request, once its commands have been submitted: waits for the device.
    /// `None` where nothing was requested.
    pub fn take(&mut self, gpu: &Gpu) -> Result<Option<Vec<T>>, GpuError> {
        let Some(oldest) = self.under_way.pop_front() else { return Ok(None) };
        while oldest.mapped.get().is_none() {
            gpu.wait()?;
        }
        if let Some(Err(problem)) = oldest.mapped.get() {
            gpu.check()?;
            return Err(GpuError::Refused(format!("reading back {}: {problem}", self.label)));
        }
        let refused = |e: wgpu::MapRangeError| GpuError::Refused(format!("{}: {e}", self.label));
        let view = oldest.staging.get_mapped_range(0..oldest.bytes).map_err(refused)?;
        let values = view[..oldest.values * size_of::<T>()]
            .chunks_exact(size_of::<T>())
            .map(bytemuck::pod_read_unaligned)
            .collect();
        drop(view);
        oldest.staging.unmap();
        self.free.push(oldest.staging);
        Ok(Some(values))
    }
}

/// Copies and mappings are multiples of four bytes.
fn padded<T>(values: usize) -> u64 {
    (values * size_of::<T>()).next_multiple_of(4) as u64
}

impl<T: Pod> GpuBuffer<T> {
    /// All values, now: for tests, and for what is wanted once.
    pub fn download(&self, gpu: &Gpu) -> Result<Vec<T>, GpuError> {
        let mut read_back = ReadBack::new(gpu, self.label(), self.len())?;
        let mut commands = gpu.commands();
        read_back.request(&mut commands, self, self.len());
        commands.submit()?;
        Ok(read_back.take(gpu)?.unwrap_or_default())
    }
}
