//! `kinlight doctor` on cameras: the real OpenNI2 with made folders of drivers, one of them the virtual
//! sensor's. Trees of `/sys` are made in the library's own tests.
#![cfg(target_os = "linux")]

mod common;

use common::text;
use common::virtual_sensor::{Played, equipped, installed, with_sensor};
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};
use tempfile::TempDir;

const SIZE: [usize; 2] = [64, 48];
const USUAL: &str = "fov 1.0 0.8\nregistration yes\nsync yes\n";

/// A folder with OpenNI2 and the virtual sensor in it; `None`, said aloud, without OpenNI2.
fn sensor(script: &str) -> Option<TempDir> {
    let folder = equipped(installed()?);
    Played::noise(SIZE, SIZE, 3).write(folder.path(), &format!("{USUAL}{script}"));
    Some(folder)
}

fn doctor(folder: &Path, args: &[&str]) -> Output {
    let program = Path::new(env!("CARGO_BIN_EXE_kinlight"));
    with_sensor(program, folder).arg("doctor").args(args).output().expect("the program starts")
}

fn report(folder: &Path, args: &[&str]) -> Value {
    let output = doctor(folder, &[args, &["--json"]].concat());
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{}: {said}", output.status);
    serde_json::from_slice(&output.stdout).expect("one JSON value on standard output")
}

/// What is wrong, and what to do, of the problem that has these words.
fn problem<'a>(report: &'a Value, words: &[&str]) -> (&'a str, &'a str) {
    let problems = report["problems"].as_array().expect("a list");
    let field = |p: &'a Value, name: &str| p[name].as_str().expect("a text");
    let found = problems.iter().map(|p| (field(p, "what"), field(p, "fix")));
    found
        .clone()
        .find(|(what, _)| words.iter().all(|word| what.contains(word)))
        .unwrap_or_else(|| panic!("{words:?} in {:?}", found.collect::<Vec<_>>()))
}

fn driver<'a>(report: &'a Value, file: &str) -> &'a Value {
    let drivers = report["cameras"]["openni"]["drivers"].as_array().expect("a list");
    drivers.iter().find(|d| d["file"] == file).unwrap_or_else(|| panic!("{file} in {drivers:?}"))
}

#[test]
fn an_announced_sensor_is_described_and_listed() {
    let Some(folder) = sensor("") else { return };
    let report = report(folder.path(), &[]);
    let openni = &report["cameras"]["openni"];
    let real = folder.path().canonicalize().unwrap();
    assert_eq!(openni["library"], text(&real.join("libOpenNI2.so.0")));
    assert_eq!(openni["drivers_folder"], text(&real.join("OpenNI2/Drivers")));
    assert!(openni["version"].as_str().unwrap().starts_with("2."), "{openni}");
    for file in ["libOniFile.so.0", "libKinlightVirtual.so.0"] {
        assert_eq!(driver(&report, file)["state"], "loads");
    }
    let devices = openni["devices"].as_array().unwrap();
    let device = &devices[0];
    assert_eq!((devices.len(), &device["uri"]), (1, &"virtual://kinlight".into()));
    assert_eq!(
        device["depth_modes"],
        serde_json::json!(["64x48 depth in mm, 30/s", "64x48 depth in mm, 15/s"])
    );
    assert_eq!(device["color_modes"], serde_json::json!(["64x48 RGB, 30/s", "64x48 RGB, 15/s"]));
    assert_eq!((&device["registers"], &device["synchronises"]), (&true.into(), &true.into()));
    for first in ["first_depth_ms", "first_color_ms"] {
        assert!(device[first].is_number(), "{device}");
    }
    assert_eq!((&device["error"], &device["stream_error"]), (&Value::Null, &Value::Null));
    assert!(report["features"]["gpu"].is_boolean() && report["optional"][0]["program"] == "ffmpeg");

    let said = doctor(folder.path(), &[]);
    let said = String::from_utf8_lossy(&said.stdout).into_owned();
    for words in ["openni:virtual://kinlight", "64x48 RGB, 15/s", "registers depth to colour: yes"]
    {
        assert!(said.contains(words), "{said}");
    }
    let last = said.lines().last().unwrap();
    let count = report["problems"].as_array().unwrap().len();
    let expected = match count {
        0 => "no problems".to_owned(),
        1 => "1 problem".to_owned(),
        n => format!("{n} problems"),
    };
    assert_eq!(last, expected);

    let listed = doctor(folder.path(), &["--devices"]);
    assert_eq!(String::from_utf8_lossy(&listed.stdout), "openni:virtual://kinlight\n");
    let listed = self::report(folder.path(), &["--devices"]);
    assert_eq!(listed["devices"][0]["device"], "openni:virtual://kinlight");
}

#[test]
fn what_is_listed_can_be_recorded_from() {
    let Some(folder) = sensor("") else { return };
    let listed = doctor(folder.path(), &["--devices", "--quiet"]);
    assert!(listed.stdout.is_empty() && listed.status.success());
    let device = doctor(folder.path(), &["--devices"]).stdout;
    let (device, out) = (String::from_utf8(device).unwrap(), folder.path().join("out"));
    let program = Path::new(env!("CARGO_BIN_EXE_kinlight"));
    let record = ["record", "--every-frame", "--frames", "2", "--device", device.trim(), "--out"];
    let status = with_sensor(program, folder.path()).args(record).arg(&out).status().unwrap();
    assert!(status.success() && out.join("rgb.txt").is_file());
}

#[test]
fn a_sensor_that_does_not_register_or_stream_is_said_so() {
    let Some(folder) = sensor("registration no\nsync no\nfault stall 0\n") else { return };
    let report = report(folder.path(), &[]);
    let device = &report["cameras"]["openni"]["devices"][0];
    assert_eq!((&device["registers"], &device["synchronises"]), (&false.into(), &false.into()));
    let (what, fix) = problem(&report, &["virtual://kinlight", "no depth", "no colour frame"]);
    assert!(fix.contains("port"), "{what}: {fix}");
}

#[test]
fn a_driver_that_crashes_or_hangs_takes_only_its_own_process() {
    for (fault, words) in [
        ("crash open", ["virtual://kinlight", "crashed (SIGABRT) while opening it"]),
        ("crash start", ["virtual://kinlight", "crashed (SIGABRT) while starting its streams"]),
        ("crash initialize", ["OpenNI2 does not start", "crashed (SIGABRT) while loading OpenNI2"]),
        ("hang open", ["virtual://kinlight", "within 6 s, while opening it"]),
        ("hang initialize", ["OpenNI2 does not start", "within 6 s, while loading OpenNI2"]),
    ] {
        let Some(folder) = sensor(&format!("fault {fault}\n")) else { return };
        let report = report(folder.path(), &["--patience", "6s"]);
        problem(&report, &words);
        // The rest of the report is there.
        assert_eq!(driver(&report, "libOniFile.so.0")["state"], "loads", "{fault}");
        assert!(report["optional"].is_array(), "{fault}");
    }
}

#[test]
fn where_devices_cannot_be_listed_that_is_an_error() {
    let Some(folder) = sensor("fault crash initialize\n") else { return };
    let output = doctor(folder.path(), &["--devices"]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(6), "{said}");
    assert!(said.contains("SIGABRT"), "{said}");
    let Some(absent) = sensor("fault absent\n") else { return };
    let output = doctor(absent.path(), &["--devices"]);
    assert!(output.status.success() && output.stdout.is_empty());
    assert!(String::from_utf8_lossy(&output.stderr).contains("no camera"));
}

#[test]
fn a_busy_sensor_is_a_problem_with_its_reason() {
    let Some(folder) = sensor("fault busy\n") else { return };
    let report = report(folder.path(), &[]);
    let (_, fix) = problem(&report, &["virtual://kinlight", "cannot be opened"]);
    assert!(fix.contains("other programs"), "{fix}");
}

/// Compiles a shared library that depends on others in its folder.
fn compile(code: &str, library: &Path, needs: &[&Path]) {
    let source = library.with_extension("c");
    std::fs::write(&source, code).unwrap();
    // By this name others need it, not by its path.
    let name = library.file_name().unwrap().to_str().unwrap();
    let built = Command::new("cc")
        .args(["-shared", "-fPIC", &format!("-Wl,-soname,{name}")])
        .args(["-o", text(library), text(&source)])
        .args(needs)
        .status()
        .expect("there is a C compiler, which links Rust programs, too");
    assert!(built.success(), "{code}");
    std::fs::remove_file(source).unwrap();
}

#[test]
fn drivers_that_do_not_load_are_told_apart() {
    let Some(folder) = sensor("") else { return };
    let drivers = folder.path().join("OpenNI2/Drivers");
    let at = |name: &str| drivers.join(name);
    const CREATE: &str = "void oniDriverCreate(void *services) { (void)services; }";
    // One that was built for a system with an old libudev, which is gone.
    let needed = folder.path().join("libudev.so.0");
    compile("void udev_new(void) {}", &needed, &[]);
    let uses = "extern void udev_new(void); void oniDriverCreate(void *s) { (void)s; udev_new(); }";
    compile(uses, &at("libOld.so.0"), &[&needed]);
    std::fs::remove_file(needed).unwrap();
    compile("int x;", &at("libOther.so.0"), &[]);
    compile(CREATE, &at("libFreenectDriver.so"), &[]);
    let crashes =
        "#include <stdlib.h>\n__attribute__((constructor)) static void f(void) { abort(); }";
    compile(crashes, &at("libCrashes.so.0"), &[]);
    let hangs = "#include <unistd.h>\n__attribute__((constructor)) static void f(void) { for (;;) pause(); }";
    compile(hangs, &at("libHangs.so.0"), &[]);
    std::fs::write(at("libEmpty.so.0"), "").unwrap();
    std::fs::write(at("README"), "").unwrap();

    let report = report(folder.path(), &["--patience", "6s"]);
    let why = |file: &str| driver(&report, file)["why"].as_str().unwrap_or_default().to_owned();
    assert!(why("libOld.so.0").contains("libudev.so.0: cannot open"), "{}", why("libOld.so.0"));
    assert!(why("libOther.so.0").contains("no oniDriverCreate"));
    assert!(why("libCrashes.so.0").contains("SIGABRT"));
    assert!(why("libHangs.so.0").contains("within 6 s"));
    assert!(why("libEmpty.so.0").contains("too short"), "{}", why("libEmpty.so.0"));
    for file in ["libFreenectDriver.so", "README"] {
        assert_eq!(driver(&report, file)["state"], "ignored");
    }
    let (_, fix) = problem(&report, &["libOld.so.0", "libudev.so.0"]);
    assert!(fix.contains("built for this system"), "{fix}");
    let (_, fix) = problem(&report, &["libFreenectDriver.so is ignored"]);
    assert!(fix.contains("rename it to libFreenectDriver.so.0"), "{fix}");
    let readme = report["problems"].as_array().unwrap().iter();
    assert!(readme.clone().all(|p| !p.to_string().contains("README")));
}

#[test]
fn a_library_without_drivers_or_none_at_all_is_said_with_its_remedy() {
    let Some(folder) = sensor("") else { return };
    let drivers = folder.path().join("OpenNI2/Drivers");
    std::fs::remove_file(drivers.join("libKinlightVirtual.so.0")).unwrap();
    problem(&report(folder.path(), &[]), &["no driver for a sensor"]);
    std::fs::remove_dir_all(drivers).unwrap();
    problem(&report(folder.path(), &[]), &["no driver for a sensor"]);
    std::fs::remove_file(folder.path().join("libOpenNI2.so.0")).unwrap();
    let without = report(folder.path(), &[]);
    let (_, fix) = problem(&without, &["no libOpenNI2.so.0"]);
    assert!(fix.contains("apt install libopenni2-0"), "{fix}");
    assert_eq!(without["cameras"]["openni"]["library"], Value::Null);
    assert_eq!(doctor(folder.path(), &["--devices"]).status.code(), Some(6));
}
