//! What a run on a graphics device writes: intermediate buffers, its record, and frames within a budget.
//!
//! Needs a graphics device, Mesa's software one will do; says SKIPPED without one, and fails instead where
//! `KINLIGHT_REQUIRE_GPU` is set.
#![cfg(feature = "gpu")]

mod common;

use common::recording::small_demo;
use common::{kinlight, kinlight_json, skipped, text};
use kinlight::gpu::{AdapterChoice, Gpu};
use std::path::Path;

const BUFFERS: [&str; 7] =
    ["sensor-depth", "model-depth", "depth", "normals", "origin", "shading", "virtual-shading"];

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

/// Share of the bytes of two pictures that are more than 4 codes apart.
fn apart(a: &Path, b: &Path) -> f64 {
    let [a, b] = [a, b].map(|path| image::open(path).expect("a picture").to_rgb8().into_raw());
    assert_eq!(a.len(), b.len());
    a.iter().zip(&b).filter(|(a, b)| a.abs_diff(**b) > 4).count() as f64 / a.len() as f64
}

#[test]
fn dumped_buffers_look_as_those_of_the_cpu_and_are_no_part_of_the_traffic() {
    if !has_device() {
        return;
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    small_demo(3).write(folder.path());
    let out = |backend: &str| folder.path().join("out").join(backend);
    let dump = BUFFERS.join(",");
    let mut results = Vec::new();
    for (backend, more) in
        [("cpu", &["--dump", &dump][..]), ("gpu", &["--dump", &dump]), ("gpu", &[])]
    {
        let out = out(backend);
        let args = ["replay", text(folder.path()), "--backend", backend, "--out", text(&out)];
        results.push(kinlight_json(
            &[&args[..], &["--preset", "ours-fast-mobile", "--without", "mesh"], more].concat(),
        ));
    }
    for buffer in BUFFERS {
        for frame in 0..3 {
            let picture = |backend: &str| out(backend).join(buffer).join(format!("{frame:06}.png"));
            let apart = apart(&picture("cpu"), &picture("gpu"));
            assert!(apart < 0.01, "{buffer} of frame {frame}: {apart}");
        }
    }
    let traffic = |i: usize| results[i]["backend"]["traffic"].clone();
    assert_eq!(traffic(1), traffic(2), "dumps are counted");
    assert!(traffic(1)["waits"].as_f64().expect("a number") > 2.0);
    assert!(results[1]["backend"]["volume_bytes"].as_u64().expect("a number") > 1 << 20);
}

#[test]
fn a_budget_changes_settings_on_the_device() {
    if !has_device() {
        return;
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    small_demo(8).write(folder.path());
    let profile = folder.path().join("profile-gpu.toml");
    let step = |name: &str, change: &str, update_ms: f64, error: f64| {
        format!(
            "[[steps]]\nname = \"{name}\"\npreset = \"ours-fast-mobile\"\nchanges = [\"{change}\", \
             \"surface.warm_up_updates=0\"]\nupdate_ms = {update_ms}\nerror = {error}\n\
             [steps.stage_ms]\nSurface = {update_ms}\n"
        )
    };
    let header = "error = \"transfer\"\nsequences = [\"a\"]\n[machine]\ncpu = \"a\"\nthreads = 1\n\
                  system = \"linux\"\nbackend = \"gpu\"\nversion = \"0\"\n";
    // a promise that nothing here keeps: the faster settings are taken as soon as that shows
    let steps = [
        step("fast", "transfer.subsampling=8", 0.001, 0.2),
        step("slow", "transfer.subsampling=4", 0.0011, 0.1),
    ];
    std::fs::write(&profile, format!("{header}{}", steps.concat())).expect("a profile");
    let out = folder.path().join("out");
    let args = ["replay", text(folder.path()), "--backend", "gpu", "--out", text(&out)];
    let budget = ["--budget", "0.002ms", "--profile", text(&profile), "--without", "mesh"];
    let result = kinlight_json(&[&args[..], &budget].concat());
    assert_eq!(result["backend"]["name"], "gpu", "{result}");
    let switches = result["budget"]["switches"].as_array().expect("a list");
    assert_eq!((&switches[0]["from"], &switches[0]["to"]), (&"slow".into(), &"fast".into()));
    assert_eq!(result["frames"], 8);
}

#[test]
fn a_budget_without_a_profile_of_the_device_says_what_is_taken() {
    if !has_device() {
        return;
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    small_demo(1).write(folder.path());
    let out = folder.path().join("out");
    let args = ["replay", text(folder.path()), "--backend", "gpu", "--out", text(&out)];
    let output = kinlight(&[&args[..], &["--budget", "10s", "--without", "mesh"]].concat());
    let log = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{log}");
    let here = std::env::var_os("HOME").map(|home| {
        let config = std::env::var_os("XDG_CONFIG_HOME")
            .map_or(Path::new(&home).join(".config"), Into::into);
        config.join("kinlight/profile-gpu.toml")
    });
    if here.is_none_or(|path| !path.exists()) {
        assert!(log.contains("no profile of the gpu backend"), "{log}");
    }
}
