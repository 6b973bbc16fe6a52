//! Broken recordings, objects, settings and disks: what is wrong is named, what is good is written,
//! and the exit code says which of the two it was.

mod common;

use common::recording::{Recording, demo_folder, small_demo};
use common::{kinlight, text};
use kinlight::image::Size;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Quick settings: the smallest volume that still holds the demo's table.
const QUICK: [&str; 5] = ["--preset", "ours-fast-mobile", "--warm-up", "1", "--json"];

/// A small recording on disk that a test damages, and a folder for results.
struct Made {
    folder: tempfile::TempDir,
}

/// What came of a run.
struct Run {
    code: Option<i32>,
    stderr: String,
    json: Value,
    out: PathBuf,
}

impl Made {
    fn new(recording: &Recording) -> Self {
        let made = Self { folder: tempfile::tempdir().unwrap() };
        recording.write(&made.sequence());
        made
    }

    fn demo() -> Self {
        Self::new(&small_demo(4))
    }

    fn sequence(&self) -> PathBuf {
        self.folder.path().join("sequence")
    }

    fn path(&self, name: &str) -> PathBuf {
        self.sequence().join(name)
    }

    fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        fs::write(self.path(name), content).unwrap();
    }

    fn edit(&self, name: &str, change: impl FnOnce(String) -> String) {
        let text = fs::read_to_string(self.path(name)).unwrap();
        self.write(name, change(text));
    }

    /// Keeps the first half of a file.
    fn cut(&self, name: &str) {
        let bytes = fs::read(self.path(name)).unwrap();
        self.write(name, &bytes[..bytes.len() / 2]);
    }

    fn replay(&self, extra: &[&str]) -> Run {
        self.replay_to(&self.folder.path().join("out"), extra)
    }

    fn replay_to(&self, out: &Path, extra: &[&str]) -> Run {
        let sequence = self.sequence();
        let args = [&["replay", text(&sequence), "--out", text(out)], &QUICK[..], extra].concat();
        let output = kinlight(&args);
        let stderr = String::from_utf8(output.stderr).expect("messages are UTF-8");
        assert!(!stderr.contains("panicked"), "{args:?}: {stderr}");
        let json = serde_json::from_slice(&output.stdout)
            .unwrap_or_else(|e| panic!("{args:?}: one JSON value is printed: {e}; {stderr}"));
        Run { code: output.status.code(), stderr, json, out: out.to_owned() }
    }
}

impl Run {
    /// The run went through; exactly `good` frames have whole results.
    fn succeeded_with(&self, good: &[usize]) -> &Self {
        assert_eq!(self.code, Some(0), "{}", self.stderr);
        assert_eq!(self.json["frames"], good.len());
        assert_eq!(whole_pictures(&self.out.join("frames")), good);
        assert_eq!(logged_frames(&self.out.join("light.jsonl")), good);
        for name in ["summary.json", "timings.json", "mesh.ply", "environment.hdr"] {
            assert!(fs::metadata(self.out.join(name)).unwrap().len() > 0, "{name}");
        }
        self
    }

    /// Frames in each tracking state.
    fn states(&self) -> &Value {
        &self.json["states"]
    }

    /// The run ended with this code, and both forms of the message hold all words.
    fn failed_with(&self, code: i32, kind: &str, words: &[&str]) {
        assert_eq!(self.code, Some(code), "{words:?}: {}", self.stderr);
        assert_eq!(self.json["error"]["kind"], kind);
        let message = self.json["error"]["message"].as_str().unwrap();
        for word in words {
            assert!(message.contains(word), "{word} is not in: {message}");
            assert!(self.stderr.contains(word), "{word} is not in: {}", self.stderr);
        }
    }

    fn says(&self, word: &str) {
        assert!(self.stderr.contains(word), "{word} is not in: {}", self.stderr);
    }
}

/// Numbers of the frames whose pictures are there; each must decode.
fn whole_pictures(folder: &Path) -> Vec<usize> {
    let mut found: Vec<usize> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| !path.file_name().unwrap().to_str().unwrap().starts_with('.'))
        .map(|path| {
            image::open(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
            path.file_stem().unwrap().to_str().unwrap().parse().unwrap()
        })
        .collect();
    found.sort_unstable();
    found
}

/// Frames of a log, each line of which must be JSON.
fn logged_frames(path: &Path) -> Vec<usize> {
    let log = fs::read_to_string(path).unwrap();
    assert!(log.is_empty() || log.ends_with('\n'), "the last line is whole");
    log.lines()
        .map(|line| {
            serde_json::from_str::<Value>(line).unwrap()["frame"].as_u64().unwrap() as usize
        })
        .collect()
}

/// No light in the log may hold anything but numbers: JSON shows NaN as null.
fn lights_are_finite(out: &Path) {
    for line in fs::read_to_string(out.join("light.jsonl")).unwrap().lines() {
        let record: Value = serde_json::from_str(line).unwrap();
        let coefficients =
            record["sh"].as_array().unwrap().iter().flat_map(|c| c.as_array().unwrap());
        assert!(coefficients.into_iter().all(Value::is_f64), "{line}");
        assert!(record["residual"].is_f64() && record["condition"].is_f64(), "{line}");
    }
}

/// File names of frame 2 of the demo.
const COLOR_2: &str = "rgb/1000.066667.png";
const DEPTH_2: &str = "depth/1000.066667.png";

#[test]
fn a_broken_picture_costs_its_frame_and_no_other() {
    type Break = fn(&Made);
    let cases: [(&str, Break, &[&str]); 8] = [
        ("missing", |m| fs::remove_file(m.path(COLOR_2)).unwrap(), &[COLOR_2]),
        ("missing depth", |m| fs::remove_file(m.path(DEPTH_2)).unwrap(), &[DEPTH_2]),
        ("truncated", |m| m.cut(COLOR_2), &[COLOR_2]),
        ("truncated depth", |m| m.cut(DEPTH_2), &[DEPTH_2]),
        ("empty depth", |m| m.write(DEPTH_2, ""), &[DEPTH_2]),
        (
            "other size",
            |m| {
                image::RgbImage::new(80, 60).save(m.path(COLOR_2)).unwrap();
            },
            &["colour picture is 80x60", "160x120"],
        ),
        (
            "other depth size",
            |m| {
                image::ImageBuffer::<image::Luma<u16>, _>::new(80, 60)
                    .save(m.path(DEPTH_2))
                    .unwrap()
            },
            &["depth picture is 80x60", "160x120"],
        ),
        (
            "8-bit depth",
            |m| image::GrayImage::new(160, 120).save(m.path(DEPTH_2)).unwrap(),
            &[DEPTH_2, "16-bit"],
        ),
    ];
    for (name, damage, words) in cases {
        let made = Made::demo();
        damage(&made);
        let run = made.replay(&[]);
        run.succeeded_with(&[0, 1, 3]);
        let skipped = run.json["skipped"].as_array().unwrap();
        assert_eq!(skipped.len(), 1, "{name}");
        assert_eq!((&skipped[0]["index"], &skipped[0]["name"]), (&2.into(), &COLOR_2.into()));
        run.says("frame 2");
        for word in words {
            assert!(skipped[0]["reason"].as_str().unwrap().contains(word), "{name}: {skipped:?}");
            run.says(word);
        }
    }
}

#[test]
fn a_recording_of_broken_pictures_is_an_error() {
    let made = Made::demo();
    for name in ["1000.000000", "1000.033333", "1000.066667", "1000.100000"] {
        made.cut(&format!("rgb/{name}.png"));
    }
    made.replay(&[]).failed_with(3, "sequence", &["none of 4 frames", "rgb/1000.000000.png"]);
}

#[test]
fn a_broken_pose_is_named_by_line_and_only_its_frame_is_lost() {
    for pose in ["nan 0 0 0 0 0 1", "0 0 0 0 0 0 0", "0 0 0 3 0 0 1", "0 inf 0 0 0 0 1"] {
        let made = Made::demo();
        // Line 1 is the head, so frame 2 is line 4.
        made.edit("groundtruth.txt", |text| {
            let line = text.lines().nth(3).unwrap();
            text.replace(line, &format!("1000.066667 {pose}"))
        });
        let run = made.replay(&["--poses", "recorded"]);
        run.succeeded_with(&[0, 1, 2, 3]);
        run.says("groundtruth.txt:4: not a rigid pose");
        // Between its neighbours, 67 ms apart, the pose is interpolated.
        assert_eq!(run.states(), &serde_json::json!({ "Init": 1, "Tracking": 3 }), "{pose}");
    }
    let made = Made::demo();
    made.edit("groundtruth.txt", |text| text.lines().take(2).collect::<Vec<_>>().join("\n"));
    let run = made.replay(&["--poses", "recorded"]);
    run.succeeded_with(&[0, 1, 2, 3]);
    run.says("3 of 4 frames have no recorded pose");
    run.says("frame 1");
    assert_eq!(run.states(), &serde_json::json!({ "Init": 1, "Lost": 3 }));
    let poses = fs::read_to_string(run.out.join("trajectory.txt")).unwrap();
    assert_eq!(poses.lines().filter(|l| !l.starts_with('#')).count(), 1, "{poses}");
    // What the camera saw comes back where nothing could be composed.
    let composed = image::open(run.out.join("frames/000002.png")).unwrap();
    assert_eq!(composed.into_rgb8(), image::open(made.path(COLOR_2)).unwrap().into_rgb8());

    let made = Made::demo();
    made.edit("groundtruth.txt", |text| text + "1000.2 1 2 3\n");
    made.replay(&[]).failed_with(3, "sequence", &["groundtruth.txt:6", "4 numbers"]);
}

#[test]
fn time_stamps_that_run_backwards_or_repeat_are_sorted_out() {
    let made = Made::demo();
    made.edit("rgb.txt", |text| {
        let mut lines: Vec<_> = text.lines().collect();
        lines.swap(2, 3);
        lines.join("\n")
    });
    let run = made.replay(&[]);
    run.succeeded_with(&[0, 1, 2, 3]);
    run.says("colour time stamps run backwards, first at rgb/1000.033333.png");
    let log = fs::read_to_string(run.out.join("light.jsonl")).unwrap();
    let times: Vec<f64> = log
        .lines()
        .map(|l| serde_json::from_str::<Value>(l).unwrap()["timestamp"].as_f64().unwrap())
        .collect();
    assert_eq!(times, [1000.0, 1000.033333, 1000.066667, 1000.1]);

    let made = Made::demo();
    made.edit("rgb.txt", |text| text.replace("1000.066667 rgb", "1000.033333 rgb"));
    let run = made.replay(&[]);
    run.succeeded_with(&[0, 1, 2]);
    run.says("1 colour pictures repeat the time stamp of another, first rgb/1000.066667.png");
}

#[test]
fn lists_may_have_any_line_ends_but_not_leave_the_folder() {
    let made = Made::demo();
    made.edit("rgb.txt", |text| text.replace('\n', "\r\n\r\n"));
    made.edit("depth.txt", |text| format!("\u{feff}\n\n{}", text.replace('\n', " \r\n")));
    let run = made.replay(&[]);
    run.succeeded_with(&[0, 1, 2, 3]);
    assert_eq!(run.json["skipped"], serde_json::json!([]));

    for (name, content, words) in [
        ("rgb.txt", "", ["rgb.txt", "the list is empty"]),
        ("depth.txt", "# nothing\r\n\r\n", ["depth.txt", "the list is empty"]),
        ("rgb.txt", "1000.0 rgb/1000.000000.png\n1000.1 ../x.png\n", ["rgb.txt:2", "\"../x.png\""]),
        ("depth.txt", "1000.0 /etc/passwd\n", ["depth.txt:1", "/etc/passwd"]),
        ("rgb.txt", "1000.0\n", ["rgb.txt:1", "timestamp file"]),
        ("rgb.txt", "soon rgb/1000.000000.png\n", ["rgb.txt:1", "\"soon\" is not a time stamp"]),
        ("rgb.txt", "1.0 rgb/1000.000000.png\n", ["sequence", "no pair"]),
        ("intrinsics.txt", "0 0 0 0 160 120 5000\n", ["intrinsics.txt", "focal"]),
    ] {
        let made = Made::demo();
        made.write(name, content);
        let run = made.replay(&[]);
        run.failed_with(3, "sequence", &words);
        assert!(!run.out.exists(), "nothing is written for a recording that does not open");
    }
    let made = Made::demo();
    fs::remove_file(made.path("rgb.txt")).unwrap();
    fs::remove_file(made.path("associations.txt")).unwrap();
    fs::remove_dir_all(made.path("depth")).unwrap();
    made.replay(&[]).failed_with(3, "sequence", &["no recording recognised"]);
}

#[test]
fn a_broken_truth_of_light_is_an_error_of_the_sequence() {
    let made = Made::demo();
    made.write("light.json", "{\"segments\": []}");
    made.replay(&[]).failed_with(3, "sequence", &["light.json", "no segments"]);
    made.write("light.json", "{\"segments\": [");
    made.replay(&[]).failed_with(3, "sequence", &["light.json", "line 1"]);
}

#[test]
fn broken_objects_are_named() {
    let made = Made::demo();
    let glb = fs::read(demo_folder().join("object.glb")).unwrap();
    let folder = made.folder.path();
    let write = |name: &str, bytes: &[u8]| {
        fs::write(folder.join(name), bytes).unwrap();
    };
    write("half.glb", &glb[..glb.len() / 2]);
    write("head.glb", &glb[..12]);
    write("empty.glb", b"");
    write("text.glb", b"this is no model");
    write("brace.gltf", b"{\"asset\": {\"version\": \"2.0\"}");
    fs::copy(made.path(COLOR_2), folder.join("picture.glb")).unwrap();
    let names = [
        "half.glb",
        "head.glb",
        "empty.glb",
        "text.glb",
        "brace.gltf",
        "picture.glb",
        "none.glb",
        ".",
    ];
    for name in names {
        let path = folder.join(name);
        let run = made.replay(&["--object", text(&path)]);
        run.failed_with(4, "object", &[text(&path)]);
        assert!(!run.out.exists(), "{name}");
    }
}

#[test]
fn mistakes_in_scene_files_are_named() {
    let object = "[[object]]\nfile = \"object.glb\"\n";
    let cases: [(String, &[&str]); 9] = [
        (format!("{object}at = [0, 0, 0]\ncolour = 3\n"), &["line 4", "colour"]),
        ("[[thing]]\nfile = \"object.glb\"\n".into(), &["thing"]),
        (object.into(), &["object 1", "`at`"]),
        (format!("{object}at = [0, 0]\n"), &["line 3"]),
        (format!("{object}at = [0, nan, 0]\n"), &["object 1", "`at`", "not finite"]),
        (format!("{object}at = [0, 0, 0]\nscale = -1\n"), &["object 1", "`scale`", "positive"]),
        (format!("{object}on = [80, 60, 0.5]\n"), &["object 1", "`on`", "0.5"]),
        (format!("{object}at = [0, 0, 0]\nup = [0, 0, 0]\n"), &["object 1", "`up`"]),
        ("[[object]]\nfile = \"gone.glb\"\nat = [0, 0, 0]\n".into(), &["gone.glb"]),
    ];
    let made = Made::demo();
    for (content, words) in cases {
        made.write("scene.toml", &content);
        let run = made.replay(&[]);
        let named = if words == ["gone.glb"] { "gone.glb" } else { "scene.toml" };
        run.failed_with(4, "object", &[words, &[named]].concat());
        made.replay(&["--no-object"]).succeeded_with(&[0, 1, 2, 3]);
        fs::remove_dir_all(&run.out).unwrap();
    }
}

#[test]
fn mistakes_in_settings_are_named() {
    let made = Made::demo();
    let file = made.folder.path().join("mine.toml");
    for (content, words) in [
        ("[transfer]\nband = 3\n", ["mine.toml", "band"]),
        ("[transfers]\nbands = 3\n", ["mine.toml", "transfers"]),
        ("[transfer]\nbands = \"many\"\n", ["mine.toml", "bands"]),
        ("[transfer\n", ["mine.toml", "line 1"]),
        ("[transfer]\nbands = 9\n", ["transfer.bands", "1 to 6"]),
        ("[volume]\nside_m = nan\n", ["volume.side_m", "above 0"]),
    ] {
        fs::write(&file, content).unwrap();
        made.replay(&["--settings", text(&file)]).failed_with(2, "usage", &words);
    }
    fs::remove_file(&file).unwrap();
    made.replay(&["--settings", text(&file)]).failed_with(2, "usage", &["mine.toml"]);
}

#[test]
fn without_any_depth_the_camera_pictures_come_back() {
    let recording = small_demo(3).without_depth();
    let made = Made::new(&recording);
    let run = made.replay(&[]);
    run.succeeded_with(&[0, 1, 2]);
    run.says("frame 0: camera");
    run.says("0.0 % of the pixels have depth");
    assert_eq!(run.json["tracked_share"], 0.0);
    assert_eq!(run.json["volume_bytes"], 0);
    lights_are_finite(&run.out);
    for (i, frame) in recording.frames.iter().enumerate() {
        let composed = image::open(run.out.join(format!("frames/{i:06}.png"))).unwrap();
        assert!(composed.into_rgb8().as_raw() == frame.color.as_slice().as_flattened());
    }
}

#[test]
fn a_run_that_stops_where_the_camera_is_lost_keeps_what_it_has() {
    let mut recording = small_demo(5);
    recording.frames[3].depth_m.fill(0.0);
    let made = Made::new(&recording);
    let run = made.replay(&["--set", "tracking.on_lost=stop"]);
    run.failed_with(1, "run", &["frame 3: the camera is lost", "tracking.on_lost"]);
    assert_eq!(whole_pictures(&run.out.join("frames")), [0, 1, 2]);
    assert_eq!(logged_frames(&run.out.join("light.jsonl")), [0, 1, 2]);
    let summary = fs::read_to_string(run.out.join("summary.json")).unwrap();
    let summary: Value = serde_json::from_str(&summary).unwrap();
    assert_eq!((&summary["frames"], &summary["tracked_share"]), (&3.into(), &1.0.into()));
    let mesh = fs::read(run.out.join("mesh.ply")).unwrap();
    assert!(mesh.starts_with(b"ply") && mesh.len() > 10_000, "{}", mesh.len());
    for name in ["timings.json", "environment.hdr"] {
        assert!(fs::metadata(run.out.join(name)).unwrap().len() > 0, "{name}");
    }
}

#[test]
fn black_and_saturated_pictures_keep_the_neutral_light() {
    for value in [0, 255] {
        let made = Made::new(&small_demo(3).with_color(value));
        let run = made.replay(&[]);
        run.succeeded_with(&[0, 1, 2]);
        assert_eq!(run.json["tracked_share"], 1.0, "depth is good");
        assert_eq!(run.json["light_error"], Value::Null);
        lights_are_finite(&run.out);
        let log = fs::read_to_string(run.out.join("light.jsonl")).unwrap();
        let lights: Vec<Value> = log.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
        assert!(lights.iter().all(|l| l["sh"] == lights[0]["sh"] && l["pixels"] == 0), "{log}");
    }
}

#[test]
fn one_frame_is_a_recording() {
    let made = Made::new(&small_demo(1));
    let run = made.replay(&[]);
    run.succeeded_with(&[0]);
    assert_eq!(run.states(), &serde_json::json!({ "Init": 1 }));
    assert_eq!(run.json["absolute_error"], Value::Null, "one pose has no trajectory error");
    lights_are_finite(&run.out);
}

#[test]
fn odd_and_tiny_pictures_run() {
    for (width, height) in [(67, 43), (3, 2), (1, 1), (160, 1), (1, 120)] {
        let made = Made::new(&small_demo(3).cropped(Size::new(width, height)));
        for extra in [&[][..], &["--poses", "recorded", "--set", "transfer.subsampling=1"]] {
            let run = made.replay(extra);
            run.succeeded_with(&[0, 1, 2]);
            lights_are_finite(&run.out);
            let picture = image::open(run.out.join("frames/000002.png")).unwrap();
            assert_eq!((picture.width(), picture.height()), (width as u32, height as u32));
        }
    }
}

#[test]
fn a_folder_that_cannot_be_written_is_an_error_of_the_output() {
    let made = Made::demo();
    // Permissions do not stop an administrator; a file in the way and a read-only file system do.
    let file = made.folder.path().join("file");
    fs::write(&file, "in the way").unwrap();
    for folder in [file.join("out"), file.clone(), PathBuf::from("/proc/kinlight-out")] {
        made.replay_to(&folder, &[]).failed_with(5, "output", &[text(&folder), "cannot write"]);
    }
    assert_eq!(fs::read_to_string(&file).unwrap(), "in the way");
    // A folder where a file is to be written.
    let out = made.folder.path().join("out");
    fs::create_dir_all(out.join("light.jsonl")).unwrap();
    made.replay(&[]).failed_with(5, "output", &["light.jsonl", "cannot write"]);
}

/// A file system of this size that goes away with the value.
struct SmallDisk(tempfile::TempDir);

impl SmallDisk {
    fn mount(kibibytes: usize) -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let size = format!("size={kibibytes}k");
        let mounted = Command::new("mount")
            .args(["-t", "tmpfs", "-o", &size, "tmpfs"])
            .arg(folder.path())
            .stderr(Stdio::null())
            .status()
            .is_ok_and(|status| status.success());
        mounted.then_some(Self(folder))
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(self.0.path()).status();
    }
}

#[test]
fn a_full_disk_ends_the_run_and_what_was_written_is_whole() {
    // Frames of 160x120 take some 40 KiB each: the disk is full after a few.
    let Some(disk) = SmallDisk::mount(160) else {
        common::skipped("no right to mount a small disk");
        return;
    };
    let made = Made::new(&small_demo(12));
    let out = disk.0.path().join("out");
    let run = made.replay_to(&out, &[]);
    run.failed_with(5, "output", &["no space left on the disk", text(&out)]);
    let pictures = whole_pictures(&out.join("frames"));
    let lights = logged_frames(&out.join("light.jsonl"));
    assert!(!pictures.is_empty() && pictures.len() < 12, "{pictures:?}");
    assert_eq!(pictures, (0..pictures.len()).collect::<Vec<_>>());
    // The frame that did not fit may have its picture, not yet its light.
    assert!(pictures.len() - lights.len() <= 1, "{pictures:?} {lights:?}");
    let leftovers = fs::read_dir(out.join("frames")).unwrap().count() - pictures.len();
    assert_eq!(leftovers, 0, "half a file is removed");
}

#[test]
fn a_killed_run_leaves_whole_files() {
    let made = Made::new(&small_demo(30));
    let (sequence, out) = (made.sequence(), made.folder.path().join("out"));
    let mut run = Command::new(env!("CARGO_BIN_EXE_kinlight"))
        .args(["replay", text(&sequence), "--out", text(&out), "--quiet"])
        .args(&QUICK[..2])
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let log = out.join("light.jsonl");
    let written = || fs::read_to_string(&log).map_or(0, |log| log.lines().count());
    let start = Instant::now();
    while written() < 5 {
        assert!(start.elapsed() < Duration::from_secs(60), "five frames take no minute");
        assert!(run.try_wait().unwrap().is_none(), "still running");
        std::thread::sleep(Duration::from_millis(1));
    }
    run.kill().unwrap();
    assert!(!run.wait().unwrap().success());

    let lights = logged_frames(&log);
    assert!((5..30).contains(&lights.len()), "killed in the middle: {lights:?}");
    assert_eq!(lights, (0..lights.len()).collect::<Vec<_>>());
    let pictures = whole_pictures(&out.join("frames"));
    assert_eq!(pictures, (0..pictures.len()).collect::<Vec<_>>());
    // Pictures come first, so at most one light is missing.
    assert!((0..=1).contains(&(pictures.len() - lights.len())), "{pictures:?} {lights:?}");
    let poses = fs::read_to_string(out.join("trajectory.txt")).unwrap();
    assert!(poses.ends_with('\n'));
    let numbers = |line: &str| line.split(' ').filter(|n| n.parse::<f64>().is_ok()).count();
    assert!(poses.lines().filter(|l| !l.starts_with('#')).all(|l| numbers(l) == 8), "{poses}");
    let settings = fs::read_to_string(out.join("settings.toml")).unwrap();
    assert!(toml::from_str::<kinlight::config::Settings>(&settings).is_ok());

    // The same folder serves the next run.
    let all: Vec<usize> = (0..30).collect();
    made.replay(&[]).succeeded_with(&all);
}
