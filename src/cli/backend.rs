//! Which device computes.

use super::CliError;
use super::args::{Backend as Asked, ComputeArgs};
use kinlight::config::Settings;
#[cfg(feature = "gpu")]
use kinlight::gpu::{AdapterChoice, Gpu, GpuError, diagnosis};
use kinlight::math::Pinhole;
use kinlight::pipeline::{Backend, Pipeline, PipelineError};
#[cfg(feature = "gpu")]
use kinlight::pipeline::{GpuPipeline, WithFallback};
use kinlight::scene::VirtualScene;
#[cfg(feature = "gpu")]
use std::sync::Arc;

/// Where pipelines run.
pub enum Device {
    /// And why, where that was left to the program.
    Cpu(Option<String>),
    #[cfg(feature = "gpu")]
    Gpu(GpuDevice),
}

impl Device {
    /// As the arguments ask for. What the GPU cannot do leads to the CPU, unless it was asked for.
    #[cfg(feature = "gpu")]
    pub fn choose(run: &ComputeArgs) -> Result<Self, CliError> {
        let named = run.adapter.is_some();
        let choice = run.adapter.clone().map_or(AdapterChoice::Best, AdapterChoice::Named);
        match run.backend {
            Asked::Cpu if named => Err(CliError::Usage(
                "--adapter names a graphics device, --backend cpu takes none".into(),
            )),
            Asked::Cpu => Ok(Self::Cpu(None)),
            Asked::Gpu => {
                let gpu = Gpu::open(&choice).map_err(unusable)?;
                Ok(Self::Gpu(GpuDevice::new(gpu, run)))
            }
            Asked::Auto => match diagnosis::take(&choice).map_err(unusable)? {
                diagnosis::Taken::Gpu(gpu) => Ok(Self::Gpu(GpuDevice::new(*gpu, run))),
                diagnosis::Taken::Cpu { because } => Self::no_gpu(named, because),
            },
        }
    }

    /// The CPU, unless a graphics device was asked for by name.
    #[cfg(feature = "gpu")]
    fn no_gpu(named: bool, because: String) -> Result<Self, CliError> {
        if named {
            return Err(CliError::Usage(because));
        }
        log::debug!("on the CPU: {because}");
        Ok(Self::Cpu(Some(because)))
    }

    #[cfg(not(feature = "gpu"))]
    pub fn choose(run: &ComputeArgs) -> Result<Self, CliError> {
        match run.backend {
            Asked::Auto | Asked::Cpu => Ok(Self::Cpu(None)),
        }
    }

    pub fn on_cpu_because(&self) -> Option<&str> {
        match self {
            Self::Cpu(because) => because.as_deref(),
            #[cfg(feature = "gpu")]
            Self::Gpu(_) => None,
        }
    }

    /// As in the name of its profile.
    pub fn backend(&self) -> &'static str {
        match self {
            Self::Cpu(_) => "cpu",
            #[cfg(feature = "gpu")]
            Self::Gpu(_) => "gpu",
        }
    }

    pub fn pipeline(
        &self,
        settings: Settings,
        camera: Pinhole,
        scene: VirtualScene,
    ) -> Result<Box<dyn Backend>, CliError> {
        let made: Result<Box<dyn Backend>, PipelineError> = match self {
            Self::Cpu(_) => Pipeline::new(settings, camera, scene).map(|p| Box::new(p) as _),
            #[cfg(feature = "gpu")]
            Self::Gpu(device) => device.pipeline(settings, camera, scene),
        };
        made.map_err(|error| {
            #[cfg(feature = "gpu")]
            if error.is_the_devices() {
                let advice = "--backend cpu has no such limit";
                return CliError::Run(format!("{error}; pictures are {}, {advice}", camera.size()));
            }
            CliError::Run(error.to_string())
        })
    }
}

/// A graphics device, and what was asked for with it.
#[cfg(feature = "gpu")]
pub struct GpuDevice {
    gpu: Arc<Gpu>,
    /// The CPU is no substitute for what the device can't do from the start.
    insists: bool,
    lose_at: Vec<usize>,
    memory_bytes: Option<u64>,
}

#[cfg(feature = "gpu")]
impl GpuDevice {
    fn new(gpu: Gpu, run: &ComputeArgs) -> Self {
        log::info!("on {}", gpu.summary());
        let memory_bytes = run.gpu_memory.map(|mib| mib << 20);
        memory_bytes.inspect(|&bytes| gpu.limit_memory(bytes));
        Self {
            gpu: gpu.into(),
            insists: run.backend == Asked::Gpu,
            lose_at: run.lose_gpu_at.clone(),
            memory_bytes,
        }
    }

    fn pipeline(
        &self,
        settings: Settings,
        camera: Pinhole,
        scene: VirtualScene,
    ) -> Result<Box<dyn Backend>, PipelineError> {
        match self.on_gpu(settings.clone(), camera, scene.clone()) {
            Err(error) if error.is_the_devices() && !self.insists => {
                log::warn!("{error}; going on with the CPU backend");
                Ok(Box::new(Pipeline::new(settings, camera, scene)?))
            }
            made => Ok(Box::new(made?)),
        }
    }

    fn on_gpu(
        &self,
        settings: Settings,
        camera: Pinhole,
        scene: VirtualScene,
    ) -> Result<WithFallback, PipelineError> {
        // the run before may have lost it
        let gpu = match self.gpu.check() {
            Ok(()) => self.gpu.clone(),
            Err(_) => Arc::new(open_again(&self.gpu.summary().name, self.memory_bytes)?),
        };
        let (name, memory_bytes) = (gpu.summary().name.clone(), self.memory_bytes);
        let pipeline = GpuPipeline::new(gpu, settings, camera, scene)?;
        Ok(WithFallback::new(pipeline)
            .reopening(Box::new(move || open_again(&name, memory_bytes)))
            .insisting(self.insists)
            .losing_device_before(&self.lose_at))
    }
}

#[cfg(feature = "gpu")]
fn open_again(name: &str, memory_bytes: Option<u64>) -> Result<Gpu, GpuError> {
    let gpu = Gpu::open(&AdapterChoice::Named(name.to_owned()))?;
    memory_bytes.inspect(|&bytes| gpu.limit_memory(bytes));
    Ok(gpu)
}

#[cfg(feature = "gpu")]
fn unusable(error: GpuError) -> CliError {
    CliError::Usage(error.to_string())
}
