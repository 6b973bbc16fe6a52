//! Both pipelines over the same frames.

mod buffers;
mod traffic;

use super::*;
use crate::capture::{CaptureOptions, FrameSource, RawFrame, Sequence, open_sequence};
use crate::gpu::parity::Difference;
use crate::gpu::{AdapterChoice, StageTimer};
use crate::pipeline::{Backend, FrameOutcome, Pipeline, PipelineError, WithFallback};
use crate::synth::{SynthOptions, generate};
use crate::timing::{Stage, StageTimes};
use crate::tracking::{OnLost, PoseMode};
use std::sync::OnceLock;

const FRAMES: usize = 6;

/// A made desk, small and short: its folder lives as long as the process.
fn sequence() -> Sequence {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let options = SynthOptions {
            frames: FRAMES,
            width: 160,
            height: 120,
            samples: 4,
            with_virtual: true,
            virtual_every: 100,
            ..SynthOptions::default()
        };
        generate(&options, &folder.path().join("desk"), &|_, _| {}).expect("a free folder");
        folder
    });
    open_sequence(&folder.path().join("desk"), &CaptureOptions::default()).expect("a sequence")
}

fn scene(sequence: &Sequence) -> VirtualScene {
    VirtualScene::load(&sequence.info().folder.join("scene.toml")).expect("its scene")
}

/// A device of its own for each test, as its traffic is counted and one test destroys it.
fn gpu() -> Option<Arc<Gpu>> {
    crate::gpu::stages::test_support::gpu()?;
    Some(Arc::new(Gpu::open(&AdapterChoice::Best).expect("it opened before")))
}

fn settings(changes: &[(&str, &str)]) -> Settings {
    let mut settings = Settings::preset("ours-fast-mobile").expect("a preset");
    settings.dyn_geo.denoise = true;
    for (key, value) in changes {
        settings.set(key, value).expect("a setting");
    }
    settings.validate().expect("settings");
    settings
}

struct Both {
    cpu: Pipeline,
    gpu: GpuPipeline,
}

impl Both {
    fn new(gpu: &Arc<Gpu>, settings: &Settings, source: &Sequence, scene: &VirtualScene) -> Self {
        let camera = source.camera();
        let of_gpu = GpuPipeline::new(gpu.clone(), settings.clone(), camera, scene.clone());
        Self {
            cpu: Pipeline::new(settings.clone(), camera, scene.clone()).expect("a pipeline"),
            gpu: of_gpu.expect("a pipeline"),
        }
    }

    fn process(&mut self, raw: &RawFrame) -> [FrameOutcome; 2] {
        let cpu = self.cpu.process(raw.clone(), StageTimes::default()).expect("on the CPU");
        let gpu = self.gpu.process(raw, StageTimes::default()).expect("on the GPU");
        [cpu, gpu]
    }

    /// Share of the values of the pictures that are more than 1 apart, and the largest difference.
    fn pictures(&self) -> (f64, f32) {
        let codes = |picture: &Image<[u8; 3]>| -> Vec<f32> {
            picture.as_slice().as_flattened().iter().map(|&code| f32::from(code)).collect()
        };
        let (cpu, gpu) = (codes(self.cpu.composed()), codes(self.gpu.composed()));
        let found = Difference::of(&cpu, &gpu, 1.0);
        println!("  pictures: {found}");
        let apart = |(a, b): (&f32, &f32)| (a - b).abs();
        let above = cpu.iter().zip(&gpu).filter(|&pair| apart(pair) > 1.0).count();
        let largest = cpu.iter().zip(&gpu).map(apart).fold(0.0, f32::max);
        (above as f64 / cpu.len() as f64, largest)
    }
}

/// Metres, degrees.
fn apart(a: &Pose, b: &Pose) -> (f64, f64) {
    let difference = a.inverse() * b;
    (difference.translation.vector.norm(), difference.rotation.angle().to_degrees())
}

fn degrees_apart(a: &LightEstimate, b: &LightEstimate) -> f32 {
    let [a, b] = [a, b].map(|e| e.light.dominant_direction().expect("a direction"));
    a.cross(b).length().atan2(a.dot(b)).to_degrees()
}

fn check_run(changes: &[(&str, &str)]) {
    let Some(gpu) = gpu() else { return };
    let mut source = sequence();
    let scene = scene(&source);
    let mut both = Both::new(&gpu, &settings(changes), &source, &scene);
    while let Some(raw) = source.next_frame().expect("a frame") {
        let [cpu, gpu] = both.process(&raw);
        let (metres, degrees) =
            apart(&cpu.tracking.world_from_camera, &gpu.tracking.world_from_camera);
        let light = degrees_apart(&cpu.light, &gpu.light);
        println!(
            "frame {} {:?}: {metres:.2e} m, {degrees:.2e} degrees; light {light:.4} degrees",
            raw.index, gpu.tracking.state
        );
        let (above, largest) = both.pictures();
        assert_eq!(cpu.tracking.state, gpu.tracking.state, "frame {}", raw.index);
        assert_eq!((cpu.composed, cpu.light.valid()), (gpu.composed, gpu.light.valid()));
        assert!(metres < 1e-4 && degrees < 0.01, "frame {}: {metres} {degrees}", raw.index);
        assert!(light < 0.5, "frame {}: {light} degrees", raw.index);
        assert!(above < 1e-3, "frame {}: {above} above 1, largest {largest}", raw.index);
        let shown = both.gpu.composed().as_slice() != raw.color.as_slice();
        assert!(shown, "frame {} shows no virtual object", raw.index);
    }
    gpu.check().expect("no error of the device");
    let (cpu, gpu) = (both.cpu.mesh(), both.gpu.mesh().expect("a mesh"));
    let ratio = gpu.positions.len() as f64 / cpu.positions.len() as f64;
    assert!((ratio - 1.0).abs() < 0.01, "{ratio} times as many vertices");
    let traffic = both.gpu.record().traffic.expect("it is counted");
    println!("{traffic:?}");
    assert!(traffic.uploaded > 7 * 160 * 120, "a frame is uploaded");
    let picture = 3 * 160 * 120;
    assert_eq!(traffic.picture, picture);
    assert!(traffic.read_back - picture < 64 << 10, "only sums, samples and times come back");
}

#[test]
fn a_tracked_run_gives_what_the_cpu_gives() {
    check_run(&[]);
}

#[test]
fn and_so_does_a_run_at_every_pixel_without_bounce() {
    check_run(&[
        ("transfer.subsampling", "1"),
        ("light.stride", "2"),
        ("bounce.enabled", "false"),
        ("transfer.directions", "16"),
        ("surface.left", "true"),
    ]);
}

#[test]
fn and_so_does_a_ray_traced_run_that_refines() {
    check_run(&[
        ("transfer.method", "ray-traced"),
        ("transfer.refine", "true"),
        ("bounce.enabled", "false"),
        ("surface.top", "false"),
        ("surface.light", "false"),
    ]);
}

/// Settings change, objects move out of sight and come back, under a given light.
#[test]
fn other_settings_and_objects_are_taken_in_mid_run() {
    let Some(gpu) = gpu() else { return };
    let mut source = sequence();
    let objects = scene(&source);
    let mut both = Both::new(&gpu, &settings(&[]), &source, &objects);
    let first = source.frame(0).expect("a frame");
    let [cpu, _] = both.process(&first);
    for light in [Some(cpu.light.light.clone()), None] {
        both.cpu.set_light(light.clone());
        both.gpu.set_light(light);
        for (step, method) in [("2", "image-space"), ("4", "ray-traced"), ("4", "image-space")] {
            let changed = settings(&[
                ("transfer.subsampling", step),
                ("transfer.method", method),
                ("bounce.enabled", "false"),
                ("dyn_geo.smooth", "false"),
            ]);
            both.cpu.reconfigure(changed.clone()).expect("they may change");
            both.gpu.reconfigure(changed).expect("they may change");
            let [cpu, gpu] = both.process(&first);
            assert!(cpu.composed && gpu.composed);
            let (above, largest) = both.pictures();
            assert!(above < 1e-3, "step {step}, {method}: {above}, largest {largest}");
        }
    }
    for moved in [50.0, -50.0] {
        both.cpu.scene.translate(glam::Vec3::X * moved);
        both.gpu.scene.translate(glam::Vec3::X * moved);
        both.process(&first);
        let plain = both.gpu.composed().as_slice() == first.color.as_slice();
        assert_eq!(plain, moved > 0.0);
        let (above, largest) = both.pictures();
        // A rim is seen past on one side alone by few points of the grid; each shades 8 x 8 pixels.
        let three_points = 3.0 * 64.0 / (160.0 * 120.0);
        assert!(above < three_points, "moved by {moved}: {above}, largest {largest}");
    }
    let fixed = both.gpu.reconfigure(settings(&[("volume.resolution", "128")]));
    assert!(matches!(fixed, Err(PipelineError::Fixed { section: "volume" })));
}

#[test]
fn a_lost_camera_holds_and_resets_as_on_the_cpu() {
    let Some(gpu) = gpu() else { return };
    for on_lost in [OnLost::Hold, OnLost::Reset, OnLost::Stop] {
        let mut source = sequence();
        let objects = scene(&source);
        let mut settings = settings(&[]);
        settings.tracking.on_lost = on_lost;
        settings.tracking.mode = PoseMode::Track;
        let mut both = Both::new(&gpu, &settings, &source, &objects);
        let first = source.frame(0).expect("a frame");
        let mut covered = source.frame(1).expect("a frame");
        covered.depth_m.as_mut_slice().fill(0.0);
        both.process(&first);
        if on_lost == OnLost::Stop {
            let ended = [
                both.cpu.process(covered.clone(), StageTimes::default()).err(),
                both.gpu.process(&covered, StageTimes::default()).err(),
            ];
            assert!(ended.iter().all(|e| matches!(e, Some(PipelineError::Lost { frame: 1, .. }))));
            continue;
        }
        for raw in [&covered, &first, &first] {
            let [cpu, gpu] = both.process(raw);
            assert_eq!(cpu.tracking.state, gpu.tracking.state, "{on_lost:?}");
            assert_eq!((cpu.composed, cpu.light.valid()), (gpu.composed, gpu.light.valid()));
            assert!(both.pictures().0 < 1e-3);
        }
    }
}

#[test]
fn a_lost_device_ends_no_run() {
    let Some(gpu) = gpu() else { return };
    let mut source = sequence();
    let objects = scene(&source);
    let camera = source.camera();
    let pipeline = GpuPipeline::new(gpu.clone(), settings(&[]), camera, objects).expect("one");
    let mut pipeline = WithFallback::new(pipeline);
    for index in 0..4 {
        if index == 2 {
            gpu.device().destroy();
        }
        let raw = source.frame(index).expect("a frame");
        let color = raw.color.clone();
        let outcome = pipeline.process(raw, StageTimes::default()).expect("a frame");
        assert!(outcome.composed, "frame {index}: {:?}", outcome.tracking);
        assert!(outcome.tracking.may_fuse());
        assert_ne!(pipeline.composed().as_slice(), color.as_slice(), "frame {index}");
        assert_eq!(pipeline.on_host().is_some(), index >= 2, "frame {index}");
    }
    assert_eq!(pipeline.record().name, "gpu, then cpu");
    assert!(!pipeline.mesh().expect("the CPU's").positions.is_empty());
}

#[test]
fn either_clock_finds_all_stages() {
    let Some(gpu) = gpu() else { return };
    let mut source = sequence();
    let objects = scene(&source);
    let camera = source.camera();
    let mut pipeline = GpuPipeline::new(gpu, settings(&[]), camera, objects).expect("a pipeline");
    let of_device = StageTimer::new(&pipeline.gpu).expect("a timer");
    for timer in [None, of_device] {
        let measures_passes = timer.is_some();
        pipeline.clock = StageClock::with(timer);
        let raw = source.next_frame().expect("a frame").expect("a frame");
        let outcome = pipeline.process(&raw, StageTimes::default()).expect("a frame");
        for stage in Stage::ALL {
            assert!(!outcome.times.get(stage).is_zero(), "{}", stage.name());
        }
        let (update, duration) = (outcome.times.update(), outcome.duration);
        println!("{}: {:?} of {duration:?}", pipeline.clock.name(), outcome.times);
        // the host's clock leaves nothing out but what lies around the stages; on the device's they overlap
        assert!(measures_passes || (update <= duration && update > duration / 2));
    }
}
