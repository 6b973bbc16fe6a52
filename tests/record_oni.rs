//! `kinlight record` to `.oni` files, from the virtual sensor.
#![cfg(target_os = "linux")]

mod common;

use common::virtual_sensor::{Played, equipped, installed, scenario, with_sensor};
use common::{kinlight, text};
use kinlight::capture::openni::{OniOptions, OniSource};
use kinlight::capture::{CaptureOptions, FrameSource, RawFrame, open_sequence};
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

const SIZE: [usize; 2] = [64, 48];
const FRAMES: usize = 90;
/// In real time: the library's recorder starts on a thread of its own, and misses what comes before.
const USUAL: &str = "fov 1.0 0.8\nregistration yes\npace clock\n";

fn played() -> Played {
    Played::noise(SIZE, SIZE, FRAMES)
}

fn command(folder: &Path, args: &[&str]) -> Command {
    let program = Path::new(env!("CARGO_BIN_EXE_kinlight"));
    let mut command = with_sensor(program, folder);
    command.arg("record").args(args).arg("--json");
    command
}

fn result(output: &Output) -> Value {
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{}: {said}", output.status);
    serde_json::from_slice(&output.stdout).expect("one JSON value on standard output")
}

/// Every frame is one that was played, bit for bit, and they are in order.
fn assert_played(frames: &[RawFrame], played: &Played) {
    let mut next = 0;
    for frame in frames {
        let is = |(_, color): &(Vec<u16>, Vec<[u8; 3]>)| frame.color.as_slice() == color;
        let at = played.frames[next..].iter().position(is).expect("a later frame that was played");
        let depth = &played.frames[next + at].0;
        let depth_m: Vec<f32> = depth.iter().map(|&d| f32::from(d) / 1000.0).collect();
        assert_eq!(frame.depth_m.as_slice(), depth_m, "depth of frame {}", next + at);
        next += at + 1;
    }
}

/// As [`assert_played`], but depth and colour may be one frame apart, the same for all: OpenNI2 dates what it
/// records from each stream's first frame, and a clock's tick may fall between the starts of two streams.
fn assert_played_at_most_one_apart(frames: &[RawFrame], played: &Played) {
    let mut next = 0;
    let mut apart = Vec::new();
    for frame in frames {
        let color = |p: &(Vec<u16>, Vec<[u8; 3]>)| frame.color.as_slice() == p.1;
        let of_color = played.frames[next..].iter().position(color).expect("a later colour") + next;
        let stored: Vec<u16> =
            frame.depth_m.as_slice().iter().map(|m| (m * 1000.0).round() as u16).collect();
        let of_depth = played.frames.iter().position(|p| p.0 == stored).expect("depth as played");
        apart.push(of_depth as i64 - of_color as i64);
        next = of_color + 1;
    }
    assert!(apart.iter().all(|&a| a == apart[0] && a.abs() <= 1), "{apart:?}");
}

fn frames_of(source: &mut dyn FrameSource) -> Vec<RawFrame> {
    std::iter::from_fn(|| source.next_frame().unwrap()).collect()
}

/// Frames of a `.oni` file; depth and colour are paired again by its times.
fn frames_in(file: &Path) -> Vec<RawFrame> {
    frames_of(&mut OniSource::open(file, &OniOptions::default()).unwrap())
}

#[test]
fn a_name_that_ends_with_oni_is_a_file_of_openni2s() {
    scenario(
        "a_name_that_ends_with_oni_is_a_file_of_openni2s",
        |folder| played().write(folder, USUAL),
        |folder| {
            let file = folder.join("new/room.oni");
            let args = ["--frames", "45", "--out", text(&file)];
            let output = command(folder, &args).output().unwrap();
            let result = result(&output);
            assert_eq!((&result["frames"], &result["depth_loss"]), (&45.into(), &Value::Null));
            let oni = result["oni"].as_array().unwrap();
            assert_eq!((oni.len(), &oni[0]["file"]), (1, &text(&file).into()));
            let count = |key: &str| oni[0][key].as_u64().unwrap() as usize;
            assert!(count("depth_frames") > 5 && count("color_frames") > 5, "{oni:?}");
            let frames = frames_in(&file);
            assert!(frames.len() > 5, "{} frames", frames.len());
            assert_played(&frames, &played());
            assert!(!file.with_extension("").exists(), "no folder is made");
            // What is there is not overwritten.
            let before = std::fs::read(&file).unwrap();
            let output = command(folder, &args).output().unwrap();
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(5), "{said}");
            assert!(said.contains("is there already"), "{said}");
            assert!(std::fs::read(&file).unwrap() == before);
        },
    );
}

#[test]
fn a_folder_and_a_file_are_recorded_together() {
    scenario(
        "a_folder_and_a_file_are_recorded_together",
        |folder| played().write(folder, USUAL),
        |folder| {
            let (out, file) = (folder.join("out"), folder.join("room.ONI"));
            let args = ["--frames", "45", "--out", text(&out), "--oni", text(&file)];
            let result = result(&command(folder, &args).output().unwrap());
            assert_eq!(result["oni"][0]["file"], text(&file));
            let options = CaptureOptions::default();
            let folder_frames = frames_of(&mut open_sequence(&out, &options).unwrap());
            let dropped = result["dropped_writing"].as_u64().unwrap() as usize;
            assert_eq!(folder_frames.len() + dropped, 45);
            assert_played(&folder_frames, &played());
            let file_frames = frames_in(&file);
            assert!(file_frames.len() > 5, "{} frames", file_frames.len());
            assert_played(&file_frames, &played());
        },
    );
}

#[test]
fn a_sensor_that_comes_back_continues_in_another_file_and_all_are_named() {
    scenario(
        "a_sensor_that_comes_back_continues_in_another_file_and_all_are_named",
        |folder| played().write(folder, &format!("{USUAL}fault unplug 45 300\n")),
        |folder| {
            // Of an earlier recording: it stays.
            std::fs::write(folder.join("room-2.oni"), "another room").unwrap();
            let file = folder.join("room.oni");
            let args = ["--duration", "8s", "--stall", "700ms", "--out", text(&file)];
            let result = result(&command(folder, &args).output().unwrap());
            assert!(result["live"]["outages"].as_u64().unwrap() >= 1, "{result}");
            let files = result["oni"].as_array().unwrap();
            let names: Vec<_> = files.iter().map(|f| f["file"].as_str().unwrap()).collect();
            assert_eq!(names[..2], [text(&file), text(&folder.join("room-3.oni"))]);
            assert_eq!(std::fs::read(folder.join("room-2.oni")).unwrap(), b"another room");
            for name in &names[..2] {
                let frames = frames_in(Path::new(name));
                assert!(frames.len() > 5, "{name}: {} frames", frames.len());
                assert_played_at_most_one_apart(&frames, &played());
            }
        },
    );
}

#[test]
fn only_openni2s_sensors_are_recorded_to_its_files() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("room.oni");
    let device = ["record", "--device", "play:sequences/demo"];
    for (args, word) in [
        (vec!["--out", text(&file)], "only OpenNI2's sensors"),
        (vec!["--out", "x", "--oni", text(&file)], "only OpenNI2's sensors"),
        (vec!["--out", text(&file), "--oni", "y.oni"], "--oni goes with a folder"),
    ] {
        let output = kinlight(&[&device[..], &args].concat());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{args:?}: {said}");
        assert!(said.contains(word), "{args:?}: {said}");
    }
    assert!(!file.exists() && !Path::new(env!("CARGO_MANIFEST_DIR")).join("x").exists());
}

/// The folder is there for this: OpenNI2 writes the index of its file at the end.
#[test]
fn a_kill_leaves_the_folder_whole_and_the_file_without_its_index() {
    let Some(installed) = installed() else { return };
    let folder = equipped(installed);
    Played::noise(SIZE, SIZE, 300).write(folder.path(), USUAL);
    let (out, file) = (folder.path().join("out"), folder.path().join("room.oni"));
    let args = ["--out", text(&out), "--oni", text(&file)];
    let mut child = command(folder.path(), &args).stdout(Stdio::null()).spawn().unwrap();
    let list = out.join("associations.txt");
    let lines = || std::fs::read_to_string(&list).unwrap_or_default().lines().count();
    let started = Instant::now();
    while lines() < 20 {
        assert!(started.elapsed() < Duration::from_secs(120), "{} lines", lines());
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let frames = frames_of(&mut open_sequence(&out, &CaptureOptions::default()).unwrap());
    assert!(frames.len() >= 19, "{} frames", frames.len());
    assert_played(&frames, &Played::noise(SIZE, SIZE, 300));
    let program = Path::new(env!("CARGO_BIN_EXE_kinlight"));
    let info = with_sensor(program, folder.path()).args(["info", text(&file)]).output().unwrap();
    let said = String::from_utf8_lossy(&info.stderr).into_owned();
    assert_eq!(info.status.code(), Some(3), "{said}");
    // Killed before or after it had written what its streams are.
    let reasons = ["without its index", "how many frames it has"];
    assert!(reasons.iter().any(|reason| said.contains(reason)), "{said}");
}
