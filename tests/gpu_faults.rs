//! Devices that vanish, are too small or are not there, through the program itself.
//!
//! Needs a graphics device, Mesa's software one will do; says SKIPPED without one, and fails instead where
//! `KINLIGHT_REQUIRE_GPU` is set.

mod common;

use common::recording::{Recording, small_demo};
use common::{skipped, text};
use kinlight::image::{Image, Size};
use serde_json::{Value, json};
use std::fs;
use std::path::PathBuf;
use std::process::Command;
use std::sync::OnceLock;

const FRAMES: usize = 60;

struct Run {
    code: Option<i32>,
    /// What the program logged, without what drivers print by themselves.
    lines: Vec<String>,
    json: Value,
    out: PathBuf,
}

impl Run {
    fn warnings(&self) -> Vec<&str> {
        let loud = |l: &&String| ["[WARN", "[ERROR"].iter().any(|level| l.starts_with(level));
        self.lines.iter().filter(loud).map(String::as_str).collect()
    }

    fn succeeded(&self) -> &Self {
        assert_eq!(self.code, Some(0), "{:?}", self.lines);
        self
    }

    /// One message with these words.
    fn failed_with(&self, code: i32, words: &[&str]) {
        assert_eq!(self.code, Some(code), "{:?}", self.lines);
        let message = self.json["error"]["message"].as_str().expect("a message");
        println!("exit {code}: {message}");
        words.iter().for_each(|word| assert!(message.contains(word), "{word} is not in {message}"));
        assert_eq!(self.warnings(), [""; 0]);
    }

    /// Went through with one warning, which has these words.
    fn warned(&self, words: &[&str]) {
        self.succeeded();
        let warnings = self.warnings();
        println!("{warnings:#?}");
        let [warning] = warnings[..] else { panic!("one warning: {warnings:?}") };
        words.iter().for_each(|word| assert!(warning.contains(word), "{word} is not in {warning}"));
    }

    fn lines_of(&self, name: &str) -> Vec<String> {
        let text = fs::read_to_string(self.out.join(name)).expect("it was written");
        text.lines().filter(|line| !line.starts_with('#')).map(str::to_owned).collect()
    }

    fn has_every_frame(&self, frames: usize) -> &Self {
        self.succeeded();
        assert_eq!(self.json["frames"], frames);
        assert_eq!(self.json["states"].get("Lost"), None, "{}", self.json["states"]);
        let pictures = fs::read_dir(self.out.join("frames")).expect("pictures").map(|entry| {
            image::open(entry.expect("a picture").path()).expect("a whole picture");
        });
        assert_eq!(pictures.count(), frames);
        assert_eq!(self.lines_of("light.jsonl").len(), frames);
        assert_eq!(self.lines_of("trajectory.txt").len(), frames);
        // a surface is one that was seen twice
        let mesh = fs::metadata(self.out.join("mesh.ply")).expect("a mesh").len();
        assert!(frames < 2 || mesh > 10_000, "{mesh} bytes");
        self
    }

    /// `run.json`.
    fn record(&self) -> Value {
        let text = fs::read(self.out.join("run.json")).expect("it was written");
        serde_json::from_slice(&text).expect("JSON")
    }

    /// As the record has it.
    fn backend(&self) -> String {
        self.record()["machine"]["backend"].as_str().expect("a name").to_owned()
    }

    /// Camera positions, metres.
    fn positions(&self) -> Vec<[f64; 3]> {
        let parsed = |line: &String| {
            let numbers: Vec<f64> =
                line.split(' ').skip(1).take(3).map(|n| n.parse().expect("a number")).collect();
            numbers.try_into().expect("three")
        };
        self.lines_of("trajectory.txt").iter().map(parsed).collect()
    }
}

fn kinlight(environment: &[(&str, &str)], args: &[&str]) -> std::process::Output {
    Command::new(env!("CARGO_BIN_EXE_kinlight"))
        .args(args)
        .arg("--json")
        .envs(environment.iter().copied())
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("the program starts")
}

/// Name of the device that `--backend gpu` takes; `None`, said out loud, without one.
fn device() -> Option<&'static str> {
    static NAME: OnceLock<Option<String>> = OnceLock::new();
    let name = NAME.get_or_init(|| {
        let found = kinlight(&[], &["doctor"]);
        let found: Value = serde_json::from_slice(&found.stdout).expect("a report");
        let name = found["adapters"][0]["name"].as_str().map(str::to_owned);
        if name.is_none() {
            assert!(std::env::var_os("KINLIGHT_REQUIRE_GPU").is_none(), "there is no device");
            skipped("there is no graphics device");
        }
        name
    });
    name.as_deref()
}

/// A recording on disk, and a folder for results.
struct Made(tempfile::TempDir);

impl Made {
    fn of(recording: &Recording) -> Self {
        let made = Self(tempfile::tempdir().expect("a folder"));
        recording.write(&made.0.path().join("sequence"));
        made
    }

    fn replay(&self, name: &str, args: &[&str]) -> Run {
        self.replay_in(&[], name, args)
    }

    fn replay_in(&self, environment: &[(&str, &str)], name: &str, args: &[&str]) -> Run {
        let (sequence, out) = (self.0.path().join("sequence"), self.0.path().join(name));
        let common = [
            "replay",
            text(&sequence),
            "--out",
            text(&out),
            "--preset",
            "ours-fast-mobile",
            "--set",
            "volume.resolution=64",
            "--without",
            "environment,report",
            // software devices are slow
            "--set",
            "surface.top=false",
            "--set",
            "transfer.directions=16",
            "--set",
            "bounce.enabled=false",
        ];
        let output = kinlight(environment, &[&common, args].concat());
        let stderr = String::from_utf8(output.stderr).expect("messages are UTF-8");
        assert!(!stderr.contains("panicked"), "{stderr}");
        let json = serde_json::from_slice(&output.stdout)
            .unwrap_or_else(|e| panic!("{args:?}: one JSON value is printed: {e}; {stderr}"));
        let of_program = |l: &&str| ["[", "kinlight:"].iter().any(|start| l.starts_with(start));
        let lines = stderr.lines().filter(of_program).map(str::to_owned).collect();
        Run { code: output.status.code(), lines, json, out }
    }
}

/// The largest distance between two paths over these frames, metres.
fn apart(a: &Run, b: &Run, frames: std::ops::Range<usize>) -> f64 {
    let (a, b) = (a.positions(), b.positions());
    let distance = |i: usize| {
        let squares = a[i].iter().zip(b[i]).map(|(a, b)| (a - b).powi(2));
        squares.sum::<f64>().sqrt()
    };
    frames.map(distance).fold(0.0, f64::max)
}

/// The driver gives the device back once: the first loss goes on there, the next one on the CPU.
#[test]
fn a_run_of_60_frames_outlives_two_losses_of_its_device() {
    if device().is_none() {
        return;
    }
    let made = Made::of(&small_demo(FRAMES));
    let whole = made.replay("whole", &["--backend", "gpu"]);
    whole.has_every_frame(FRAMES);
    assert_eq!(whole.warnings(), [""; 0], "a run without faults has nothing to warn of");
    assert_eq!(whole.backend(), "gpu");

    let cases = [("20,40", FRAMES, 40), ("20,20", 30, 20)];
    for (losses, frames, on_cpu_from) in cases {
        let range = format!("0..{frames}");
        let args = ["--backend", "gpu", "--frames", &range, "--lose-gpu-at", losses];
        let cut = made.replay(losses, &args);
        cut.has_every_frame(frames);
        let warnings = cut.warnings();
        println!("{warnings:#?}");
        let cpu_frame = format!("frame {on_cpu_from}: ");
        let says = [
            ["frame 20: ", "the device was lost", "opened anew", "a new map"],
            [&cpu_frame, "the device was lost", "the CPU backend", "a new map"],
        ];
        assert_eq!(warnings.len(), says.len(), "one line a loss: {warnings:?}");
        for (warning, words) in warnings.iter().zip(says) {
            words.iter().for_each(|w| assert!(warning.contains(w), "{w} is not in {warning}"));
        }
        let history = format!("gpu, gpu opened anew from frame 20, cpu from frame {on_cpu_from}");
        assert_eq!(cut.backend(), history);
        let handovers = cut.json["backend"]["handovers"].as_array().expect("a list");
        let to: Vec<_> = handovers.iter().map(|h| (&h["frame"], &h["to"])).collect();
        assert_eq!(to, [(&json!(20), &json!("gpu")), (&json!(on_cpu_from), &json!("cpu"))]);

        let before = apart(&whole, &cut, 0..20);
        let after = apart(&whole, &cut, 20..frames);
        println!("{losses}: {before:e} m apart before, {after:e} m after; {}", cut.json["states"]);
        let ate = |run: &Run| run.json["absolute_error"]["translation_m"]["rmse"].as_f64();
        println!("ATE {:?} m, {:?} m uninterrupted", ate(&cut), ate(&whole));
        assert!(before < 1e-6, "nothing is different before: {before} m");
        assert!(after < MOST_APART_M, "{after} m");
    }
}

/// Two thirds of a voxel; 9 mm were measured, where each new map starts from one frame. The camera moves up to
/// 9 mm from frame to frame.
const MOST_APART_M: f64 = 0.02;

#[test]
fn a_device_that_is_lost_before_its_first_frame_is_an_error_where_it_was_asked_for() {
    if device().is_none() {
        return;
    }
    let made = Made::of(&small_demo(2));
    // in the first frame there is nothing yet that could go on
    let cut = made.replay("cut", &["--backend", "gpu", "--lose-gpu-at", "0"]);
    cut.failed_with(1, &["the device was lost"]);
}

/// Where the driver libraries are asked for devices, they find no driver.
const NO_DRIVER: [(&str, &str); 3] = [
    ("VK_DRIVER_FILES", "/dev/null"),
    ("VK_ICD_FILENAMES", "/dev/null"),
    ("WGPU_BACKEND", "vulkan"),
];

#[test]
fn without_a_driver_the_cpu_computes_unless_the_gpu_was_asked_for() {
    let made = Made::of(&small_demo(2));
    for args in [&["--backend", "gpu"][..], &["--adapter", "any"]] {
        made.replay_in(&NO_DRIVER, "none", args).failed_with(2, &["mesa-vulkan-drivers"]);
    }
    let auto = made.replay_in(&NO_DRIVER, "auto", &["--backend", "auto"]);
    auto.has_every_frame(2);
    assert_eq!((auto.backend(), auto.warnings()), ("cpu".to_owned(), vec![]));
    assert_eq!(auto.record()["on_cpu_because"], "no adapter was found");
    let told = made.replay_in(&NO_DRIVER, "told", &["--backend", "auto", "-v"]);
    assert!(told.lines.iter().any(|l| l.contains("on the CPU: no adapter was found")));
}

#[test]
fn an_unknown_adapter_is_answered_with_those_there_are() {
    let Some(name) = device() else { return };
    let made = Made::of(&small_demo(2));
    for backend in ["auto", "gpu"] {
        let args = ["--backend", backend, "--adapter", "no such device"];
        made.replay("unknown", &args).failed_with(2, &["no such device", name]);
    }
}

/// One frame of 3 million pixels: a binding of 128 MiB, which is what WebGPU promises, holds 48 bytes
/// for each of 2.8 million.
fn large_picture() -> Recording {
    let mut recording = small_demo(1);
    let (size, scale) = (Size::new(2000, 1500), 12.5);
    recording.camera = kinlight::math::Pinhole {
        width: size.width,
        height: size.height,
        fx: recording.camera.fx * scale,
        fy: recording.camera.fy * scale,
        cx: recording.camera.cx * scale,
        cy: recording.camera.cy * scale,
    };
    let frame = &mut recording.frames[0];
    frame.color = enlarged(&frame.color, size);
    frame.depth_m = enlarged(&frame.depth_m, size);
    recording
}

fn enlarged<T: Copy>(image: &Image<T>, size: Size) -> Image<T> {
    let from = image.size();
    let nearest = |i: usize| {
        let (x, y) =
            (i % size.width * from.width / size.width, i / size.width * from.height / size.height);
        image[(x, y)]
    };
    Image::from_vec(size, (0..size.pixels()).map(nearest).collect())
}

#[test]
fn a_picture_that_is_too_large_is_an_error_or_is_left_to_the_cpu() {
    let Some(name) = device() else { return };
    let made = Made::of(&large_picture());
    let words = ["out of GPU memory: shading needs 137.3 MiB", name, "binds 128.0 MiB at most"];
    made.replay("gpu", &["--backend", "gpu"]).failed_with(1, &words);
    let auto = made.replay("auto", &["--adapter", name]);
    auto.has_every_frame(1).warned(&[&words[..], &["going on with the CPU backend"]].concat());
    assert_eq!(auto.backend(), "cpu");
}

/// The volume is made in the first frame, which shows where it has to be.
#[test]
fn a_volume_that_is_too_large_is_an_error_or_is_left_to_the_cpu() {
    let Some(name) = device() else { return };
    let made = Made::of(&small_demo(2));
    let args = ["--gpu-memory", "16", "--set", "volume.resolution=256"];
    let words = ["out of GPU memory: voxels needs", "of 16.0 MiB are taken"];
    made.replay("gpu", &[&args[..], &["--backend", "gpu"]].concat()).failed_with(1, &words);
    let auto = made.replay("auto", &[&args[..], &["--adapter", name]].concat());
    let says = [&words[..], &["frame 0: ", "going on with the CPU backend"]].concat();
    auto.has_every_frame(2).warned(&says);
    assert_eq!(auto.backend(), "gpu, cpu from frame 0");
}

/// A thick band around surfaces needs more blocks than the device keeps; the CPU has room.
#[test]
fn a_volume_that_fills_up_goes_on_to_the_cpu_with_its_map() {
    if device().is_none() {
        return;
    }
    let made = Made::of(&small_demo(3));
    let run = made.replay(
        "full",
        &["--backend", "gpu", "--set", "volume.resolution=512", "--set", "volume.truncation_m=0.8"],
    );
    run.has_every_frame(3).warned(&["the volume is full", "the CPU backend, with the same map"]);
    println!("{}", run.backend());
}
