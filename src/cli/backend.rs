//! Which device computes.

use super::CliError;
use super::args::{Backend as Asked, RunArgs};
use kinlight::config::Settings;
#[cfg(feature = "gpu")]
use kinlight::gpu::{AdapterChoice, Gpu, diagnosis::diagnose};
use kinlight::math::Pinhole;
use kinlight::pipeline::{Backend, Pipeline, PipelineError};
#[cfg(feature = "gpu")]
use kinlight::pipeline::{GpuPipeline, WithFallback};
use kinlight::scene::VirtualScene;
#[cfg(feature = "gpu")]
use std::sync::Arc;

/// Where pipelines run.
pub enum Device {
    Cpu,
    #[cfg(feature = "gpu")]
    Gpu(Arc<Gpu>),
}

impl Device {
    /// As the arguments ask for. What the GPU cannot do is an error where it was asked for, and otherwise
    /// leads to the CPU.
    #[cfg(feature = "gpu")]
    pub fn choose(run: &RunArgs, dumps: bool) -> Result<Self, CliError> {
        let usage = |problem: String| CliError::Usage(problem);
        let obstacle = obstacle(run, dumps);
        let choice = run.adapter.clone().map_or(AdapterChoice::Best, AdapterChoice::Named);
        match (run.backend, obstacle) {
            (Asked::Cpu, _) if run.adapter.is_some() => {
                Err(usage("--adapter names a graphics device, --backend cpu takes none".into()))
            }
            (Asked::Cpu, _) => Ok(Self::Cpu),
            (Asked::Gpu, Some(obstacle)) => Err(usage(obstacle)),
            (Asked::Auto, Some(obstacle)) if run.adapter.is_some() => Err(usage(obstacle)),
            (Asked::Auto, Some(obstacle)) => {
                log::debug!("on the CPU: {obstacle}");
                Ok(Self::Cpu)
            }
            (Asked::Gpu, None) => Self::open(&choice),
            (Asked::Auto, None) => {
                let (_, verdict) = diagnose(&choice).map_err(|e| usage(e.to_string()))?;
                match verdict.adapter {
                    Some(name) => Self::open(&AdapterChoice::Named(name)),
                    None if run.adapter.is_some() => Err(usage(verdict.because)),
                    None => {
                        log::debug!("on the CPU: {}", verdict.because);
                        Ok(Self::Cpu)
                    }
                }
            }
        }
    }

    #[cfg(not(feature = "gpu"))]
    pub fn choose(run: &RunArgs, _: bool) -> Result<Self, CliError> {
        match run.backend {
            Asked::Auto | Asked::Cpu => Ok(Self::Cpu),
        }
    }

    #[cfg(feature = "gpu")]
    fn open(choice: &AdapterChoice) -> Result<Self, CliError> {
        let gpu = Gpu::open(choice).map_err(|e| CliError::Usage(e.to_string()))?;
        log::info!("on {}", gpu.summary());
        Ok(Self::Gpu(gpu.into()))
    }

    pub fn pipeline(
        &self,
        settings: Settings,
        camera: Pinhole,
        scene: VirtualScene,
    ) -> Result<Box<dyn Backend>, PipelineError> {
        Ok(match self {
            Self::Cpu => Box::new(Pipeline::new(settings, camera, scene)?),
            #[cfg(feature = "gpu")]
            Self::Gpu(gpu) => {
                let pipeline = GpuPipeline::new(gpu.clone(), settings, camera, scene)?;
                Box::new(WithFallback::new(pipeline))
            }
        })
    }
}

/// What keeps the run from the GPU.
#[cfg(feature = "gpu")]
fn obstacle(run: &RunArgs, dumps: bool) -> Option<String> {
    if dumps {
        return Some("--dump shows buffers of the CPU backend; take --backend cpu".into());
    }
    if run.budget.is_some() {
        return Some("--budget has no profile of the GPU backend; take --backend cpu".into());
    }
    None
}
