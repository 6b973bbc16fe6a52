//! Verdicts must be able to fail: whatever is disturbed on one side is found.

use super::stages::{Bench, Fused};
use super::tolerances::*;
use super::*;
use crate::capture::{CaptureOptions, Sequence, open_sequence};
use crate::geometry::Origin;
use crate::gpu::stages::test_support::gpu;
use crate::image::Image;
use crate::math::Pose;
use crate::pipeline::{FrameOutcome, ObjectBuffers};
use crate::synth::{SynthOptions, generate};
use std::sync::OnceLock;

/// A made desk with its object; its folder lives as long as the process.
fn sequence() -> (Sequence, VirtualScene) {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let options = SynthOptions {
            frames: 3,
            width: 80,
            height: 60,
            samples: 2,
            with_virtual: true,
            virtual_every: 100,
            ..SynthOptions::default()
        };
        generate(&options, &folder.path().join("desk"), &|_, _| {}).expect("a free folder");
        folder
    });
    let folder = folder.path().join("desk");
    let sequence = open_sequence(&folder, &CaptureOptions::default()).expect("a sequence");
    (sequence, VirtualScene::load(&folder.join("scene.toml")).expect("its scene"))
}

fn settings() -> Settings {
    let mut settings = Settings::preset("ours-fast-mobile").expect("a preset");
    settings.set("surface.auxiliary_resolution", "64").expect("a setting");
    settings
}

/// The CPU's pipeline after all frames, the volumes of the device after all and after all but one, and what was
/// found for the frames as they are.
struct Made {
    gpu: &'static Gpu,
    settings: Settings,
    raw: RawFrame,
    cpu: Pipeline,
    outcome: FrameOutcome,
    model: GBuffer,
    fused: Fused,
    before: crate::fusion::TsdfVolume,
}

impl Made {
    fn new(gpu: &'static Gpu) -> Self {
        let (mut source, scene) = sequence();
        let settings = settings();
        let mut cpu = Pipeline::new(settings.clone(), source.camera(), scene).expect("a pipeline");
        let mut fused = Fused::default();
        let (mut before, mut model, mut last) = (None, None, None);
        while let Some(raw) = source.next_frame().expect("a frame") {
            before = fused.volume().map(|volume| volume.download(gpu).expect("a volume"));
            model = cpu.model().cloned();
            let outcome = cpu.process(raw.clone(), StageTimes::default()).expect("a frame");
            let seen = cpu.stages().expect("it is composed");
            fused.follow(gpu, seen.volume, seen.frame, &seen.model.view).expect("room");
            last = Some((raw, outcome));
        }
        let (raw, outcome) = last.expect("three frames");
        let (before, model) = (before.expect("a volume"), model.expect("a model"));
        Self { gpu, settings, raw, cpu, outcome, model, fused, before }
    }

    fn ledger(&self, compare: impl FnOnce(&mut Bench) -> Result<(), ParityError>) -> Ledger {
        let mut ledger = Ledger::new(self.gpu.summary().is_software());
        let bench = &mut Bench {
            gpu: self.gpu,
            settings: &self.settings,
            ledger: &mut ledger,
            frame: self.raw.index,
        };
        compare(bench).expect("no error");
        ledger
    }

    fn seen(&self) -> StageBuffers<'_> {
        self.cpu.stages().expect("it is composed")
    }

    fn objects(&self) -> ObjectBuffers<'_> {
        self.seen().with_objects.expect("the object is seen")
    }
}

fn is_within(ledger: &Ledger, tolerance: &'static Tolerance) -> bool {
    let found = ledger.found(tolerance);
    let found = found.unwrap_or_else(|| panic!("no {}", tolerance.quantity));
    found.is_within(ledger.limit(tolerance))
}

/// Far more than any allowed share.
fn disturb<T: Clone>(values: &[T], change: impl Fn(&mut T)) -> Vec<T> {
    let mut values = values.to_vec();
    values.iter_mut().step_by(7).for_each(change);
    values
}

fn disturbed_depth(buffer: &GBuffer) -> GBuffer {
    let mut buffer = buffer.clone();
    let depth_m = disturb(buffer.depth_m.as_slice(), |d| *d += 0.01);
    buffer.depth_m = Image::from_vec(buffer.size(), depth_m);
    buffer
}

#[test]
fn every_stage_is_within_and_a_disturbed_one_is_not() {
    let Some(gpu) = gpu() else { return };
    let made = Made::new(gpu);
    let (seen, objects, volume) = (made.seen(), made.objects(), made.fused.volume().unwrap());
    assert!(objects.shows());
    let voxels = volume.download(gpu).unwrap();
    let whole =
        made.ledger(|b| compare_stages(b, &made.raw, Some(&made.model), &seen, &made.fused));
    let compared: Vec<_> =
        STAGES.into_iter().filter(|tolerance| whole.found(tolerance).is_some()).collect();
    assert_eq!(compared.len(), STAGES.len() - 2, "all but transfer by rays");
    for tolerance in compared {
        let found = whole.found(tolerance);
        assert!(is_within(&whole, tolerance), "{} {found:?}", tolerance.quantity);
    }

    let mut frame = seen.frame.clone();
    let color = disturb(frame.color.as_slice(), |c| c[1] += 1e-3);
    frame.color = Image::from_vec(frame.color.size(), color);
    let found = made.ledger(|b| stages::input(b, &made.raw, &frame));
    assert!(!is_within(&found, &INPUT_COLOR) && is_within(&found, &INPUT_DEPTH));

    let found = made.ledger(|b| {
        stages::fusion(b, seen.volume, &made.before);
        stages::raycast(b, volume, &made.before, [seen.model.view])
    });
    assert!(!is_within(&found, &FUSION_WEIGHT) && !is_within(&found, &FUSION_DISTANCE));
    assert!(!is_within(&found, &RAYCAST_DEPTH));

    let real = disturbed_depth(seen.real);
    let found = made.ledger(|b| stages::dyn_geo(b, &StageBuffers { real: &real, ..seen.clone() }));
    assert!(!is_within(&found, &DYNGEO_DEPTH) && is_within(&found, &DYNGEO_NORMAL));
    let other = StageBuffers { real: &real, ..seen.clone() };
    let found = made.ledger(|b| stages::transfer(b, &other, volume, &voxels));
    assert!(!is_within(&found, &TRANSFER));

    let mut transfer = seen.real_transfer.clone();
    transfer.coefficients = disturb(&transfer.coefficients, |t| *t += 1e-4);
    let other = StageBuffers { real_transfer: &transfer, ..seen.clone() };
    let found = made.ledger(|b| stages::transfer(b, &other, volume, &voxels));
    assert!(!is_within(&found, &TRANSFER));
}

#[test]
fn disturbed_objects_are_found() {
    let Some(gpu) = gpu() else { return };
    let made = Made::new(gpu);
    let (seen, objects, volume) = (made.seen(), made.objects(), made.fused.volume().unwrap());
    let voxels = volume.download(gpu).unwrap();

    let mut main = disturbed_depth(objects.main);
    main.origin.as_mut_slice().iter_mut().step_by(9).for_each(|o| *o = Origin::None);
    let mut layer = objects.layer.clone();
    let coverage = disturb(layer.coverage.as_slice(), |c| *c += 0.125);
    layer.coverage = Image::from_vec(main.size(), coverage);
    layer.albedo.as_mut_slice().iter_mut().for_each(|rgb| rgb[2] += 0.01);
    let other = ObjectBuffers { main: &main, layer: &layer, ..objects.clone() };
    let found = made.ledger(|b| stages::raster(b, &seen, &other));
    for tolerance in [&RASTER_DEPTH, &RASTER_ORIGIN, &RASTER_COVERAGE, &RASTER_COLOR] {
        assert!(!is_within(&found, tolerance), "{}", tolerance.quantity);
    }

    let (radiance, sides) = objects.radiance.unwrap();
    let brighter = disturb(radiance.as_slice(), |rgb| rgb[0] += 1e-4);
    let brighter = Image::from_vec(radiance.size(), brighter);
    let other = ObjectBuffers { radiance: Some((&brighter, sides)), ..objects.clone() };
    assert!(!is_within(&made.ledger(|b| stages::exitant(b, &seen, &other)), &EXITANT));

    let mut transfer = objects.transfer.clone();
    transfer.coefficients = disturb(&transfer.coefficients, |t| *t += 1e-4);
    let mut indirect = objects.indirect.unwrap().clone();
    indirect.rgb = disturb(&indirect.rgb, |rgb| rgb[1] += 1e-4);
    let other = ObjectBuffers { transfer: &transfer, indirect: Some(&indirect), ..objects.clone() };
    let other = StageBuffers { with_objects: Some(other), ..seen.clone() };
    let found = made.ledger(|b| stages::transfer(b, &other, volume, &voxels));
    assert!(is_within(&found, &TRANSFER));
    assert!(!is_within(&found, &MERGED_TRANSFER) && !is_within(&found, &BOUNCE));

    let picture = disturb(seen.composed.as_slice(), |rgb| rgb[0] ^= 2);
    let picture = Image::from_vec(seen.composed.size(), picture);
    let other = StageBuffers { composed: &picture, ..seen.clone() };
    assert!(!is_within(&made.ledger(|b| stages::compositing(b, &other, &objects)), &COMPOSITING));
}

#[test]
fn traced_transfer_is_compared_on_the_same_voxels() {
    let Some(gpu) = gpu() else { return };
    let (mut made, settings) = (Made::new(gpu), settings());
    made.settings = Settings {
        bounce: crate::transfer::BounceParams { enabled: false, ..settings.bounce },
        ..settings
    };
    made.settings.set("transfer.method", "ray-traced").unwrap();
    let (seen, volume) = (made.seen(), made.fused.volume().unwrap());
    let voxels = volume.download(gpu).unwrap();
    let same = made.ledger(|b| stages::transfer(b, &seen, volume, &voxels));
    let other = made.ledger(|b| stages::transfer(b, &seen, volume, &made.before));
    for tolerance in [&TRACED_TRANSFER, &TRACED_MERGED_TRANSFER] {
        assert!(is_within(&same, tolerance), "{:?}", same.found(tolerance));
        assert!(!is_within(&other, tolerance), "{:?}", other.found(tolerance));
    }
}

/// One frame of a run, with `change` made to what the other backend gave.
fn run_with(
    made: &Made,
    change: impl FnOnce(&mut FrameOutcome, &mut Image<[u8; 3]>),
) -> Vec<&'static str> {
    let (mut other, mut picture) = (made.outcome.clone(), made.cpu.composed().clone());
    change(&mut other, &mut picture);
    let mut run = WholeRun::default();
    let cpu = (&made.outcome, made.cpu.composed());
    run.add([cpu.0, cpu.0], [cpu.1, cpu.1]);
    run.add([cpu.0, &other], [cpu.1, &picture]);
    let summaries = run.summaries(true);
    assert_eq!(summaries.len(), 6);
    summaries.iter().filter(|summary| !summary.within).map(|summary| summary.quantity).collect()
}

#[test]
fn one_bad_frame_of_a_run_is_found() {
    let Some(gpu) = gpu() else { return };
    let made = &Made::new(gpu);
    assert!(run_with(made, |_, _| {}).is_empty());
    let moved = run_with(made, |outcome, _| {
        outcome.tracking.world_from_camera *= Pose::translation(0.0, 2e-4, 0.0);
    });
    assert_eq!(moved, ["camera position"]);
    let turned = run_with(made, |outcome, _| {
        let turn = nalgebra::UnitQuaternion::from_euler_angles(3e-4, 0.0, 0.0);
        outcome.tracking.world_from_camera *= turn;
    });
    assert_eq!(turned, ["camera rotation"]);
    let lit = run_with(made, |outcome, _| {
        let light = &mut outcome.light.light.coefficients;
        (light[1], light[3]) = (light[1].map(|c| c + 0.05), light[3].map(|c| c - 0.05));
    });
    assert_eq!(lit, ["light direction"]);
    let dark = run_with(made, |outcome, _| {
        outcome.light.light.coefficients.fill([0.0; 3]);
    });
    assert_eq!(dark, ["light direction"]);
    // in one of two frames
    let painted = |share_of_values: f64| {
        run_with(made, |_, picture| {
            let values = 3.0 * picture.as_slice().len() as f64;
            let pixels =
                picture.as_mut_slice().iter_mut().take((share_of_values * values) as usize);
            pixels.for_each(|rgb| rgb[0] ^= 4);
        })
    };
    assert!(painted(0.001).is_empty());
    assert_eq!(painted(0.003), ["values beyond 1/255"]);
    assert_eq!(painted(0.005), ["values beyond 1/255", "... in one frame"]);
    let lost = run_with(made, |outcome, _| {
        outcome.tracking.state = crate::tracking::TrackingState::Lost;
    });
    assert_eq!(lost, ["state, validity"]);
}

#[test]
fn frames_are_spread_from_the_first_to_the_last() {
    let chosen = |frames: usize, count: usize| -> Vec<usize> {
        let mut chosen = Chosen::new(frames, count);
        // the first frame of a range has any number
        (100..100 + frames).filter(|&index| chosen.next(index)).map(|index| index - 100).collect()
    };
    assert_eq!(chosen(10, 3), [0, 4, 9]);
    assert_eq!(chosen(10, 1), [0]);
    assert_eq!(chosen(2, 5), [0, 1]);
    assert_eq!(chosen(1, 3), [0]);
}
