//! A pipeline, wherever its stages run.

use super::{Buffer, BufferValues, FrameOutcome, Pipeline, PipelineError};
use crate::capture::RawFrame;
use crate::config::Settings;
use crate::image::Image;
use crate::lighting::LightEstimate;
use crate::mesh::TriangleMesh;
use crate::timing::StageTimes;

/// What runs need of a pipeline; [`Pipeline`] says what each of it is.
pub trait Backend {
    fn process(&mut self, raw: RawFrame, times: StageTimes) -> Result<FrameOutcome, PipelineError>;

    fn reconfigure(&mut self, settings: Settings) -> Result<(), PipelineError>;

    fn composed(&self) -> &Image<[u8; 3]>;

    fn settings(&self) -> &Settings;

    fn light(&self) -> Option<&LightEstimate>;

    fn mesh(&self) -> Result<TriangleMesh, PipelineError>;

    /// An intermediate buffer of the newest frame, where it has one.
    fn buffer(&self, which: Buffer) -> Result<Option<BufferValues>, PipelineError>;

    /// What computes, for the files of a run.
    fn record(&self) -> BackendRecord;

    /// What has gone wrong and was no call's result.
    fn check(&self) -> Result<(), PipelineError> {
        Ok(())
    }

    /// The pipeline whose buffers are in the host's memory, if this is one.
    fn on_host(&self) -> Option<&Pipeline>;
}

/// What computed.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct BackendRecord {
    /// "cpu" or "gpu"; "gpu, then cpu" where the device was lost.
    pub name: String,
    /// Of the GPU, with its driver.
    pub adapter: Option<String>,
    /// What the stage times were measured with.
    pub clock: String,
    /// Between host and device; from two frames on.
    pub traffic: Option<FrameTraffic>,
    /// Of the volume, on the device.
    #[serde(default)]
    pub volume_bytes: Option<u64>,
    /// Where the run went on elsewhere.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub handovers: Vec<Handover>,
}

/// A frame from which on another device computed.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Handover {
    pub frame: usize,
    /// "cpu", or "gpu" for a device that was opened anew.
    pub to: String,
    pub because: String,
}

/// Mean bytes a frame, the first left out, which also brings tables and models; and how often a frame is
/// handed over in parts.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct FrameTraffic {
    /// Pictures, parameters and objects.
    pub uploaded: u64,
    /// Sums, counters, light samples, pass times, and the composed picture.
    pub read_back: u64,
    /// The part of `read_back` that is the composed picture.
    pub picture: u64,
    /// Times that the device is given work.
    #[serde(default)]
    pub submissions: f64,
    /// Times that the host waits for the device.
    #[serde(default)]
    pub waits: f64,
}

impl BackendRecord {
    pub fn cpu() -> Self {
        let clock = "host".to_owned();
        Self {
            name: "cpu".to_owned(),
            adapter: None,
            clock,
            traffic: None,
            volume_bytes: None,
            handovers: Vec::new(),
        }
    }

    /// What computed from which frame on, as "gpu, cpu from frame 20".
    pub fn history(&self) -> String {
        let first = if self.handovers.is_empty() { self.name.as_str() } else { "gpu" };
        let then = self.handovers.iter().map(|h| match h.to.as_str() {
            "gpu" => format!(", gpu opened anew from frame {}", h.frame),
            to => format!(", {to} from frame {}", h.frame),
        });
        std::iter::once(first.to_owned()).chain(then).collect()
    }
}

impl std::fmt::Display for BackendRecord {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.history())?;
        if let Some(adapter) = &self.adapter {
            write!(f, ": {adapter}")?;
        }
        if let Some(traffic) = self.traffic {
            let FrameTraffic { uploaded, read_back, picture, submissions, waits } = traffic;
            let kib = |bytes: u64| bytes as f64 / 1024.0;
            write!(
                f,
                "; {:.0} KiB up and {:.0} KiB back a frame, {:.0} KiB of it the picture; \
                 {submissions:.1} submissions and {waits:.1} waits a frame",
                kib(uploaded),
                kib(read_back),
                kib(picture)
            )?;
        }
        Ok(())
    }
}

impl Backend for Pipeline {
    fn process(&mut self, raw: RawFrame, times: StageTimes) -> Result<FrameOutcome, PipelineError> {
        self.process(raw, times)
    }

    fn reconfigure(&mut self, settings: Settings) -> Result<(), PipelineError> {
        self.reconfigure(settings)
    }

    fn composed(&self) -> &Image<[u8; 3]> {
        self.composed()
    }

    fn settings(&self) -> &Settings {
        self.settings()
    }

    fn light(&self) -> Option<&LightEstimate> {
        self.light()
    }

    fn mesh(&self) -> Result<TriangleMesh, PipelineError> {
        Ok(self.mesh())
    }

    fn buffer(&self, which: Buffer) -> Result<Option<BufferValues>, PipelineError> {
        Ok(self.buffer(which))
    }

    fn record(&self) -> BackendRecord {
        BackendRecord::cpu()
    }

    fn on_host(&self) -> Option<&Pipeline> {
        Some(self)
    }
}
