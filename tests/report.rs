//! `kinlight report` over folders of results.

mod common;
#[path = "../src/report/fixtures.rs"]
mod fixtures;

use common::{kinlight, kinlight_json, skipped, text};
use image::{Rgb, RgbImage};
use kinlight::{math, output, study, timing, tracking};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

fn write(path: PathBuf, content: impl AsRef<[u8]>) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, content).unwrap();
}

fn write_json(path: PathBuf, record: &impl serde::Serialize) {
    write(path, serde_json::to_vec(record).unwrap());
}

/// Noise over a slope, so that compression has something to do, with a dark spot as a "shadow".
fn picture(width: u32, height: u32, seed: u32, shadow: f64) -> RgbImage {
    let mut rng = math::random::Rng::new(&[seed]);
    RgbImage::from_fn(width, height, |x, y| {
        let (u, v) = (f64::from(x) / f64::from(width), f64::from(y) / f64::from(height));
        let spot = (-((u - 0.55).powi(2) + (v - 0.6).powi(2)) * 60.0).exp();
        let noise = 8.0 * f64::from(rng.uniform());
        let level = (90.0 + 110.0 * u * (1.0 - 0.5 * v)) * (1.0 - shadow * spot) + noise;
        Rgb([level, 0.9 * level, 0.75 * level].map(|c| c as u8))
    })
}

fn save(path: PathBuf, picture: &RgbImage) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    picture.save(path).unwrap();
}

/// Results of everything, in `folder`.
fn write_results(folder: &Path) {
    write_json(folder.join("study/light/study.json"), &fixtures::light_study());
    for light in 0..4 {
        let map = picture(512, 256, light, 0.3);
        save(folder.join(format!("study/light/environment_light{light}.png")), &map);
    }
    write_json(folder.join("study/composite/study.json"), &fixtures::composite_study());
    for case in ["desk diffuse", "room coloured"] {
        let shown = [("input", 0.0), ("truth", 0.6), ("ours", 0.5), ("ours-fast", 0.4)];
        for (name, shadow) in shown {
            let path = folder.join(format!("study/composite/pictures/{case}/000009-{name}.png"));
            save(path, &picture(640, 480, 9, shadow));
        }
    }
    write_json(folder.join("study/tradeoff/study.json"), &fixtures::tradeoff());
    for (i, (name, stages_ms)) in fixtures::STAGES_MS.into_iter().enumerate() {
        let run = folder.join(name);
        write_json(run.join("timings.json"), &fixtures::timings(stages_ms));
        let settings = kinlight::config::Settings::preset("ours").unwrap();
        write(run.join("settings.toml"), settings.to_toml());
        for frame in 0..4 {
            let path = run.join(format!("frames/{frame:06}.png"));
            save(path, &picture(640, 480, frame, 0.2 * i as f64));
        }
    }
}

#[test]
fn a_folder_of_everything_becomes_one_small_page() {
    let folder = tempfile::tempdir().unwrap();
    // to look at, or to drive in a browser: tests/browser/report.mjs
    let keep = std::env::var_os("KINLIGHT_KEEP_REPORT").map(PathBuf::from);
    let folder = keep.as_deref().unwrap_or(folder.path());
    write_results(folder);
    let out = folder.join("report.html");
    let result = kinlight_json(&["report", text(folder), "--out", text(&out)]);
    assert_eq!(result["runs"], serde_json::json!(["gr12", "ours", "ours-fast"]));
    assert_eq!((&result["light_studies"], &result["missing"]), (&1.into(), &serde_json::json!([])));
    let page = fs::read_to_string(&out).unwrap();
    assert!(page.len() < 8 << 20, "{} bytes", page.len());
    let options = roxmltree::ParsingOptions { allow_dtd: true, ..Default::default() };
    let document = roxmltree::Document::parse_with_options(&page, options).unwrap();
    let count = |tag: &str| document.descendants().filter(|n| n.has_tag_name(tag)).count();
    assert_eq!(count("section"), 8);
    // two cases of truth, two presets, their differences and the camera; two moments of three runs
    assert_eq!(count("img"), 2 * 6 + 2 * 3);
    check_in_browser(&out);
}

/// Opens the page from the disk: its script runs to the end, nothing complains, nothing is fetched.
fn check_in_browser(page: &Path) {
    let profile = tempfile::tempdir().unwrap();
    let browser = Command::new("chromium")
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"])
        .args(["--disable-background-networking", "--disable-component-update", "--disable-sync"])
        .args(["--enable-logging=stderr", "--v=0", "--dump-dom"])
        .arg(format!("--user-data-dir={}", text(profile.path())))
        .arg(format!("file://{}", page.display()))
        .output();
    let Ok(output) = browser else {
        return skipped("no chromium here to open the page in");
    };
    let log = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{log}");
    assert!(!log.contains("CONSOLE"), "{log}");
    let shown = String::from_utf8_lossy(&output.stdout);
    // what the script adds to each slider when it starts
    assert_eq!(shown.matches("aria-valuetext=\"50 % ").count(), 4);
}

#[test]
fn a_study_folder_can_be_named_itself() {
    let folder = tempfile::tempdir().unwrap();
    write_json(folder.path().join("study.json"), &fixtures::tradeoff());
    let out = folder.path().join("page.html");
    let result = kinlight_json(&["report", text(folder.path()), "--out", text(&out)]);
    assert_eq!((&result["tradeoffs"], &result["light_studies"]), (&1.into(), &0.into()));
    let commands: Vec<_> = result["missing"]
        .as_array()
        .unwrap()
        .iter()
        .map(|m| m["command"].as_str().unwrap())
        .collect();
    assert_eq!(commands, ["kinlight compare", "kinlight study light", "kinlight study composite"]);
}

#[test]
fn broken_files_and_empty_folders_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report.html");
    let report = |folder: &Path| kinlight(&["report", text(folder), "--out", text(&out)]);

    let nothing = report(folder.path());
    let message = String::from_utf8_lossy(&nothing.stderr).into_owned();
    assert_eq!(nothing.status.code(), Some(1), "{message}");
    assert!(message.contains("kinlight study light") && !out.exists(), "{message}");
    let message = String::from_utf8(report(&folder.path().join("nowhere")).stderr).unwrap();
    assert!(message.contains("nowhere"), "{message}");

    write(folder.path().join("light/study.json"), "{\"machine\": 3}");
    write(folder.path().join("ours/timings.json"), "{");
    write(folder.path().join("ours/settings.toml"), "=");
    write(folder.path().join("ours/frames/000000.png"), "no picture");
    write_json(folder.path().join("tradeoff/study.json"), &fixtures::tradeoff());
    let broken = report(folder.path());
    let message = String::from_utf8_lossy(&broken.stderr).into_owned();
    assert_eq!(broken.status.code(), Some(1), "{message}");
    let page = fs::read_to_string(&out).unwrap();
    let broken_files =
        ["light/study.json", "ours/timings.json", "ours/settings.toml", "ours/frames/000000.png"];
    for name in broken_files {
        assert!(message.contains(name) && page.contains(name), "{name}: {message}");
    }
    assert!(page.contains("id=\"tradeoff\""), "what is whole is shown");
}

#[test]
fn runs_leave_a_page_unless_told_not_to() {
    let folder = tempfile::tempdir().unwrap();
    let run = |extra: &[&str]| {
        let frames = ["--frames", "0..2", "--warm-up", "1", "--out", text(folder.path())];
        let quick = ["--set", "volume.resolution=64", "--set", "transfer.directions=8"];
        kinlight_json(&[extra, &frames, &quick].concat());
        let page = folder.path().join("report.html");
        let text = fs::read_to_string(&page).ok();
        let _ = fs::remove_file(page); // the next run must make its own
        text
    };
    let replay = run(&["replay", "--preset", "ours-fast"]).unwrap();
    assert!(replay.contains("kinlight replay") && replay.contains("RadTransfer"));
    assert_eq!(replay.matches("class=\"single\"").count(), 2, "two of its frames");
    assert_eq!(run(&["replay", "--preset", "ours-fast", "--without", "report,mesh"]), None);
    let compare = run(&["compare", "--presets", "ours-fast,ours-fast-mobile"]).unwrap();
    assert!(compare.contains("Table 2") && compare.contains("kinlight compare"));
    assert!(compare.contains("<code>dyn_geo.denoise</code>"), "the setting that differs");
    assert_eq!(run(&["compare", "--without", "report"]), None);
}
