//! Both pipelines over the same frames of the demo.

use kinlight::capture::{CaptureOptions, FrameSource, RawFrame, Sequence, open_sequence};
use kinlight::config::Settings;
use kinlight::gpu::{Gpu, Measure, PassRecord};
use kinlight::pipeline::{GpuPipeline, Pipeline};
use kinlight::scene::VirtualScene;
use kinlight::timing::StageTimes;
use std::error::Error;
use std::path::Path;
use std::sync::Arc;

/// Frames that the volume holds before anything is measured.
const FUSED: usize = 20;
/// Frames after a change of settings: buffers are made, and each auxiliary view has been cast.
const SETTLING: usize = 2;

/// What one preset's frames gave.
pub struct Measured {
    /// Stage times of each frame.
    pub cpu: Vec<StageTimes>,
    pub gpu: Vec<StageTimes>,
    /// Passes of each frame, with times.
    pub timed: Vec<Vec<PassRecord>>,
    /// Passes of one frame more, with what they did.
    pub counted: Vec<PassRecord>,
    /// Bytes uploaded for the newest of these frames, and bytes that came back.
    pub moved: (u64, u64),
}

pub struct Runs {
    gpu: Arc<Gpu>,
    source: Sequence,
    on_gpu: GpuPipeline,
    on_cpu: Pipeline,
    frames: usize,
}

impl Runs {
    pub fn start(gpu: Arc<Gpu>, frames: usize) -> Result<Self, Box<dyn Error>> {
        let sequence = Path::new(env!("CARGO_MANIFEST_DIR")).join("sequences/demo");
        let source = open_sequence(&sequence, &CaptureOptions::default())?;
        let scene = VirtualScene::load(&sequence.join("scene.toml"))?;
        let camera = source.camera();
        // camera and volume do not depend on what follows them
        let mut quick = Settings::preset("ours-fast")?;
        quick.set("transfer.subsampling", "8")?;
        let on_cpu = Pipeline::new(quick.clone(), camera, scene.clone())?;
        let on_gpu = GpuPipeline::new(gpu.clone(), quick, camera, scene)?;
        let mut runs = Self { gpu, source, on_gpu, on_cpu, frames };
        for _ in 0..FUSED {
            runs.frame()?;
        }
        Ok(runs)
    }

    fn next(&mut self) -> Result<RawFrame, Box<dyn Error>> {
        Ok(self.source.next_frame()?.ok_or("the demo has too few frames")?)
    }

    /// One frame through both; what the stages took on the CPU, and on the GPU.
    fn frame(&mut self) -> Result<[StageTimes; 2], Box<dyn Error>> {
        let raw = self.next()?;
        let gpu = self.on_gpu.process(&raw, StageTimes::default())?.times;
        let cpu = self.on_cpu.process(raw, StageTimes::default())?.times;
        Ok([cpu, gpu])
    }

    pub fn measure(&mut self, preset: &str) -> Result<Measured, Box<dyn Error>> {
        let settings = Settings::preset(preset)?;
        self.on_gpu.reconfigure(settings.clone())?;
        self.on_cpu.reconfigure(settings)?;
        for _ in 0..SETTLING {
            self.frame()?;
        }
        let mut measured = Measured {
            cpu: Vec::new(),
            gpu: Vec::new(),
            timed: Vec::new(),
            counted: Vec::new(),
            moved: (0, 0),
        };
        for _ in 0..self.frames {
            let before = self.gpu.traffic();
            let [cpu, gpu] = self.frame()?;
            let moved = self.gpu.traffic().since(before);
            measured.cpu.push(cpu);
            measured.gpu.push(gpu);
            measured.moved = (moved.uploaded, moved.read_back);
        }
        for _ in 0..self.frames {
            measured.timed.push(self.passes(Measure::Time)?);
        }
        measured.counted = self.passes(Measure::Work)?;
        Ok(measured)
    }

    fn passes(&mut self, measure: Measure) -> Result<Vec<PassRecord>, Box<dyn Error>> {
        self.gpu.measure_passes(Some(measure));
        let frame = self.frame();
        self.gpu.measure_passes(None);
        frame?;
        Ok(self.gpu.take_passes())
    }
}
