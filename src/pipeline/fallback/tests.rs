//! Devices that end or are too small in mid-run.

use super::*;
use crate::capture::{CaptureOptions, FrameSource, Sequence, open_sequence};
use crate::gpu::AdapterChoice;
use crate::gpu::stages::test_support;
use crate::scene::{Placement, SurfaceAnchor, VirtualScene};
use crate::synth::{SynthOptions, generate};
use crate::tracking::TrackingState;
use std::sync::OnceLock;

const FRAMES: usize = 4;
/// From this frame on there is a virtual object.
const APPEARS: usize = 2;

fn sequence() -> Sequence {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let options = SynthOptions {
            frames: FRAMES,
            width: 160,
            height: 120,
            samples: 1,
            with_virtual: true,
            virtual_every: 100,
            ..SynthOptions::default()
        };
        generate(&options, &folder.path().join("desk"), &|_, _| {}).expect("a free folder");
        folder
    });
    open_sequence(&folder.path().join("desk"), &CaptureOptions::default()).expect("a sequence")
}

struct Run {
    gpu: Arc<Gpu>,
    source: Sequence,
    pipeline: WithFallback,
}

impl Run {
    /// `None`, said out loud, without a device.
    fn start() -> Option<Self> {
        test_support::gpu()?;
        let gpu = Arc::new(Gpu::open(&AdapterChoice::Best).expect("it opened before"));
        let source = sequence();
        let mut scene =
            VirtualScene::load(&source.info().folder.join("scene.toml")).expect("its scene");
        let middle = glam::vec2(80.0, 60.0);
        for object in &mut scene.objects {
            let anchor = SurfaceAnchor::new(middle, APPEARS, 0.0, 1.0, None);
            object.placement = Placement::Pending(anchor);
        }
        let mut settings = Settings::preset("ours-fast-mobile").expect("a preset");
        settings.set("volume.resolution", "64").expect("a setting");
        let pipeline = GpuPipeline::new(gpu.clone(), settings, source.camera(), scene);
        let pipeline = WithFallback::new(pipeline.expect("a pipeline"));
        Some(Self { gpu, source, pipeline })
    }

    fn frame(&mut self, index: usize) -> Result<FrameOutcome, PipelineError> {
        let raw = self.source.frame(index).expect("a frame");
        self.pipeline.process(raw, StageTimes::default())
    }

    fn frames(&mut self, indices: std::ops::Range<usize>) {
        for index in indices {
            let state = self.frame(index).expect("a frame").tracking.state;
            let first = if index == 0 { TrackingState::Init } else { TrackingState::Tracking };
            assert_eq!(state, first, "frame {index}");
        }
    }

    /// Nothing more fits.
    fn fill_memory(&self) {
        assert!(self.gpu.memory_taken() > 1 << 20);
        self.gpu.limit_memory(self.gpu.memory_taken());
    }

    fn vertices(&self) -> usize {
        self.pipeline.mesh().expect("a mesh").positions.len()
    }

    fn is_on_cpu_since(&self, frame: usize, because: &str) {
        assert!(self.pipeline.on_host().is_some());
        let record = self.pipeline.record();
        assert_eq!(record.history(), format!("gpu, cpu from frame {frame}"));
        assert!(record.handovers[0].because.contains(because), "{:?}", record.handovers);
    }
}

#[test]
fn an_object_that_finds_no_room_is_drawn_by_the_cpu_into_the_same_map() {
    let Some(mut run) = Run::start() else { return };
    run.frames(0..APPEARS);
    let before = run.vertices();
    assert!(before > 1000, "{before} vertices");
    run.fill_memory();
    run.frames(APPEARS..APPEARS + 1);
    run.is_on_cpu_since(APPEARS, "out of GPU memory");
    let camera = run.source.frame(APPEARS).expect("a frame").color;
    assert_ne!(run.pipeline.composed().as_slice(), camera.as_slice(), "the object is there");
    // a frame more fills holes; a map begun here would have none with two frames' weight
    let after = run.vertices();
    assert!(after >= before && after < before * 5 / 4, "{before} vertices, then {after}");
    run.frames(APPEARS + 1..FRAMES);
}

#[test]
fn settings_that_find_no_room_are_taken_by_the_cpu() {
    let Some(mut run) = Run::start() else { return };
    run.frames(0..2);
    run.fill_memory();
    let mut finer = run.pipeline.settings().clone();
    finer.set("transfer.subsampling", "1").expect("a setting");
    run.pipeline.reconfigure(finer.clone()).expect("the CPU has room");
    run.is_on_cpu_since(2, "out of GPU memory");
    assert_eq!(run.pipeline.settings().transfer.subsampling, finer.transfer.subsampling);
    run.frames(2..FRAMES);
}

#[test]
fn a_device_that_does_not_open_again_leaves_the_run_to_the_cpu() {
    let Some(run) = Run::start() else { return };
    let Run { gpu, source, pipeline } = run;
    let pipeline = pipeline.reopening(Box::new(|| Err(GpuError::NoAdapter)));
    let mut run = Run { gpu, source, pipeline };
    run.frames(0..1);
    run.gpu.destroy();
    run.frames(1..FRAMES);
    run.is_on_cpu_since(1, "and opening it anew failed: no Vulkan");
}

#[test]
fn the_cpu_is_no_substitute_for_a_first_frame_that_was_insisted_on() {
    let Some(Run { gpu, source, pipeline }) = Run::start() else { return };
    let mut run = Run { gpu, source, pipeline: pipeline.insisting(true) };
    run.fill_memory();
    let error = run.frame(0).expect_err("the volume finds no room");
    assert!(error.is_the_devices(), "{error}");
    assert!(run.pipeline.on_host().is_none());
}

/// A mistake of the program, not of the device, is never made up for.
#[test]
fn what_is_wrong_at_the_end_of_a_run_is_its_error() {
    let Some(mut run) = Run::start() else { return };
    run.frames(0..1);
    run.pipeline.check().expect("nothing is wrong");
    run.gpu.destroy();
    assert!(run.pipeline.check().is_err_and(|e| e.is_the_devices()));
}
