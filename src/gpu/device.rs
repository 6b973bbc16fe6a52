//! One opened device.

use super::memory::Memory;
use super::pipeline::Pipeline;
use super::profile::{Profile, STORAGE_BUFFERS};
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
    pub(super) memory: Arc<Memory>,
    pub(super) profile: OnceLock<Profile>,
    pipelines: Mutex<Pipelines<wgpu::ComputePipeline>>,
    /// Of shaders that count what they do.
    counting_pipelines: Mutex<Pipelines<wgpu::ComputePipeline>>,
    drawing_pipelines: Mutex<Pipelines<wgpu::RenderPipeline>>,
    failures: Arc<Failures>,
}

/// What the device reported since it was opened.
#[derive(Default)]
struct Failures {
    lost: OnceLock<String>,
    first: OnceLock<GpuError>,
}

impl Failures {
    /// # Panics
    /// In unit tests, which share a device: so that the test fails that made the mistake, and does so even
    /// if it submits nothing more. What a lost device reports follows from its loss alone.
    fn add(&self, error: wgpu::Error) {
        let error = match error {
            wgpu::Error::OutOfMemory { source } => {
                GpuError::OutOfMemory { what: source.to_string() }
            }
            other => GpuError::Refused(other.to_string()),
        };
        let _ = self.first.set(error.clone());
        if cfg!(test) && self.lost.get().is_none() {
            panic!("{error}");
        }
    }
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
        Self::open_with_limits(adapter, summary, wgpu::Limits::default())
    }

    /// For measuring every pass, see [`Self::measure_passes`]; the adapter must bind one storage buffer more than
    /// WebGPU asks for.
    pub fn open_for_profile(choice: &AdapterChoice) -> Result<Self, GpuError> {
        let adapters = Adapters::find();
        let (adapter, summary) = adapters.choose(choice)?;
        let limits = wgpu::Limits {
            max_storage_buffers_per_shader_stage: STORAGE_BUFFERS,
            ..wgpu::Limits::default()
        };
        let gpu = Self::open_with_limits(adapter, summary, limits)?;
        let profile = Profile::new(&gpu)?;
        let _ = gpu.profile.set(profile);
        Ok(gpu)
    }

    fn open_with_limits(
        adapter: &wgpu::Adapter,
        summary: &AdapterSummary,
        required_limits: wgpu::Limits,
    ) -> Result<Self, GpuError> {
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("kinlight"),
            required_features: summary.features & Features::TIMESTAMP_QUERY,
            required_limits,
            ..Default::default()
        };
        let opened = pollster::block_on(adapter.request_device(&descriptor));
        let (device, queue) = opened.map_err(|error| GpuError::Device {
            adapter: summary.to_string(),
            problem: error.to_string(),
        })?;
        let failures = Arc::new(Failures::default());
        let on_error = failures.clone();
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| on_error.add(error)));
        let on_loss = failures.clone();
        device.set_device_lost_callback(move |reason, message| {
            let _ = on_loss.lost.set(format!("{reason:?} {message}").trim().to_lowercase());
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
            memory: Arc::default(),
            profile: OnceLock::new(),
            pipelines: Mutex::default(),
            counting_pipelines: Mutex::default(),
            drawing_pipelines: Mutex::default(),
            failures,
        })
    }

    /// The first error since the device was opened. wgpu reports most of them some time after the call
    /// that caused them: every submission and every wait asks, and the end of a run.
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
        let known = if self.counts_work() { &self.counting_pipelines } else { &self.pipelines };
        compiled_once(known, shader, || Pipeline::compile(self, shader))
    }

    /// The pipeline of a shader that draws, compiled on first use.
    pub(super) fn drawing_pipeline(
        &self,
        shader: &Shader,
    ) -> Result<Arc<Pipeline<wgpu::RenderPipeline>>, GpuError> {
        compiled_once(&self.drawing_pipelines, shader, || Pipeline::compile_drawing(self, shader))
    }

    /// Submits what was recorded, with the parameters of its passes.
    pub(super) fn hand_over(
        &self,
        recorded: wgpu::CommandEncoder,
        parameters: &[u8],
    ) -> Result<wgpu::SubmissionIndex, GpuError> {
        // two threads may submit: neither may write the other's parameters
        let _held = self.submitting.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if !parameters.is_empty() {
            self.write(&self.arena, 0, parameters);
        }
        let index = self.queue.submit([recorded.finish()]);
        self.traffic.submission();
        self.check().map(|()| index)
    }

    pub(super) fn write(&self, buffer: &wgpu::Buffer, offset: u64, bytes: &[u8]) {
        self.traffic.upload(bytes.len());
        self.queue.write_buffer(buffer, offset, bytes);
    }

    /// Buffers that would take more than this together are refused from here on; the device is not asked.
    pub fn limit_memory(&self, bytes: u64) {
        self.memory.limit(bytes);
    }

    /// Bytes of all buffers.
    pub fn memory_taken(&self) -> u64 {
        self.memory.taken()
    }

    /// Ends the device: from here on it is lost, as after a reset of its driver.
    pub fn destroy(&self) {
        self.device.destroy();
        // wgpu calls it lost when it is asked and nothing is left to do; `check` says so from then on
        let _ = self.device.poll(wgpu::PollType::wait_indefinitely());
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::stages::test_support;
    use std::panic::{AssertUnwindSafe, catch_unwind};

    fn device_of_its_own() -> Option<Gpu> {
        test_support::gpu()?;
        Some(Gpu::open(&AdapterChoice::Best).expect("it opened before"))
    }

    /// Larger than the device allows.
    fn make_a_mistake(gpu: &Gpu) {
        let _ = gpu.device().create_buffer(&wgpu::BufferDescriptor {
            label: Some("a mistake"),
            size: gpu.limits().max_buffer_size + 4,
            usage: wgpu::BufferUsages::STORAGE,
            mapped_at_creation: false,
        });
    }

    #[test]
    fn a_mistake_fails_where_it_is_made_and_every_command_after_it() {
        let Some(gpu) = device_of_its_own() else { return };
        gpu.commands().submit().expect("nothing is wrong yet");
        let panicked = catch_unwind(AssertUnwindSafe(|| make_a_mistake(&gpu)));
        assert!(panicked.is_err(), "a test that does this alone must fail");
        let refused =
            |error: &GpuError| matches!(error, GpuError::Refused(why) if why.contains("a mistake"));
        for result in [gpu.commands().submit(), gpu.wait(), gpu.check()] {
            assert!(result.as_ref().is_err_and(refused), "{result:?}");
        }
    }

    #[test]
    fn a_lost_device_says_so_whatever_else_goes_wrong() {
        let Some(gpu) = device_of_its_own() else { return };
        gpu.destroy();
        make_a_mistake(&gpu);
        for result in [gpu.commands().submit(), gpu.wait(), gpu.check()] {
            assert!(result.as_ref().is_err_and(GpuError::is_lost), "{result:?}");
        }
    }
}
