//! A stream that drops frames against replays of what the same sensor gives.

use crate::common::process::lines;
use crate::common::text;
use crate::rig::{Does, FRAMES, Rig};
use crate::table::publish;
use kinlight::math::{Pose, pose_from_xyzw};
use nalgebra::Vector3;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// At every pixel: too slow for a sensor's pace on the machines that tests run on, so that frames are dropped.
const COMPUTE: [&str; 6] =
    ["--preset", "ours", "--backend", "cpu", "--set", "transfer.directions=64"];

struct Run {
    folder: PathBuf,
    frames: Vec<Frame>,
}

/// By time: the camera where it is tracked, and direction to the light, in world axes.
struct Frame {
    time: String,
    world_from_camera: Option<Pose>,
    towards_light: [f64; 3],
}

impl Frame {
    /// In the axes of another frame's camera: the world of a run is that of its first.
    fn seen_from(&self, other: &Self) -> Option<(Pose, Vector3<f64>)> {
        let other = other.world_from_camera?;
        let towards = other.rotation.inverse() * Vector3::from(self.towards_light);
        Some((other.inv_mul(&self.world_from_camera?), towards))
    }
}

impl Run {
    fn read(folder: PathBuf) -> Self {
        let light = fs::read_to_string(folder.join("light.jsonl")).unwrap();
        let path = fs::read_to_string(folder.join("trajectory.txt")).unwrap();
        let poses: Vec<Vec<&str>> = path.lines().map(|line| line.split(' ').collect()).collect();
        let frame = |line: &str| {
            let light: Value = serde_json::from_str(line).unwrap();
            let time = format!("{:.6}", light["timestamp"].as_f64().unwrap());
            let pose = poses.iter().find(|words| words[0] == time);
            let towards = light["dominant_direction"].clone();
            Frame {
                world_from_camera: pose.map(|words| {
                    let number = |i: usize| words[i].parse().unwrap();
                    pose_from_xyzw([1, 2, 3].map(number), [4, 5, 6, 7].map(number)).unwrap()
                }),
                towards_light: serde_json::from_value(towards).unwrap(),
                time,
            }
        };
        let frames = light.lines().map(frame).collect();
        Self { folder, frames }
    }

    fn file(&self, name: &str) -> Vec<u8> {
        fs::read(self.folder.join(name)).unwrap()
    }
}

/// The pairs of a TUM recording at these times, as a recording of its own.
fn only(recording: &Path, times: &[String], out: &Path) {
    fs::create_dir_all(out).unwrap();
    for folder in ["rgb", "depth"] {
        std::os::unix::fs::symlink(recording.join(folder), out.join(folder)).unwrap();
    }
    for name in ["intrinsics.txt", "calibration.toml"] {
        fs::copy(recording.join(name), out.join(name)).unwrap();
    }
    for name in ["rgb.txt", "depth.txt", "associations.txt"] {
        let list = fs::read_to_string(recording.join(name)).unwrap();
        let wanted = |line: &&str| {
            line.starts_with('#') || times.iter().any(|t| line.split(' ').next() == Some(t))
        };
        let kept: Vec<&str> = list.lines().filter(wanted).collect();
        assert_eq!(kept.len(), times.len() + 1, "{name}: all of them were recorded");
        fs::write(out.join(name), kept.join("\n") + "\n").unwrap();
    }
}

#[test]
fn a_paced_stream_is_the_replay_of_the_frames_it_took() {
    let Some(paced) = Rig::new(Does::Stream, "pace clock") else { return };
    let streamed = paced.at("streamed");
    let stream = ["stream", "--device", "openni", "--no-object", "--out", text(&streamed)];
    let mut run = paced.run(&[&stream[..], &COMPUTE].concat(), "stream");
    run.until("the last frame", || paced.happened("frame", FRAMES - 1));
    run.signal("-INT");
    run.end().succeeded();
    let streamed = Run::read(streamed);

    let whole = Rig::new(Does::Record, "pace read").expect("as before");
    let frames = FRAMES.to_string();
    whole.start(&["--every-frame", "--frames", &frames]).end().succeeded();
    assert_eq!(whole.written(), FRAMES);
    let replay = |recording: &Path, name: &str| {
        let out = whole.at(name);
        let args =
            ["replay", text(recording), "--no-object", "--follow-links", "--out", text(&out)];
        whole
            .run(&[&args[..], &["--without", "frames"], &COMPUTE].concat(), name)
            .end()
            .succeeded();
        Run::read(out)
    };
    let times: Vec<String> = streamed.frames.iter().map(|f| f.time.clone()).collect();
    only(&whole.out(), &times, &whole.at("taken"));
    let same = replay(&whole.at("taken"), "same");
    for name in ["light.jsonl", "trajectory.txt", "mesh.ply", "environment.hdr"] {
        assert!(streamed.file(name) == same.file(name), "{name} differs");
    }

    let all = replay(&whole.out(), "all");
    assert_eq!(lines(&whole.at("all/light.jsonl")), FRAMES);
    let (mut apart_mm, mut turned_deg) = (Vec::new(), Vec::new());
    let other = |frame: &Frame| all.frames.iter().find(|f| f.time == frame.time).expect("all");
    let first = &streamed.frames[0];
    for frame in &streamed.frames {
        let (here, there) = (frame.seen_from(first), other(frame).seen_from(other(first)));
        if let (Some((here, lit)), Some((there, also_lit))) = (here, there) {
            apart_mm.push((here.translation.vector - there.translation.vector).norm() * 1e3);
            turned_deg.push(lit.angle(&also_lit).to_degrees());
        }
    }
    let spread = |values: &[f64]| {
        let median = kinlight::math::median(values.iter().copied()).expect("frames");
        format!("{median:.2} (median), {:.2} (worst)", values.iter().copied().fold(0.0, f64::max))
    };
    publish(&format!(
        "A stream at the sensor's pace took {} of {FRAMES} frames. Light, path, mesh and environment are bit for bit \
         those of a replay of exactly these. Against a replay of all {FRAMES}, at the same times: the camera {} mm \
         apart, the light {} degrees.\n",
        times.len(),
        spread(&apart_mm),
        spread(&turned_deg),
    ));
    assert!(!apart_mm.is_empty());
}
