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
    /// As the arguments ask for.
    #[cfg(feature = "gpu")]
    pub fn choose(run: &RunArgs) -> Result<Self, CliError> {
        let usage = |problem: String| CliError::Usage(problem);
        let choice = run.adapter.clone().map_or(AdapterChoice::Best, AdapterChoice::Named);
        match run.backend {
            Asked::Cpu if run.adapter.is_some() => {
                Err(usage("--adapter names a graphics device, --backend cpu takes none".into()))
            }
            Asked::Cpu => Ok(Self::Cpu),
            Asked::Gpu => Self::open(&choice),
            Asked::Auto => {
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
    pub fn choose(run: &RunArgs) -> Result<Self, CliError> {
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

    /// As in the name of its profile.
    pub fn backend(&self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            #[cfg(feature = "gpu")]
            Self::Gpu(_) => "gpu",
        }
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
