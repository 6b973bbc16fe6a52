//! `kinlight stream`, `record` and `convert`, on recordings that play as cameras.

mod common;

use common::recording::{Recording, looped, small_demo};
use common::{kinlight, kinlight_json, text};
use kinlight::capture::writer::{ColorFormat, DepthFormat, FrameRef, TumOptions, TumWriter};
use kinlight::capture::{CaptureOptions, FrameSource, RawFrame, open_sequence};
use kinlight::image::Size;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

struct Made {
    folder: TempDir,
}

impl Made {
    fn new(recording: &Recording) -> Self {
        let made = Self { folder: tempfile::tempdir().unwrap() };
        recording.write(&made.sequence());
        made
    }

    fn sequence(&self) -> PathBuf {
        self.at("sequence")
    }

    fn device(&self) -> String {
        format!("play:{}", self.sequence().display())
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}

fn frames_of(folder: &Path) -> Vec<RawFrame> {
    let mut source = open_sequence(folder, &CaptureOptions::default()).unwrap();
    assert!(source.info().warnings.is_empty(), "{:?}", source.info().warnings);
    let frames = std::iter::from_fn(|| source.next_frame().unwrap()).collect();
    assert_eq!(source.skipped(), []);
    frames
}

fn assert_equal(read: &RawFrame, expected: &RawFrame) {
    assert_eq!(read.timestamp_s, expected.timestamp_s);
    assert!(read.color == expected.color, "colour at {} s", read.timestamp_s);
    assert!(read.depth_m == expected.depth_m, "depth at {} s", read.timestamp_s);
}

#[test]
fn a_stream_of_every_frame_is_the_replay_bit_for_bit_even_where_the_device_is_lost() {
    let made = Made::new(&small_demo(6));
    let (replayed, sequence, device) = (made.at("replayed"), made.sequence(), made.device());
    let common = ["--preset", "ours-fast", "--backend", "cpu"];
    let replay = ["replay", text(&sequence), "--out", text(&replayed)];
    kinlight_json(&[&replay[..], &common].concat());
    for (name, losses) in [("streamed", None), ("lost", Some("2,4"))] {
        let out = made.at(name);
        let stream = ["stream", "--device", &device, "--every-frame", "--out", text(&out)];
        let lose = losses.map(|frames| ["--lose-device-at", frames]);
        let lose = lose.as_ref().map_or(&[][..], |args| &args[..]);
        let result = kinlight_json(&[&stream[..], &common, lose].concat());
        assert_eq!((&result["frames"], &result["live"]["dropped"]), (&6.into(), &0.into()));
        let outages = if losses.is_some() { 2 } else { 0 };
        assert_eq!(result["live"]["outages"], outages);
        assert_eq!(result["live"]["recoveries"], outages);
        for file in ["light.jsonl", "trajectory.txt", "mesh.ply", "environment.hdr"] {
            let read = |folder: &Path| std::fs::read(folder.join(file)).unwrap();
            assert!(read(&replayed) == read(&out), "{name}: {file} differs");
        }
        assert!(out.join("report.html").exists() && !out.join("frames").exists());
        let timings = std::fs::read_to_string(out.join("timings.csv")).unwrap();
        let column = |line: &str| line.rsplit(',').nth(1).unwrap().to_owned();
        let mut ages = timings.lines().map(column);
        assert_eq!(ages.next().as_deref(), Some("age_ms"));
        assert_eq!(ages.filter(|age| age.parse::<f64>().unwrap() >= 0.0).count(), 6);
        assert!(result["timings"]["age"]["median_ms"].is_number());
    }
}

#[test]
fn what_is_recorded_is_what_was_played() {
    let made = Made::new(&small_demo(8));
    let out = made.at("recorded");
    let device = made.device();
    let record = ["record", "--device", &device, "--every-frame", "--out", text(&out)];
    let result = kinlight_json(&record);
    assert_eq!((&result["frames"], &result["dropped_writing"]), (&8.into(), &0.into()));
    assert_eq!(result["depth_loss"]["rounded"], 0);
    let (read, expected) = (frames_of(&out), frames_of(&made.sequence()));
    assert_eq!(read.len(), 8);
    read.iter().zip(&expected).for_each(|(read, expected)| assert_equal(read, expected));
    let info = kinlight_json(&["info", text(&out)]);
    assert!(info.to_string().contains("calibration.toml"), "{info}");

    let few = made.at("few");
    let limited = ["record", "--device", &device, "--every-frame", "--frames", "3"];
    let result = kinlight_json(&[&limited[..], &["--out", text(&few)]].concat());
    assert_eq!(result["frames"], 3);
}

#[test]
fn convert_keeps_frames_and_poses_and_counts_what_it_rounds() {
    let made = Made::new(&small_demo(6));
    let (sequence, out) = (made.sequence(), made.at("out"));
    let convert = ["convert", text(&sequence), text(&out), "--to", "tum", "--frames", "1..5"];
    let result = kinlight_json(&convert);
    assert_eq!((&result["frames"], &result["poses"]), (&4.into(), &4.into()));
    assert_eq!(
        (&result["depth_loss"]["rounded"], &result["depth_loss"]["beyond"]),
        (&0.into(), &0.into())
    );
    let (read, expected) = (frames_of(&out), frames_of(&sequence));
    assert_eq!(read.len(), 4);
    for (read, expected) in read.iter().zip(&expected[1..]) {
        assert_equal(read, expected);
        let (read, expected) =
            (read.world_from_camera.unwrap(), expected.world_from_camera.unwrap());
        // eight decimals
        assert!((read.translation.vector - expected.translation.vector).amax() <= 1e-8);
        assert!(read.rotation.angle_to(&expected.rotation) < 1e-7);
    }

    // depth of the demo is in fifths of a millimetre
    let coarse = made.at("coarse");
    let result =
        kinlight_json(&["convert", text(&sequence), text(&coarse), "--depth-steps", "1000"]);
    assert!(result["depth_loss"]["rounded"].as_u64().unwrap() > 1000, "{result}");
    let most_m = result["depth_loss"]["most_m"].as_f64().unwrap();
    // two fifths, and what f32 adds below 8 m
    assert!((most_m - 4e-4).abs() < 1e-6, "{most_m}");
    for (read, expected) in frames_of(&coarse).iter().zip(&expected) {
        let pairs = read.depth_m.as_slice().iter().zip(expected.depth_m.as_slice());
        let worst = pairs.map(|(a, b)| (a - b).abs()).fold(0.0f32, f32::max);
        assert!(worst < 5e-4, "{worst}");
    }
}

#[test]
fn millimetres_stay_exact_at_5000_steps_a_metre() {
    let made = tempfile::tempdir().unwrap();
    let (sequence, out) = (made.path().join("mm"), made.path().join("out"));
    let mut recording = small_demo(2);
    let options = TumOptions {
        camera: recording.camera,
        color: ColorFormat::Png,
        depth: DepthFormat { steps_per_m: 1000.0, ..DepthFormat::default() },
        calibration: Some(("mm".into(), String::new())),
    };
    let mut writer = TumWriter::start(&sequence, &options).unwrap();
    for (f, frame) in recording.frames.iter_mut().enumerate() {
        let mm = (0..).map(|i| ((i * 7 + f) % 13_107) as f32 / 1000.0);
        frame.depth_m.as_mut_slice().iter_mut().zip(mm).for_each(|(d, mm)| *d = mm);
        writer
            .push(&FrameRef {
                timestamp_s: frame.timestamp_s,
                color: &frame.color,
                depth_m: &frame.depth_m,
                second_depth_m: None,
                world_from_camera: None,
            })
            .unwrap();
    }
    writer.finish().unwrap();
    let result = kinlight_json(&["convert", text(&sequence), text(&out)]);
    assert_eq!(result["depth_loss"]["rounded"], 0);
    let read = frames_of(&out);
    assert_eq!(read.len(), 2);
    read.iter().zip(&recording.frames).for_each(|(read, expected)| assert_equal(read, expected));
}

#[test]
fn mistakes_have_their_exit_codes_and_name_what_is_wrong() {
    let made = Made::new(&small_demo(1));
    let (device, sequence) = (made.device(), made.sequence());
    let cases: [(&[&str], i32, &str); 7] = [
        (&["stream", "--device", "kinect:7"], 2, "kinect:7"),
        (&["stream", "--device", &device, "--duration", "5"], 2, "unit"),
        (&["stream", "--device", "play:no/such/place"], 6, "no/such/place"),
        (&["record", "--device", "play:no/such/place", "--out", "x"], 6, "no/such/place"),
        (&["record", "--device", &device, "--out", "/dev/null/out"], 5, "/dev/null/out"),
        (&["record", "--device", &device, "--out", text(&sequence)], 5, "holds a recording"),
        (&["convert", "no/such/place", "x"], 3, "no/such/place"),
    ];
    for (args, code, word) in cases {
        let out = kinlight(args);
        let stderr = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(code), "{args:?}: {stderr}");
        assert!(stderr.contains(word) && !stderr.contains("panicked"), "{args:?}: {stderr}");
    }
}

/// Signals and limits of processes.
#[cfg(unix)]
mod ended_from_outside {
    use super::*;
    use crate::common::process::{self, Running, lines};
    use std::process::Command;
    use std::time::{Duration, Instant};

    const SMALL: Size = Size::new(80, 60);

    fn start(made: &Made, args: &[&str]) -> Running {
        let mut command = Command::new(env!("CARGO_BIN_EXE_kinlight"));
        command.args(args);
        process::start(command, made.folder.path(), "run")
    }

    /// Every line of a list, with the pictures that it names.
    fn listed(folder: &Path, list: &str) -> Vec<String> {
        let text = std::fs::read_to_string(folder.join(list)).unwrap();
        assert!(text.ends_with('\n'), "{list} ends within a line");
        let lines: Vec<_> =
            text.lines().filter(|l| !l.starts_with('#')).map(str::to_owned).collect();
        for line in &lines {
            for file in line.split(' ').filter(|word| word.contains('/')) {
                let picture = image::open(folder.join(file));
                assert!(picture.is_ok(), "{list} names {file}: {picture:?}");
            }
        }
        lines
    }

    /// Frames of `out`, each whole and as it was played; every list names them.
    fn assert_whole(out: &Path, played: &[RawFrame]) -> Vec<RawFrame> {
        let read = frames_of(out);
        for list in ["associations.txt", "rgb.txt", "depth.txt"] {
            let lines = listed(out, list);
            // A kill between the lines of one frame leaves it in the first lists alone.
            let more = lines.len() - read.len();
            assert!(more <= usize::from(list != "associations.txt"), "{list}: {more} more");
        }
        for frame in &read {
            let same = played.iter().find(|p| p.timestamp_s == frame.timestamp_s);
            assert_equal(frame, same.expect("a frame that was played"));
        }
        read
    }

    #[test]
    fn a_killed_recording_holds_all_but_the_last_second() {
        let made = Made::new(&looped(400, SMALL));
        let (device, out) = (made.device(), made.at("out"));
        let mut run = start(&made, &["record", "--device", &device, "--out", text(&out)]);
        let list = out.join("associations.txt");
        run.until("the first frame", || lines(&list) > 0);
        let first_written = Instant::now();
        std::thread::sleep(Duration::from_millis(2500));
        let before_kill = first_written.elapsed().as_secs_f64();
        let listed_before = lines(&list);
        run.signal("-KILL");
        run.end();

        let played = frames_of(&made.sequence());
        let read = assert_whole(&out, &played);
        assert!(read.len() >= listed_before && read.len() < played.len(), "{}", read.len());
        // The device plays in real time and was at its first frame when that was found written, or later: all
        // that it gave until a second before the kill was due when `before_kill - 1` had passed.
        let recorded_s = read[read.len() - 1].timestamp_s - played[0].timestamp_s;
        assert!(recorded_s >= before_kill - 1.0, "{recorded_s} s of {before_kill} s");
        let replayed = made.at("replayed");
        let args = ["--frames", "0..1", "--no-object", "--preset", "ours-fast"];
        let replay = ["replay", text(&out), "--backend", "cpu", "--out", text(&replayed)];
        assert_eq!(kinlight_json(&[&replay[..], &args].concat())["frames"], 1);
    }

    /// Killed at any point of its work, with a device that loses nothing: what is there is the beginning of what
    /// was played, without a gap.
    #[test]
    fn a_killed_recording_is_whole_up_to_its_last_frame() {
        let made = Made::new(&looped(2000, SMALL));
        let played = frames_of(&made.sequence());
        for kill_at in [1, 7, 60, 150] {
            let (device, out) = (made.device(), made.at(&format!("out{kill_at}")));
            let record = ["record", "--device", &device, "--every-frame", "--out", text(&out)];
            let mut run = start(&made, &record);
            let list = out.join("associations.txt");
            run.until("these frames", || lines(&list) >= kill_at);
            run.signal("-KILL");
            run.end();
            let read = assert_whole(&out, &played);
            assert!(read.len() >= kill_at, "{} of {kill_at}", read.len());
            assert!(read.len() < played.len(), "it had come to its end");
            let times =
                |frames: &[RawFrame]| frames.iter().map(|f| f.timestamp_s).collect::<Vec<_>>();
            assert_eq!(times(&read), times(&played[..read.len()]));
        }
    }

    #[test]
    fn an_interrupt_ends_a_stream_within_two_seconds_with_all_its_files() {
        let made = Made::new(&looped(900, SMALL));
        for name in ["-INT", "-TERM"] {
            let (device, out) = (made.device(), made.at(name));
            let stream = ["stream", "--device", &device, "--out", text(&out)];
            let compute = ["--preset", "ours-fast", "--no-object", "--backend", "cpu"];
            let mut run = start(&made, &[&stream[..], &compute].concat());
            run.until("three frames", || lines(&out.join("light.jsonl")) >= 3);
            run.signal(name);
            let ended = run.end();
            let took = ended.succeeded().took;
            // The frame in work and what is computed at the end take a few frames' time.
            let timings = std::fs::read(out.join("timings.json")).unwrap();
            let timings: serde_json::Value = serde_json::from_slice(&timings).unwrap();
            let frame_s = timings["duration"]["max_ms"].as_f64().unwrap() / 1e3;
            assert!(
                took.as_secs_f64() < 2.0 + 4.0 * frame_s,
                "{name}: {took:?}, {frame_s} s a frame"
            );
            println!("{name}: ended after {took:?}, {frame_s:.3} s a frame");
            let summary = std::fs::read(out.join("summary.json")).unwrap();
            let summary: serde_json::Value = serde_json::from_slice(&summary).unwrap();
            let frames = summary["frames"].as_u64().unwrap() as usize;
            assert_eq!(frames, lines(&out.join("light.jsonl")));
            let live = |key: &str| summary["live"][key].as_u64().unwrap() as usize;
            let waiting = live("captured") - live("delivered") - live("dropped");
            assert!(live("delivered") == frames && waiting <= 2, "{summary}");
            for file in ["mesh.ply", "environment.hdr", "timings.json", "report.html", "run.json"] {
                assert!(out.join(file).exists(), "{file}");
            }
        }
    }

    /// The limit stands for a disk that fills up: it cuts a line of a list, too.
    #[test]
    fn where_nothing_more_can_be_written_what_is_written_stays() {
        let made = Made::new(&looped(200, Size::new(8, 6)));
        let (device, out) = (made.device(), made.at("out"));
        let limited = "ulimit -f 4; exec \"$@\"";
        let output = Command::new("bash")
            .args(["-c", limited, "bash", env!("CARGO_BIN_EXE_kinlight")])
            .args(["record", "--device", &device, "--every-frame", "--out", text(&out)])
            .output()
            .expect("there is a bash");
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(5), "{stderr}");
        assert!(stderr.contains(".txt") && stderr.contains("too large"), "{stderr}");
        let (read, played) = (frames_of(&out), frames_of(&made.sequence()));
        assert!(read.len() > 20 && read.len() < 200, "{} frames", read.len());
        read.iter().zip(&played).for_each(|(read, played)| assert_equal(read, played));
    }
}
