//! The light study on the smallest of pictures, and its command line.

mod common;

use common::{kinlight, text};
use kinlight::stop::Stop;
use kinlight::study::light::{self, LOG_FILE, LightPlan, LightStudy, REFERENCE, REFERENCE_ALONE};
use kinlight::study::{SequenceStore, StudyError};
use std::cell::RefCell;
use std::fs;
use std::path::Path;

fn tiny() -> LightPlan {
    LightPlan {
        scenes: vec!["sphere".into()],
        lights: vec![1],
        presets: vec!["ours-fast".into()],
        assignments: ["volume.resolution=64", "surface.auxiliary_resolution=64"]
            .map(String::from)
            .to_vec(),
        frames: 2,
        warm_up: 1,
        width: 64,
        height: 48,
        samples: 2,
        ..LightPlan::default()
    }
}

/// Runs a plan; also gives what was being done, without repetitions.
fn run(plan: &LightPlan, folder: &Path, out: &str) -> (LightStudy, Vec<String>) {
    let store = SequenceStore::new(folder.join("sequences"));
    let doing: RefCell<Vec<String>> = RefCell::default();
    let study =
        light::run(plan, "the test", &store, &folder.join(out), &Stop::default(), &|progress| {
            assert!((0.0..=1.0).contains(&progress.share) && progress.left_s >= 0.0);
            let mut doing = doing.borrow_mut();
            if doing.last().is_none_or(|last| last != progress.doing) {
                doing.push(progress.doing.to_owned());
            }
        });
    (study.unwrap(), doing.into_inner())
}

/// Times are of no two runs the same.
fn without_times(mut study: LightStudy) -> LightStudy {
    study.runs.iter_mut().for_each(|run| run.stage_ms.clear());
    study
}

#[test]
fn a_study_is_complete_repeatable_and_goes_on_where_it_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let (first, doing) = run(&tiny(), folder.path(), "a");
    assert_eq!(doing[..2], ["starting", "making light_sphere_1"]);

    let runs: Vec<_> = first.runs.iter().map(|r| (r.method.as_str(), r.sensor_noise)).collect();
    let expected =
        [("ours-fast", false), ("ours-fast", true), (REFERENCE, false), (REFERENCE_ALONE, false)];
    assert_eq!(runs, expected);
    assert_eq!(first.methods, ["ours-fast", REFERENCE, REFERENCE_ALONE]);
    for run in &first.runs {
        assert_eq!((run.scene.as_str(), run.light), ("sphere", 1));
        assert_eq!(run.frames.len() + run.invalid, 2, "{run:?}");
        assert_eq!(run.invalid, 0, "{run:?}");
        assert!(run.frames.iter().map(|f| f.frame).eq([1, 2]), "after the warm-up");
        let length: f64 = run.true_direction.iter().map(|v| v * v).sum();
        assert!((length - 1.0).abs() < 1e-9);
        let names = if run.method == "ours-fast" { 8 } else { 0 };
        assert_eq!(run.stage_ms.len(), names, "seven stages and Update");
        assert!(run.stage_ms.values().all(|&ms| ms >= 0.0));
    }
    assert_eq!((first.steps.len(), first.jitter.len()), (2, 2), "exact and sensed");
    for step in &first.steps {
        assert!(step.trace.iter().map(|t| t.frame).eq(1..47), "{step:?}");
        assert_eq!(step.switch_frame, 7);
        // Another lamp at the other side: the old light is far from the last.
        assert!(step.trace[0].distance > 0.3, "{step:?}");
    }
    assert!(first.jitter.iter().all(|j| j.frames == 2 && j.max_deg < 90.0));

    let (again, doing) = run(&tiny(), folder.path(), "b");
    assert!(!doing.iter().any(|d| d.starts_with("making")), "sequences are there");
    assert_eq!(without_times(again), without_times(first.clone()));

    // The last two results are lost, one of them in the middle of its line.
    let log = folder.path().join("a").join(LOG_FILE);
    let lines = fs::read_to_string(&log).unwrap();
    let kept: Vec<&str> = lines.lines().take(first.runs.len() + 2).collect();
    fs::write(&log, kept.join("\n") + "\n{\"key\":\"half a line").unwrap();
    let (resumed, doing) = run(&tiny(), folder.path(), "a");
    let jitter = ["exact", "Kinect"].map(|d| format!("ours-fast on light_sphere_still, {d} depth"));
    assert_eq!(doing, ["starting".to_owned(), jitter[0].clone(), jitter[1].clone()]);
    assert_eq!(resumed, first, "times too: they were kept");

    let (_, doing) = run(&tiny(), folder.path(), "a");
    assert_eq!(doing, ["starting"], "nothing is left to do");

    let other = LightPlan { assignments: vec!["light.huber=0".into()], steps: false, ..tiny() };
    let (_, doing) = run(&other, folder.path(), "a");
    assert!(doing.len() > 4, "other settings, other results: {doing:?}");
}

#[test]
fn files_hold_a_line_a_run_and_a_line_a_frame() {
    let folder = tempfile::tempdir().unwrap();
    let plan = LightPlan { steps: false, jitter: false, kinect: false, ..tiny() };
    let (study, _) = run(&plan, folder.path(), "a");
    assert!(study.steps.is_empty() && study.jitter.is_empty());
    assert!(study.runs.iter().all(|r| !r.sensor_noise));
    let out = folder.path().join("a");
    light::write(&study, &out).unwrap();
    let read = |name: &str| fs::read_to_string(out.join(name)).unwrap();
    let back: LightStudy = serde_json::from_str(&read("study.json")).unwrap();
    assert_eq!(back.runs.len(), study.runs.len());
    let runs = read("runs.csv");
    assert_eq!(runs.lines().count(), 1 + 3);
    assert!(runs.lines().nth(1).unwrap().starts_with("sphere,1,exact,ours-fast,"), "{runs}");
    assert!(runs.lines().nth(2).unwrap().ends_with(",2,0,,"), "no times: {runs}");
    let columns = |line: &str| line.split(',').count();
    assert!(runs.lines().all(|line| columns(line) == 11), "{runs}");
    let frames = read("frames.csv");
    assert_eq!(frames.lines().count(), 1 + 3 * 2);
    assert!(frames.lines().all(|line| columns(line) == 10), "{frames}");
    let summary = read("summary.md");
    assert!(summary.contains("| ours-fast") && summary.contains("### Worst runs"), "{summary}");
    assert!(!summary.contains("Lamp switched"), "what was left out has no table");
    let environment = image::open(out.join("environment_light1.png")).unwrap().into_rgb8();
    assert_eq!(environment.dimensions(), (512, 256));
    let brightest = environment.enumerate_pixels().max_by_key(|(_, _, p)| p.0[1]).unwrap();
    let [x, _, z] = study.runs[0].true_direction;
    // Row 0 looks up, and u = 1/2 along +x: the lamp is above, and 18 degrees wide.
    let elevation = 90.0 - f64::from(brightest.1) * 180.0 / 256.0;
    assert!((elevation - z.asin().to_degrees()).abs() < 15.0, "{brightest:?} {x}");
}

#[test]
fn a_folder_that_cannot_be_written_is_named_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    fs::write(&file, "in the way").unwrap();
    let store = SequenceStore::new(folder.path().join("sequences"));
    let error = light::run(&tiny(), "", &store, &file.join("out"), &Stop::default(), &|_| {
        panic!("no work")
    });
    let Err(StudyError::Output(error)) = error else { panic!("{error:?}") };
    assert!(error.to_string().contains("runs.jsonl"), "{error}");
}

#[test]
fn wrong_usage_has_its_exit_code_and_says_what_there_is() {
    let folder = tempfile::tempdir().unwrap();
    for (given, expected) in [
        (["--presets", "best"], "no preset is called 'best'"),
        (["--scenes", "moon"], "no scene is called 'moon'"),
        (["--lights", "4"], "there are lights 0 to 3"),
        (["--set", "light.strid=4"], "no setting is called 'strid'"),
    ] {
        let args = ["study", "light", "--out", text(folder.path()), given[0], given[1]];
        let output = kinlight(&args);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(message.contains(expected), "{message}");
    }
}
