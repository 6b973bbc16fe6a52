//! One opened device.

use super::pipeline::Pipeline;
use super::traffic::TrafficCounter;
use super::{AdapterChoice, AdapterSummary, Adapters, Commands, GpuError, Shader, Traffic};
use std::collections::HashMap;
use std::sync::{Arc, Mutex, OnceLock};
use wgpu::Features;

/// Parameters of all passes of a submission: 64 KiB hold 256 passes.
pub(super) const ARENA_BYTES: u64 = 65536;

/// By the shader's text form.
type Pipelines<R> = HashMap<String, Arc<Pipeline<R>>>;

/// A device, its queue and its compiled shaders.
pub struct Gpu {
    device: wgpu::Device,
    queue: wgpu::Queue,
    summary: AdapterSummary,
    pub(super) arena: wgpu::Buffer,
    /// Held from writing the arena until its commands are submitted.
    pub(super) submitting: Mutex<()>,
    pub(super) traffic: TrafficCounter,
    pipelines: Mutex<Pipelines<wgpu::ComputePipeline>>,
    drawing_pipelines: Mutex<Pipelines<wgpu::RenderPipeline>>,
    failures: Arc<Failures>,
}

/// What the device reported since it was opened.
#[derive(Default)]
struct Failures {
    lost: OnceLock<String>,
    first: OnceLock<GpuError>,
}

impl Gpu {
    /// Opens the adapter that the choice falls on.
    pub fn open(choice: &AdapterChoice) -> Result<Self, GpuError> {
        let adapters = Adapters::find();
        let (adapter, summary) = adapters.choose(choice)?;
        Self::open_adapter(adapter, summary)
    }

    /// With WebGPU's default limits, and of the features only timestamps, where they are there.
    pub fn open_adapter(
        adapter: &wgpu::Adapter,
        summary: &AdapterSummary,
    ) -> Result<Self, GpuError> {
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("kinlight"),
            required_features: summary.features & Features::TIMESTAMP_QUERY,
            required_limits: wgpu::Limits::default(),
            ..Default::default()
        };
        let opened = pollster::block_on(adapter.request_device(&descriptor));
        let (device, queue) = opened.map_err(|error| GpuError::Device {
            adapter: summary.to_string(),
            problem: error.to_string(),
        })?;
        let failures = Arc::new(Failures::default());
        let on_error = failures.clone();
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let _ = on_error.first.set(match error {
                wgpu::Error::OutOfMemory { source } => {
                    GpuError::OutOfMemory { what: source.to_string() }
                }
                other => GpuError::Refused(other.to_string()),
            });
        }));
        let on_loss = failures.clone();
        device.set_device_lost_callback(move |reason, message| {
            let _ = on_loss.lost.set(format!("{reason:?} {message}"));
        });
        let arena = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("parameters of passes"),
            size: ARENA_BYTES,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        Ok(Self {
            device,
            queue,
            summary: summary.clone(),
            arena,
            submitting: Mutex::default(),
            traffic: TrafficCounter::default(),
            pipelines: Mutex::default(),
            drawing_pipelines: Mutex::default(),
            failures,
        })
    }

    /// The first error since the device was opened. wgpu reports most of them some time after the call
    /// that caused them.
    pub fn check(&self) -> Result<(), GpuError> {
        if let Some(reason) = self.failures.lost.get() {
            return Err(GpuError::Lost { reason: reason.clone() });
        }
        self.failures.first.get().map_or(Ok(()), |error| Err(error.clone()))
    }

    /// Waits until everything that was submitted is done.
    pub fn wait(&self) -> Result<(), GpuError> {
        self.poll(wgpu::PollType::wait_indefinitely())
    }

    /// Waits until this submission is done, and those before it.
    pub fn wait_for(&self, submission: wgpu::SubmissionIndex) -> Result<(), GpuError> {
        self.poll(wgpu::PollType::Wait { submission_index: Some(submission), timeout: None })
    }

    fn poll(&self, until: wgpu::PollType) -> Result<(), GpuError> {
        self.traffic.wait();
        let polled = self.device.poll(until);
        self.check()?;
        polled.map(|_| ()).map_err(|error| GpuError::Lost { reason: error.to_string() })
    }

    /// Starts recording.
    pub fn commands(&self) -> Commands<'_> {
        Commands::new(self)
    }

    /// The pipeline of a shader, compiled on first use.
    pub(super) fn pipeline(&self, shader: &Shader) -> Result<Arc<Pipeline>, GpuError> {
        compiled_once(&self.pipelines, shader, || Pipeline::compile(self, shader))
    }

    /// The pipeline of a shader that draws, compiled on first use.
    pub(super) fn drawing_pipeline(
        &self,
        shader: &Shader,
    ) -> Result<Arc<Pipeline<wgpu::RenderPipeline>>, GpuError> {
        compiled_once(&self.drawing_pipelines, shader, || Pipeline::compile_drawing(self, shader))
    }

    pub(super) fn write(&self, buffer: &wgpu::Buffer, offset: u64, bytes: &[u8]) {
        self.traffic.upload(bytes.len());
        self.queue.write_buffer(buffer, offset, bytes);
    }

    pub fn traffic(&self) -> Traffic {
        self.traffic.total()
    }

    pub fn summary(&self) -> &AdapterSummary {
        &self.summary
    }

    pub fn limits(&self) -> wgpu::Limits {
        self.device.limits()
    }

    pub fn has_timestamps(&self) -> bool {
        self.device.features().contains(Features::TIMESTAMP_QUERY)
    }

    pub fn device(&self) -> &wgpu::Device {
        &self.device
    }

    pub fn queue(&self) -> &wgpu::Queue {
        &self.queue
    }
}

fn compiled_once<R>(
    known: &Mutex<Pipelines<R>>,
    shader: &Shader,
    compile: impl FnOnce() -> Result<Arc<Pipeline<R>>, GpuError>,
) -> Result<Arc<Pipeline<R>>, GpuError> {
    let key = format!("{shader:?}");
    let mut known = known.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    if let Some(pipeline) = known.get(&key) {
        return Ok(pipeline.clone());
    }
    let pipeline = compile()?;
    known.insert(key, pipeline.clone());
    Ok(pipeline)
}
