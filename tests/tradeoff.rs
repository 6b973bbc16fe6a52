//! Settings that change while a pipeline runs, sweeps, profiles and budgets.

mod common;

use common::recording::{Recording, demo_folder, small_demo};
use common::{kinlight, kinlight_json, text};
use kinlight::budget::{Governor, Ladder, Profile, ProfileStep};
use kinlight::config::Settings;
use kinlight::geometry::GBuffer;
use kinlight::lighting::LightEstimate;
use kinlight::pipeline::{FrameOutcome, Pipeline, PipelineError};
use kinlight::scene::VirtualScene;
use kinlight::study::Machine;
use kinlight::study::tradeoff::ErrorKind;
use kinlight::timing::{Stage, StageTimes};
use std::path::Path;
use std::time::Duration;

/// For pictures of 160x120; without what remembers frames before: memory of the light, buffers
/// that are redone in turn or placed by the light.
fn without_memory() -> Settings {
    let mut settings = Settings::preset("ours-fast-mobile").unwrap();
    settings.surface.auxiliary_resolution = 128;
    settings.surface.refresh_per_frame = 0;
    settings.surface.light = false;
    settings.light.memory = 0.0;
    settings
}

fn changed(settings: &Settings, changes: &[&str]) -> Settings {
    let mut settings = settings.clone();
    changes.iter().for_each(|c| settings.assign(c).unwrap());
    settings.validate().unwrap();
    settings
}

fn pipeline(recording: &Recording, settings: &Settings) -> Pipeline {
    let scene = VirtualScene::load(&demo_folder().join("scene.toml")).unwrap();
    Pipeline::new(settings.clone(), recording.camera, scene).unwrap()
}

fn process(pipeline: &mut Pipeline, recording: &Recording, frame: usize) -> FrameOutcome {
    pipeline.process(recording.frames[frame].clone(), StageTimes::default()).unwrap()
}

fn assert_same_geometry(a: &GBuffer, b: &GBuffer, what: &str) {
    assert!(a.depth_m == b.depth_m && a.normals == b.normals && a.origin == b.origin, "{what}");
}

#[test]
fn after_a_change_everything_is_as_if_it_had_always_been_so() {
    let recording = small_demo(6);
    let before = without_memory();
    for changes in [
        &["transfer.subsampling=2", "transfer.directions=16", "transfer.samples=1"][..],
        &["transfer.bands=3"],
        &["transfer.bands=5", "light.stride=1"],
        &["surface.left=false", "surface.top=false"],
        &["surface.auxiliary_resolution=64"],
        &["dyn_geo.denoise=true", "dyn_geo.smooth=false"],
        &["bounce.enabled=false"],
        &["compositing.upsampling=bicubic-gauss", "compositing.antialias=false"],
        &["light.channels=rgb"],
    ] {
        let after = changed(&before, changes);
        let mut always = pipeline(&recording, &after);
        let mut switched = pipeline(&recording, &before);
        for frame in 0..3 {
            process(&mut always, &recording, frame);
            process(&mut switched, &recording, frame);
        }
        switched.reconfigure(after.clone()).unwrap();
        assert_eq!(switched.settings(), &after);
        for frame in 3..6 {
            let (a, b) = (
                process(&mut always, &recording, frame),
                process(&mut switched, &recording, frame),
            );
            let what = format!("{changes:?}, frame {frame}");
            assert_eq!(a.tracking.world_from_camera, b.tracking.world_from_camera, "{what}");
            assert_eq!(a.volume_bytes, b.volume_bytes, "{what}");
            assert!(b.composed && b.light.valid(), "{what}: {:?}", b.light.rejection);
            assert_eq!(a.light.light, b.light.light, "{what}");
            let ((real_a, merged_a), (real_b, merged_b)) =
                (always.geometry().unwrap(), switched.geometry().unwrap());
            assert_same_geometry(real_a, real_b, &what);
            assert_same_geometry(merged_a, merged_b, &what);
            assert!(always.composed() == switched.composed(), "{what}: composed pictures differ");
        }
        let (a, b) = (always.mesh(), switched.mesh());
        assert!(!a.positions.is_empty() && a.positions == b.positions, "{changes:?}");
    }
}

#[test]
fn the_light_remembers_across_a_change_where_bands_stay() {
    let recording = small_demo(8);
    let mut before = without_memory();
    before.light.memory = 0.9;
    let run = |after: Option<&[&str]>| {
        let mut pipeline = pipeline(&recording, &before);
        (0..5).for_each(|frame| drop(process(&mut pipeline, &recording, frame)));
        if let Some(changes) = after {
            pipeline.reconfigure(changed(&before, changes)).unwrap();
        }
        process(&mut pipeline, &recording, 5).light
    };
    let kept = run(None);
    let more = run(Some(&["transfer.directions=64"]));
    let forgotten = run(Some(&["transfer.directions=64", "light.memory=0"]));
    // What five frames left behind is in the light of the sixth: without it, that is ten times as far away.
    let off = |light: &LightEstimate| -> f32 {
        let [a, b] = [light, &kept].map(|l| l.light.coefficients.iter().map(|c| c[0]));
        a.zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f32>().sqrt()
    };
    let (with, without) = (off(&more), off(&forgotten));
    assert!(with < 0.3 * without, "{with} {without}");
    // And it lowers each deviation (by 6 to 12 %: what is not seen of the lamp and beside it stays).
    for i in 0..4 {
        let (with, without) = (more.deviation[i], forgotten.deviation[i]);
        assert!(with < 0.96 * without, "coefficient {i}: {with} {without}");
    }
    let fewer = run(Some(&["transfer.bands=2"]));
    assert_eq!((fewer.light.bands, fewer.light.coefficients.len()), (2, 4));
    assert!(fewer.valid());
}

#[test]
fn a_dark_frame_after_a_change_of_bands_keeps_a_light_of_the_new_bands() {
    let recording = small_demo(4);
    let dark = small_demo(4).with_color(0);
    for bands in ["transfer.bands=2", "transfer.bands=6"] {
        let before = without_memory();
        let after = changed(&before, &[bands]);
        let mut pipeline = pipeline(&recording, &before);
        (0..3).for_each(|frame| drop(process(&mut pipeline, &recording, frame)));
        let direction = pipeline.light().unwrap().light.dominant_direction();
        pipeline.reconfigure(after.clone()).unwrap();
        let outcome = process(&mut pipeline, &dark, 3);
        assert!(outcome.composed && !outcome.light.valid());
        let light = &outcome.light;
        assert_eq!(light.light.bands, after.transfer.bands);
        assert_eq!(light.light.coefficients.len(), after.transfer.bands.pow(2));
        assert_eq!(light.deviation.len(), after.transfer.bands.pow(2));
        assert_eq!(light.light.dominant_direction(), direction);
        assert!(pipeline.shading().is_some());
    }
}

#[test]
fn what_holds_the_map_cannot_change() {
    let recording = small_demo(2);
    let before = without_memory();
    let mut pipeline = pipeline(&recording, &before);
    process(&mut pipeline, &recording, 0);
    for (change, section) in [
        ("volume.resolution=128", "volume"),
        ("tracking.mode=static", "tracking"),
        ("input.color_filter=median", "input"),
    ] {
        let other = changed(&before, &[change, "transfer.directions=8"]);
        let error = pipeline.reconfigure(other).unwrap_err();
        assert!(matches!(error, PipelineError::Fixed { section: s } if s == section), "{error}");
        assert_eq!(pipeline.settings(), &before, "nothing changed");
    }
    assert!(pipeline.geometry().is_some());
    pipeline.reconfigure(before.clone()).unwrap();
    assert!(pipeline.geometry().is_none() && pipeline.shading().is_none());
    assert!(process(&mut pipeline, &recording, 1).composed);
}

/// A profile of which the first step is predicted to take 300 ms, and so on.
fn profile(steps: &[(&[&str], f64, f64)]) -> Profile {
    Profile {
        error: ErrorKind::Composite,
        sequences: vec!["sequences/demo".into()],
        machine: Machine::here(),
        steps: steps
            .iter()
            .map(|(changes, update_ms, error)| ProfileStep {
                name: changes.join(", "),
                preset: "ours-fast-mobile".into(),
                changes: changes.iter().map(|c| (*c).to_owned()).collect(),
                update_ms: *update_ms,
                error: *error,
                stage_ms: [].into(),
            })
            .collect(),
    }
}

/// The governor with real pipelines, on a clock of our own.
#[test]
fn a_governor_changes_the_pipeline_and_says_so() {
    let recording = small_demo(3);
    let profile = profile(&[
        (&["transfer.directions=16"], 40.0, 0.3),
        (&["transfer.directions=32"], 80.0, 0.2),
        (&["transfer.directions=64"], 160.0, 0.1),
    ]);
    let budget = Duration::from_millis(100);
    let ladder = Ladder::choose(&profile, budget, &|_| Ok(())).unwrap();
    let mut governor = Governor::new(ladder, budget);
    let mut pipeline = pipeline(&recording, &governor.rung().settings);
    assert_eq!(pipeline.settings().transfer.directions, 32);
    let outcome = process(&mut pipeline, &recording, 0);
    let mut after = |ms: u64, composed: bool| {
        let mut times = StageTimes::default();
        times.add(Stage::RadTransfer, Duration::from_millis(ms));
        let outcome = FrameOutcome { times, composed, ..outcome.clone() };
        governor.after_frame(&mut pipeline, &outcome).unwrap().map(str::to_owned)
    };
    assert!((0..50).all(|_| after(2000, false).is_none()), "frames without picture do not count");
    let said: Vec<String> = (0..20).filter_map(|_| after(150, true)).collect();
    assert_eq!(said, ["transfer.directions=16"]);
    let said: Vec<String> = (0..60).filter_map(|_| after(20, true)).collect();
    // 20 ms at a predicted 40: 160 would take 80 of 100, within 85 %
    assert_eq!(said, ["transfer.directions=64"]);
    assert_eq!(pipeline.settings().transfer.directions, 64);
    let summary = governor.summary();
    assert_eq!((summary.frames, summary.within, summary.switches.len()), (80, 60, 2));
    assert_eq!(summary.started_with, "transfer.directions=32");
    assert_eq!(summary.ended_with, "transfer.directions=64");
    assert!(process(&mut pipeline, &recording, 1).composed);
}

fn small_sequence(frames: usize) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    small_demo(frames).write(folder.path());
    let light = demo_folder().join("light.json");
    std::fs::copy(light, folder.path().join("light.json")).unwrap();
    folder
}

fn setting_column(folder: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(folder.join("timings.csv")).unwrap();
    let mut lines = text.lines().map(|line| line.rsplit_once(',').unwrap().1.to_owned());
    assert_eq!(lines.next().as_deref(), Some("setting"));
    lines.collect()
}

#[test]
fn a_sweep_writes_its_files_and_a_profile_that_budgets_choose_from() {
    let sequence = small_sequence(6);
    let folder = tempfile::tempdir().unwrap();
    let (out, place) = (folder.path().join("study"), folder.path().join("profile.toml"));
    let sweep =
        ["tradeoff", text(sequence.path()), "--quick", "--frames", "0..6", "--warm-up", "3"];
    let result = kinlight_json(
        &[&sweep[..], &["--out", text(&out), "--profile", text(&place), "--threads", "2"]].concat(),
    );
    assert_eq!(result["error"], "transfer", "there is no composite/ here, and a surface to trace");
    let points = result["points"].as_u64().unwrap();
    assert!(points >= 15);
    let study = std::fs::read(out.join("study.json")).unwrap();
    let study: kinlight::study::tradeoff::Tradeoff = serde_json::from_slice(&study).unwrap();
    assert_eq!((study.points.len() as u64, study.machine.threads, study.warm_up), (points, 2, 3));
    for p in &study.points {
        let stages: f64 = Stage::ALL.iter().map(|s| p.stage_ms[s.name()]).sum();
        // medians of stages do not add up to the median of sums, but nearly
        assert!(
            (0.5..1.5).contains(&(stages / p.update_ms)),
            "{}: {stages} {}",
            p.name,
            p.update_ms
        );
        assert!(p.light_angle_deg.is_some() && p.composite_error.is_none());
        // 1 is what a transfer of zeros would have
        assert!(
            p.transfer_error.is_some_and(|e| e > 0.0 && e < 1.0),
            "{}: {:?}",
            p.name,
            p.transfer_error
        );
        let beaten = study
            .points
            .iter()
            .any(|q| q.update_ms < p.update_ms && q.transfer_error < p.transfer_error);
        assert!(!(p.on_front && beaten), "{}", p.name);
    }
    assert!(!study.front().is_empty());
    assert_eq!(
        std::fs::read_to_string(out.join("points.csv")).unwrap().lines().count() as u64,
        points + 1
    );
    assert!(out.join("summary.md").exists());

    // A front of its own makes the choice of the runs below independent of this machine's speed.
    let before = std::fs::read(&place).unwrap();
    let profile = Profile::read(&place).unwrap();
    assert!(!profile.steps.is_empty());
    let failing = ["tradeoff", "no/such/place", "--quick", "--profile", text(&place)];
    assert_eq!(kinlight(&failing).status.code(), Some(3));
    let composite = ["--error", "composite", "--profile", text(&place), "--out", text(&out)];
    let no_truth = kinlight(&[&sweep[..], &composite].concat());
    assert_eq!(no_truth.status.code(), Some(2));
    assert_eq!(std::fs::read(&place).unwrap(), before, "a failed run leaves the profile alone");
}

#[test]
fn budgets_choose_settings_and_name_them_in_the_timings() {
    let sequence = small_sequence(4);
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("profile.toml");
    // times far above what pictures of this size take: nothing is stepped down from
    let steps: [(&[&str], f64, f64); 2] = [
        (&["transfer.directions=16"], 20_000.0, 0.2),
        (&["transfer.directions=32", "transfer.samples=1"], 60_000.0, 0.1),
    ];
    profile(&steps).write(&place).unwrap();
    let out = folder.path().join("out");
    for (budget, directions, name) in
        [("30s", 16, "transfer.directions=16"), ("100s", 32, "transfer.samples=1\"")]
    {
        let args = ["replay", text(sequence.path()), "--budget", budget, "--profile", text(&place)];
        let result = kinlight_json(&[&args[..], &["--out", text(&out)]].concat());
        assert_eq!(result["budget"]["within"], 4);
        assert_eq!(result["budget"]["switches"].as_array().unwrap().len(), 0);
        let settings = std::fs::read_to_string(out.join("settings.toml")).unwrap();
        assert!(settings.contains(&format!("directions = {directions}")), "{budget}");
        let column = setting_column(&out);
        assert_eq!(column.len(), 4);
        assert!(column.iter().all(|s| s.trim() == name), "{column:?}");
    }
    let args =
        ["compare", text(sequence.path()), "--presets", "ours-fast-mobile", "--warm-up", "1"];
    let budget = ["--budget", "30s", "--profile", text(&place), "--out", text(&out)];
    let result = kinlight_json(&[&args[..], &budget].concat());
    assert_eq!(result["presets"][0]["preset"], "ours-fast-mobile");
    assert_eq!(result["presets"][1]["budget"]["started_with"], "transfer.directions=16");
    assert_eq!(setting_column(&out.join("ours-fast-mobile"))[0], "ours-fast-mobile");
}

#[test]
fn mistakes_with_budgets_are_named() {
    let cases: [(&[&str], &str); 6] = [
        (&["replay", "--budget", "33"], "unit"),
        (&["replay", "--budget", "0ms"], "above 0"),
        (&["replay", "--budget", "33ms", "--preset", "ours"], "--preset"),
        (&["replay", "--profile", "a.toml"], "--budget"),
        (&["replay", "--budget", "33ms", "--profile", "none.toml"], "none.toml"),
        (&["tradeoff", "--repeat", "0"], "repeat"),
    ];
    for (args, word) in cases {
        let out = kinlight(args);
        let stderr = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(2), "{args:?}: {stderr}");
        assert!(stderr.contains(word) && !stderr.contains("panicked"), "{args:?}: {stderr}");
    }
}
