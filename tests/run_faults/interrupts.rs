//! Ctrl-C, termination and hang-up.

use crate::common::process::{lines, on_this_machine};
use crate::common::text;
use crate::made::{Made, PROGRAM, QUICK, log_of, long};
use crate::whole::{frames_of_recording, frames_of_run, whole_files};
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

const SIGNALS: [(&str, i32); 2] = [("-INT", 2), ("-TERM", 15)];

/// A frame of these small recordings and what is written at the end.
const STOP: Duration = Duration::from_secs(2);

/// What is left of a job that was cut short, or came to its end by the signal.
fn left_behind(command: &str, out: &Path) -> usize {
    let (files, temporary) = whole_files(out);
    assert_eq!(temporary, 0, "{command}: every file is finished");
    let has = |name: &str| files.contains(&out.join(name));
    match command {
        "replay" | "stream" => {
            let end = ["mesh.ply", "environment.hdr", "timings.json", "summary.json", "run.json"];
            assert!(end.iter().all(|name| has(name)) && has("report.html"), "{files:?}");
            frames_of_run(out)
        }
        "compare" => {
            assert!(has("report.html") && has("ours-fast-mobile/timings.json"), "{files:?}");
            lines(&out.join("ours-fast-mobile/timings.csv")) - 1
        }
        _ => frames_of_recording(out),
    }
}

#[test]
fn an_interrupt_ends_what_writes_frame_by_frame_with_whole_files() {
    let made = Made::new(&long(400));
    for command in ["replay", "compare", "convert", "synth", "stream", "record"] {
        for (signal, number) in SIGNALS {
            let out = made.at(&format!("{command}{signal}"));
            let log = log_of(command, &out);
            let mut run = made.start(command, &out);
            run.until("some frames", || lines(&log) > 3);
            run.signal(signal);
            let ended = run.end();
            let bound = on_this_machine(STOP);
            assert!(ended.took < bound, "{command}: {:?} of {bound:?}", ended.took);
            ended.line("ending: what belongs to the end is written now (again: stop at once)");
            let frames = left_behind(command, &out);
            println!(
                "{command} {signal}: {} after {frames} frames, {:?}",
                ended.code(),
                ended.took
            );
            let json = ended.json();
            match command {
                // They end by it, as they are meant to.
                "stream" | "record" => {
                    ended.succeeded();
                    assert_eq!(json["frames"], frames);
                    continue;
                }
                "replay" => {
                    let summary = fs::read_to_string(out.join("summary.json")).unwrap();
                    assert!(summary.contains("\"interrupted\": true"), "{summary}");
                    assert_eq!(
                        (&json["interrupted"], &json["frames"]),
                        (&true.into(), &frames.into())
                    );
                    ended.line(&format!("kinlight: interrupted after {frames} frames"));
                }
                "compare" => {
                    assert_eq!(json["presets"][0]["summary"]["interrupted"], true, "{json}");
                    assert_eq!(json["presets"].as_array().unwrap().len(), 1, "{json}");
                    ended.line("kinlight: interrupted after 0 of 2 runs");
                }
                "convert" => assert_eq!(json["frames"], frames),
                _ => {
                    assert_eq!(json["error"]["kind"], "interrupted");
                    assert!(!out.join("synth.json").exists(), "it is not what was asked for");
                }
            }
            ended.ended_by(number);
            assert!(frames < 400, "{command}: {frames}");
        }
    }
}

#[test]
fn an_interrupted_study_goes_on_where_it_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let study = |out: &Path| {
        let mut command = Command::new(PROGRAM);
        command.args(["study", "light", "--scenes", "sphere", "--lights", "1", "--size", "64,48"]);
        command.args([
            "--samples",
            "2",
            "--frames",
            "6",
            "--warm-up",
            "1",
            "--presets",
            "ours-fast",
        ]);
        command.args(["--set", "volume.resolution=64", "--json", "--out", text(out)]);
        crate::common::process::start(command, folder.path(), "study")
    };
    let out = folder.path().join("cut");
    for (wanted, (signal, number)) in [1, 3].into_iter().zip(SIGNALS) {
        let mut run = study(&out);
        let log = out.join("runs.jsonl");
        run.until("finished runs", || lines(&log) >= wanted);
        run.signal(signal);
        let ended = run.end();
        ended.ended_by(number).line("kinlight: interrupted: finished runs are kept in");
        assert_eq!(ended.json()["error"]["kind"], "interrupted");
        let (files, temporary) = whole_files(&out);
        assert!(lines(&log) >= wanted && temporary == 0, "{files:?}");
        assert!(!out.join("study.json").exists());
    }
    let kept = lines(&out.join("runs.jsonl"));
    let ended = study(&out).end();
    let found = ended.succeeded().json();
    assert!(lines(&out.join("runs.jsonl")) > kept);
    let whole = study(&folder.path().join("whole")).end().succeeded().json();
    let errors = |json: &serde_json::Value| -> Vec<serde_json::Value> {
        json["runs"].as_array().unwrap().iter().map(|run| run["median_deg"].clone()).collect()
    };
    assert_eq!(errors(&found), errors(&whole));
}

#[test]
fn the_second_interrupt_ends_at_once() {
    let made = Made::new(&long(4));
    let out = made.at("out");
    let mut command = Command::new(PROGRAM);
    // Some minutes a frame.
    command.args(["synth", text(&out), "--scene", "room", "--samples", "4096"]);
    let mut run = made.run(command, "synth");
    run.until("the lists", || out.join("scene.toml").exists());
    run.signal("-INT");
    run.until_said("again: stop at once");
    run.signal("-INT");
    let ended = run.end();
    let bound = on_this_machine(Duration::from_secs(1));
    assert!(ended.took < bound, "{:?}", ended.took);
    assert!(!ended.stderr.contains("kinlight: interrupted"), "{}", ended.stderr);
    ended.ended_by(2);
    whole_files(&out);
}

#[test]
fn signals_that_are_to_be_ignored_are() {
    let made = Made::new(&long(60));
    let (sequence, out) = (made.sequence(), made.at("out"));
    let mut command = Command::new("sh");
    command.args(["-c", "trap '' HUP; exec \"$@\"", "sh", PROGRAM, "replay", text(&sequence)]);
    command.args(["--out", text(&out), "--json"]).args(QUICK);
    let mut run = made.run(command, "replay");
    run.until("some frames", || lines(&out.join("light.jsonl")) > 3);
    run.signal("-HUP");
    assert_eq!(run.end().succeeded().json()["frames"], 60);
    // Else it ends as the others do.
    let out = made.at("hung-up");
    let mut run = made.start("replay", &out);
    run.until("some frames", || lines(&out.join("light.jsonl")) > 3);
    run.signal("-HUP");
    run.end().ended_by(1);
    left_behind("replay", &out);
}

#[test]
fn a_script_ends_with_the_run_that_is_interrupted() {
    let made = Made::new(&long(400));
    let (sequence, out) = (made.sequence(), made.at("out"));
    let mut command = Command::new("bash");
    command.args(["-c", "\"$@\"; echo went on", "bash", PROGRAM, "replay", text(&sequence)]);
    command.args(["--out", text(&out)]).args(QUICK).process_group(0);
    let mut run = made.run(command, "script");
    run.until("some frames", || lines(&out.join("light.jsonl")) > 3);
    run.signal_group("-INT");
    let ended = run.end();
    assert!(!ended.stdout.contains("went on"), "{}", ended.stdout);
    left_behind("replay", &out);
}

/// Ctrl-C goes to all processes of a terminal.
#[test]
fn an_interrupt_in_a_terminal_leaves_the_video() {
    let made = Made::new(&long(400));
    let out = made.at("out");
    let ffmpeg = made.at("ffmpeg");
    let script = "#!/bin/sh\ncase \"$*\" in *-encoders*) echo ' V libx264 x'; exit 0;; esac\n\
                  for last; do :; done\ncat > \"$last\"\n";
    fs::write(&ffmpeg, script).unwrap();
    fs::set_permissions(&ffmpeg, fs::Permissions::from_mode(0o755)).unwrap();
    let path = format!("{}:{}", text(made.folder()), std::env::var("PATH").unwrap());
    let mut command = made.command("replay", &out);
    command.arg("--video").env("PATH", path).process_group(0);
    let mut run = made.run(command, "replay");
    run.until("some frames", || lines(&out.join("light.jsonl")) > 3);
    run.signal_group("-INT");
    run.end().ended_by(2);
    let video = fs::metadata(out.join("augmented.mp4")).expect("a video").len() as usize;
    assert_eq!(video, lines(&out.join("light.jsonl")) * 80 * 60 * 3, "raw, from this encoder");
}
