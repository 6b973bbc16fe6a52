//! `kinlight parity` on a small recording.
#![cfg(feature = "gpu")]

mod common;

use common::recording::small_demo;
use common::{kinlight, skipped, text};
use kinlight::gpu::{AdapterChoice, Gpu};
use serde_json::Value;

/// Whether there is a device; `KINLIGHT_REQUIRE_GPU=1` makes it a failure where there is none.
fn has_device() -> bool {
    match Gpu::open(&AdapterChoice::Best) {
        Ok(_) => true,
        Err(error) if std::env::var_os("KINLIGHT_REQUIRE_GPU").is_some() => {
            panic!("KINLIGHT_REQUIRE_GPU is set, and: {error}")
        }
        Err(error) => {
            skipped(&error.to_string());
            false
        }
    }
}

/// The report of a run over `frames` frames of 160x120 pixels into 64^3 voxels, and the exit code.
fn parity(frames: usize, more: &[&str]) -> (Value, Option<i32>) {
    let folder = tempfile::tempdir().unwrap();
    let (sequence, out) = (folder.path().join("sequence"), folder.path().join("out"));
    small_demo(frames).write(&sequence);
    let usual = ["parity", text(&sequence), "--set", "volume.resolution=64", "--json", "--out"];
    let output = kinlight(&[&usual[..], &[text(&out)], more].concat());
    let report: Value = serde_json::from_slice(&output.stdout).unwrap_or_else(|error| {
        panic!("{error}: {}", String::from_utf8_lossy(&output.stderr));
    });
    let written = std::fs::read_to_string(out.join("parity.json")).unwrap();
    assert_eq!(serde_json::from_str::<Value>(&written).unwrap(), report);
    (report, output.status.code())
}

fn rows(report: &Value) -> &Vec<Value> {
    report["stages"].as_array().unwrap()
}

#[test]
fn every_stage_and_the_run_are_within_tolerance() {
    if !has_device() {
        return;
    }
    let (report, code) = parity(5, &[]);
    assert_eq!(
        (report["frames"].as_u64(), &report["within"]),
        (Some(5), &true.into()),
        "{report:#}"
    );
    assert_eq!(code, Some(0));
    assert_eq!(report["stage_frames"], serde_json::json!([0, 2, 4]));
    let adapter = report["adapter"].as_str().unwrap();
    assert_eq!(adapter.contains("software"), report["software"].as_bool().unwrap(), "{adapter}");
    let stages: Vec<&str> =
        rows(&report).iter().map(|row| row["stage"].as_str().unwrap()).collect();
    for stage in [
        "input",
        "tracking",
        "fusion",
        "ray-cast",
        "dyngeo",
        "transfer",
        "light",
        "objects",
        "compositing",
    ] {
        assert!(stages.contains(&stage), "{stage}");
    }
    for row in rows(&report) {
        assert_eq!(row["verdict"], "within", "{row:#}");
        assert!(row["found"]["values"].as_u64().unwrap() > 0 && row["reason"] != "", "{row:#}");
    }
    assert_eq!(report["run"].as_array().unwrap().len(), 6);
}

#[test]
fn rays_are_compared_and_what_no_frame_shows_is_said() {
    if !has_device() {
        return;
    }
    let (report, code) = parity(1, &["--preset", "gr14", "--no-object"]);
    assert_eq!(code, Some(0), "{report:#}");
    let verdict = |quantity: &str| {
        let row = rows(&report).iter().find(|row| row["quantity"] == quantity);
        row.map(|row| row["verdict"].as_str().unwrap().to_owned())
    };
    assert_eq!(verdict("coefficients, traced").as_deref(), Some("within"));
    assert_eq!(verdict("coefficients"), None, "not of this preset");
    for absent in ["camera position", "picture", "transfer, traced"] {
        assert_eq!(verdict(absent).as_deref(), Some("not-compared"), "{absent}");
    }
}

#[test]
fn mistakes_have_their_exit_codes() {
    for (args, code) in [
        (["--adapter", "no such device"], 2),
        (["--preset", "no such preset"], 2),
        (["--stage-frames", "0"], 2),
    ] {
        let output = kinlight(&[&["parity"], &args[..]].concat());
        assert_eq!(output.status.code(), Some(code), "{args:?}");
    }
}
