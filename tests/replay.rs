//! `kinlight replay` and `compare` on the shipped demo.

mod common;

use common::{kinlight, kinlight_json, text};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

fn files(dir: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut all = BTreeMap::new();
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            all.extend(files(&path));
        } else {
            all.insert(path.display().to_string(), fs::read(&path).unwrap());
        }
    }
    all
}

#[test]
fn the_demo_gives_every_output() {
    let dir = tempfile::tempdir().unwrap();
    let result = kinlight_json(&[
        "replay",
        "--preset",
        "ours-fast",
        "--frames",
        "0..8",
        "--out",
        text(dir.path()),
    ]);
    assert_eq!(result["frames"], 8);
    assert_eq!(result["tracked_share"], 1.0);
    let frames = fs::read_dir(dir.path().join("frames")).unwrap().count();
    assert_eq!(frames, 8);

    let light = fs::read_to_string(dir.path().join("light.jsonl")).unwrap();
    for (i, line) in light.lines().enumerate() {
        let record: serde_json::Value = serde_json::from_str(line).unwrap();
        assert_eq!(record["frame"], i);
        let direction: Vec<f64> =
            serde_json::from_value(record["dominant_direction"].clone()).unwrap();
        let length = direction.iter().map(|v| v * v).sum::<f64>().sqrt();
        assert!((length - 1.0).abs() < 1e-5, "{direction:?}");
    }
    assert_eq!(light.lines().count(), 8);

    let trajectory = fs::read_to_string(dir.path().join("trajectory.txt")).unwrap();
    let poses = trajectory.lines().filter(|l| !l.starts_with('#'));
    assert!(poses.clone().all(|l| l.split(' ').count() == 8));
    assert_eq!(poses.count(), 8);

    assert!(fs::read(dir.path().join("mesh.ply")).unwrap().starts_with(b"ply"));
    assert!(fs::read(dir.path().join("environment.hdr")).unwrap().starts_with(b"#?RADIANCE"));
    for name in ["timings.csv", "timings.json", "settings.toml"] {
        assert!(dir.path().join(name).metadata().unwrap().len() > 0, "{name}");
    }
    let leftovers = files(dir.path()).into_keys().filter(|n| n.ends_with(".tmp")).count();
    assert_eq!(leftovers, 0, "temporary files are renamed");
}

#[test]
fn the_written_settings_and_any_number_of_threads_give_the_same_result() {
    let run = |dir: &Path, extra: &[&str]| {
        let args =
            ["replay", "--frames", "0..4", "--without", "timings,report", "--out", text(dir)];
        kinlight_json(&[&args, extra].concat());
        let strip = format!("{}/", text(dir));
        files(dir)
            .into_iter()
            .map(|(k, v)| (k.replacen(&strip, "", 1), v))
            // memory and command differ
            .filter(|(name, _)| !["summary.json", "run.json"].contains(&name.as_str()))
            .collect::<BTreeMap<_, _>>()
    };
    let (a, b) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let preset = ["--preset", "ours-fast", "--set", "transfer.directions=16", "--threads", "1"];
    let first = run(a.path(), &preset);
    let settings = a.path().join("settings.toml");
    let second = run(b.path(), &["--settings", text(&settings), "--threads", "3"]);
    assert_eq!(first.keys().collect::<Vec<_>>(), second.keys().collect::<Vec<_>>());
    for (name, bytes) in &first {
        assert!(second[name] == *bytes, "{name} differs");
    }
}

#[test]
fn without_a_virtual_object_the_camera_image_comes_back_bit_for_bit() {
    for preset in ["ours", "ours-fast"] {
        let dir = tempfile::tempdir().unwrap();
        kinlight_json(&[
            "replay",
            "--preset",
            preset,
            "--no-object",
            "--frames",
            "0..3",
            "--out",
            text(dir.path()),
        ]);
        let options = kinlight::capture::CaptureOptions::default();
        let demo = Path::new(env!("CARGO_MANIFEST_DIR")).join("sequences/demo");
        let mut source = kinlight::capture::open_sequence(&demo, &options).unwrap();
        for index in 0..3 {
            use kinlight::capture::FrameSource;
            let camera = source.next_frame().unwrap().unwrap().color;
            let path = dir.path().join(format!("frames/{index:06}.png"));
            let composed = image::open(path).unwrap().into_rgb8();
            assert!(
                composed.as_raw() == camera.as_slice().as_flattened(),
                "{preset} frame {index}"
            );
        }
    }
}

#[test]
fn compare_prints_both_presets_and_their_ratio() {
    let dir = tempfile::tempdir().unwrap();
    let out = kinlight(&[
        "compare",
        "--presets",
        "ours,ours-fast",
        "--frames",
        "0..4",
        "--warm-up",
        "1",
        "--out",
        text(dir.path()),
    ]);
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let table = String::from_utf8(out.stdout).unwrap();
    for row in [
        "FPS",
        "Update",
        "Input",
        "Reconstruct",
        "Surface",
        "DynGeo",
        "RadTransfer",
        "LightEst",
        "Rendering",
    ] {
        assert!(table.contains(row), "{row} missing in:\n{table}");
    }
}

#[test]
fn mistakes_have_their_exit_codes_and_name_what_is_wrong() {
    let cases: [(&[&str], i32, &str); 7] = [
        (&["replay", "no/such/place"], 3, "no/such/place"),
        (&["replay", "--preset", "best"], 2, "best"),
        (&["replay", "--set", "transfer.bands=9"], 2, "transfer.bands"),
        (&["replay", "--set", "transfer.band=3"], 2, "band"),
        (&["replay", "--object", "no.glb"], 4, "no.glb"),
        (&["replay", "--frames", "5..2"], 2, "5..2"),
        (&["replay", "--frames", "0..1", "--out", "/dev/null/out"], 5, "/dev/null/out"),
    ];
    for (args, code, word) in cases {
        let out = kinlight(args);
        let stderr = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(code), "{args:?}: {stderr}");
        assert!(stderr.contains(word), "{args:?}: {stderr}");
        assert!(!stderr.contains("panicked"), "{stderr}");
    }
}
