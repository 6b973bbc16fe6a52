//! Cameras through the real V4L2: inside a virtual machine whose kernel has `vivid`, a camera made of software,
//! as `/dev/video0`. `tests/vivid/run.sh` starts it; anywhere else these tests are skipped.
#![cfg(all(feature = "v4l", target_os = "linux"))]

#[path = "../common/mod.rs"]
mod common;
mod guest;

use common::virtual_sensor::Played;
use guest::{NODE, Vivid, bars, in_guest, next, open, sensor_folder};
use kinlight::capture::live::{ColorCamera, ColorDriver, DeviceError, LiveOptions, LiveSource};
use kinlight::capture::openni::{OpenniDriver, OpenniOptions};
use kinlight::capture::pixel_formats::PixelFormat;
use kinlight::capture::v4l::{V4lDriver, V4lOptions, nodes};
use kinlight::capture::{CaptureOptions, FrameSource, open_sequence};
use kinlight::image::Size;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

/// In a slow emulation; nothing waits so long but for what never comes.
const SOON: Duration = Duration::from_secs(60);

fn asking(formats: &[PixelFormat]) -> V4lOptions {
    V4lOptions { formats: formats.into(), ..V4lOptions::default() }
}

fn refusal(path: &Path, options: V4lOptions) -> DeviceError {
    V4lDriver::new(Some(path.to_owned()), options).open().err().expect("it cannot be opened")
}

#[test]
fn what_there_is_is_listed() {
    if !in_guest() {
        return;
    }
    let all = nodes();
    all.iter().for_each(|node| eprintln!("{node}"));
    let camera = all.iter().find(|node| node.path == Path::new(NODE)).expect("vivid's first node");
    assert_eq!((camera.card.as_str(), camera.driver.as_str()), ("vivid", "vivid"));
    assert_eq!(camera.problem, None);
    let yuyv = camera.formats.iter().find(|f| f.fourcc == "YUYV").expect("vivid has YUYV");
    assert!(yuyv.is_read && yuyv.sizes.iter().any(|s| s.starts_with("640x480 at ")), "{yuyv:?}");
    assert!(camera.formats.iter().any(|f| !f.is_read), "vivid has formats that no one else has");
    // Its other nodes are said to be what they are, and refused in the same words.
    for said in ["for output", "for metadata"] {
        let problem = |node: &&kinlight::capture::v4l::NodeReport| {
            node.problem.as_ref().is_some_and(|p| p.contains(said))
        };
        let node = all.iter().find(problem).unwrap_or_else(|| panic!("no node {said}"));
        let refused = refusal(&node.path, V4lOptions::default());
        assert!(matches!(refused, DeviceError::Unsupported(_)), "{refused:?}");
        assert_eq!(Some(refused.to_string()), node.problem);
    }
}

#[test]
fn every_format_gives_the_kernels_picture_and_its_times() {
    if !in_guest() {
        return;
    }
    let vivid = Vivid::new();
    vivid.choose("OSD Text Mode", 2); // none: what is written changes with the time
    let mut reference = None;
    for format in PixelFormat::ALL {
        if format == PixelFormat::Mjpeg {
            continue; // vivid compresses nothing
        }
        let mut camera = open(asking(&[format]));
        let (mode, rate) = (camera.info().modes[0].clone(), camera.rate_hz());
        assert!(mode.starts_with(&format!("colour: 640x480 {format}, ")), "{mode}");
        let times = "colour is dated by the driver, when its last byte came";
        assert!(camera.info().notes.iter().any(|n| n == times), "{:?}", camera.info().notes);
        let before = Instant::now();
        let pictures: Vec<_> = (0..6).map(|_| next(&mut *camera)).collect();
        let taken: Vec<_> = pictures.iter().map(|p| p.taken).collect();
        assert!(taken.windows(2).all(|w| w[0] < w[1]), "{taken:?}");
        // Four buffers may have been filled while the test did not look.
        let earliest = before.checked_sub(Duration::from_secs_f64(10.0 / rate)).unwrap();
        // vivid calculates times: that of a picture's number, rounded to the nearest period, and 0.9 of one for
        // its end. So one may be up to 1.4 periods ahead.
        let latest = Instant::now() + Duration::from_secs_f64(1.5 / rate);
        assert!(taken[0] > earliest && taken[5] < latest, "{taken:?} {before:?}");
        let found = bars(&pictures[5].pixels);
        eprintln!("{format} at {rate}/s: {found:?}");
        let reference = *reference.get_or_insert(found);
        for (found, expected) in found.iter().zip(&reference) {
            for (a, b) in found.iter().zip(expected) {
                // Both conversions round: the kernel's to 8 bits of YCbCr, which one code of is up to two of
                // blue, and ours from there.
                assert!(a.abs_diff(*b) <= 3, "{format}: {found:?} for {expected:?}");
            }
        }
    }
    let [white, yellow, .., black] = reference.unwrap();
    assert!(white.iter().all(|c| *c > 170) && black.iter().all(|c| *c < 20));
    assert!(yellow[0] > 170 && yellow[2] < 60, "red and blue are where they belong: {yellow:?}");
}

#[test]
fn the_nearest_mode_is_taken_and_said() {
    if !in_guest() {
        return;
    }
    let asked =
        V4lOptions { size: Some([800, 600]), fps: Some(11), ..asking(&[PixelFormat::Nv12]) };
    let mut camera = open(asked);
    assert_eq!(camera.size(), Size::new(640, 480));
    let notes = camera.info().notes.join("\n");
    assert!(notes.contains("colour of 800x600 is not offered: it is 640x480"), "{notes}");
    assert!(notes.contains("colour at 11 a second is not offered"), "{notes}");
    assert!((camera.rate_hz() - 10.0).abs() < 0.01, "{}", camera.rate_hz());
    next(&mut *camera);
    drop(camera);
    let asked = V4lOptions { size: Some([1280, 720]), fps: Some(5), ..V4lOptions::default() };
    let mut camera = open(asked);
    assert_eq!((camera.size(), camera.rate_hz()), (Size::new(1280, 720), 5.0));
    let first = next(&mut *camera).taken;
    let step_s = (next(&mut *camera).taken - first).as_secs_f64();
    // Whole periods: a slow emulation may lose pictures between.
    let off = step_s / 0.2 - (step_s / 0.2).round();
    assert!(step_s > 0.1 && off.abs() < 0.3, "{step_s}");
    drop(camera);
    let none = refusal(Path::new(NODE), asking(&[PixelFormat::Mjpeg]));
    assert!(matches!(none, DeviceError::Unsupported(_)), "{none:?}");
    assert!(none.to_string().contains("YUYV 320x180 at"), "{none}");
}

#[test]
fn a_camera_in_use_is_busy_until_it_is_closed() {
    if !in_guest() {
        return;
    }
    let mut camera = open(V4lOptions::default());
    next(&mut *camera);
    let busy = refusal(Path::new(NODE), V4lOptions::default());
    assert!(matches!(busy, DeviceError::Busy(_)), "{busy:?}");
    assert!(busy.to_string().contains("another program"), "{busy}");
    next(&mut *camera);
    drop(camera);
    next(&mut *open(V4lOptions::default()));
    let absent = refusal(Path::new("/dev/video99"), V4lOptions::default());
    assert!(matches!(absent, DeviceError::Absent(_)), "{absent:?}");
    let null = refusal(Path::new("/dev/null"), V4lOptions::default());
    assert!(null.to_string().contains("no V4L2 device"), "{null}");
}

#[test]
fn controls_are_held_where_they_exist_and_automatic_again_at_the_next_opening() {
    if !in_guest() {
        return;
    }
    let vivid = Vivid::new();
    let mut camera = open(V4lOptions::default());
    assert_eq!(vivid.value("Gain, Automatic"), 1);
    next(&mut *camera);
    // vivid has no control for the others.
    assert_eq!(camera.hold_exposure(), Err("exposure and white balance".into()));
    assert_eq!(vivid.value("Gain, Automatic"), 0);
    next(&mut *camera);
    drop(camera);
    assert_eq!(vivid.value("Gain, Automatic"), 0, "it stays in the camera");
    let camera = open(V4lOptions::default());
    assert_eq!(vivid.value("Gain, Automatic"), 1);
    drop(camera);
}

#[test]
fn damaged_pictures_are_bad_frames_and_a_broken_stream_is_lost() {
    if !in_guest() {
        return;
    }
    let vivid = Vivid::new();
    let mut camera = open(V4lOptions::default());
    next(&mut *camera);
    vivid.press("Inject V4L2_BUF_FLAG_ERROR");
    let error = until_error(&mut *camera);
    assert!(matches!(error, DeviceError::BadFrame(_)), "{error:?}");
    assert!(error.to_string().contains("marks it as damaged"), "{error}");
    next(&mut *camera);
    vivid.press("Inject Fatal Streaming Error");
    let error = until_error(&mut *camera);
    assert!(matches!(error, DeviceError::Lost(_)), "{error:?}");
    drop(camera);
    vivid.press("Inject VIDIOC_STREAMON Error");
    let error = refusal(Path::new(NODE), V4lOptions::default());
    assert!(error.to_string().contains("starting"), "{error}");
    next(&mut *open(V4lOptions::default()));
}

fn until_error(camera: &mut dyn ColorCamera) -> DeviceError {
    let patience = Instant::now() + SOON;
    while Instant::now() < patience {
        if let Err(error) = camera.wait(Duration::from_millis(100)) {
            return error;
        }
    }
    panic!("no error came");
}

#[test]
fn an_unplugged_camera_is_lost_then_absent_then_back() {
    if !in_guest() {
        return;
    }
    let mut driver = V4lDriver::new(None, V4lOptions::default());
    let mut camera = driver.open().unwrap();
    next(&mut *camera);
    // vivid is plugged in again when its last user has closed it: this handle stays open.
    let vivid = Vivid::new();
    vivid.press("Disconnect");
    let error = until_error(&mut *camera);
    assert!(matches!(error, DeviceError::Lost(_)), "{error:?}");
    assert!(error.to_string().contains("unplugged"), "{error}");
    drop(camera);
    let error = refusal(Path::new(NODE), V4lOptions::default());
    assert!(
        matches!(error, DeviceError::Lost(_)),
        "the node is there, the device is not: {error:?}"
    );
    drop(vivid);
    guest::remove_module();
    let error = driver.open().err().expect("it is gone");
    assert!(matches!(error, DeviceError::Absent(_)), "{error:?}");
    guest::insert_module();
    next(&mut *driver.open().expect("it is back"));
}

/// Beside the sensor: small and slow, for an emulation of both.
const SMALL: Size = Size::new(320, 180);
const SLOW_FPS: u32 = 5;

/// A sensor without colour that gives a plane, for longer than any test takes.
fn prepare_sensor() -> PathBuf {
    let folder = sensor_folder();
    let played = Played {
        depth_size: [64, 48],
        color_size: [0, 0],
        frames: vec![(vec![1500; 64 * 48], Vec::new()); 3000],
    };
    played.write(&folder, &format!("fps {SLOW_FPS}\npace clock"));
    let calibration = folder.join("beside.toml");
    std::fs::write(&calibration, include_str!("beside.toml")).unwrap();
    calibration
}

#[test]
fn the_program_records_vivid_beside_a_depth_sensor() {
    if !in_guest() {
        return;
    }
    let calibration = prepare_sensor();
    let out = std::env::temp_dir().join("recorded");
    let mut program = Command::new(std::env::var_os("KINLIGHT_PROGRAM").expect("set by run.sh"));
    program.args(["record", "--device", "openni", "--color-device", "v4l:/dev/video0"]);
    program.args(["--size", "320,180", "--fps", "5", "--color-delay", "-5ms"]);
    program.args(["--hold-exposure-after", "100ms", "--stall", "60s", "--frames", "8", "--json"]);
    let output = program.arg("--calibration").arg(calibration).arg("--out").arg(&out).output();
    let output = output.expect("the program starts");
    let said = String::from_utf8_lossy(&output.stderr);
    eprintln!("{said}");
    assert!(output.status.success(), "{said}");
    let result: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let live = &result["live"];
    assert_eq!((&live["outages"], &live["bad"]), (&0.into(), &0.into()));
    let device = live["device"].to_string();
    for note in ["colour is from v4l:/dev/video0", "320x180", "taken as -5.0 ms late"] {
        assert!(device.contains(note), "{note}: {device}");
    }
    assert!(said.contains("exposure and white balance cannot be held"), "{said}");
    let written = result["frames"].as_u64().unwrap();
    assert!(written > 0, "{result}");
    let mut recorded = open_sequence(&out, &CaptureOptions::default()).unwrap();
    assert_eq!(recorded.len(), Some(written as usize));
    let mut times = Vec::new();
    while let Some(frame) = recorded.next_frame().unwrap() {
        assert_eq!(frame.color.size(), SMALL);
        let [white, .., black] = bars(&frame.color);
        assert!(white.iter().all(|c| *c > 170) && black.iter().all(|c| *c < 20));
        // The plane of the sensor, where the camera sees it.
        let depth_m = frame.depth_m[(160, 90)];
        assert!((depth_m - 1.5).abs() < 1e-3, "{depth_m}");
        times.push(frame.timestamp_s);
    }
    assert!(times.windows(2).all(|w| w[0] < w[1]), "{times:?}");
}

#[test]
fn a_run_goes_on_when_vivid_is_unplugged_and_comes_back() {
    if !in_guest() {
        return;
    }
    let calibration = prepare_sensor();
    let fps = Some(SLOW_FPS);
    let asked = OpenniOptions { calibration: Some(calibration), fps, ..Default::default() };
    let size = Some([SMALL.width, SMALL.height]);
    let camera = V4lDriver::new(None, V4lOptions { size, fps, ..V4lOptions::default() });
    let driver = OpenniDriver::new(None, asked).with_color(Box::new(camera));
    let options = LiveOptions { stall: SOON, first_frame: SOON, ..LiveOptions::default() };
    let mut source = LiveSource::open(Box::new(driver), options).unwrap();
    let mut last_s = f64::NEG_INFINITY;
    let mut take = |source: &mut LiveSource, frames| {
        for _ in 0..frames {
            let frame = source.next_frame().unwrap().expect("it has no end");
            assert!(frame.timestamp_s > last_s);
            last_s = frame.timestamp_s;
        }
    };
    take(&mut source, 4);
    let vivid = Vivid::new();
    vivid.press("Disconnect");
    // Unplugged until the last handle is closed: for the loss and some attempts to open it again.
    let patience = Instant::now() + SOON;
    while source.counts().attempts < 2 {
        assert!(Instant::now() < patience, "the loss was not seen: {:?}", source.counts());
        std::thread::sleep(Duration::from_millis(20));
    }
    drop(vivid);
    // One that was waiting, then those after the outage.
    take(&mut source, 4);
    let counts = source.counts();
    eprintln!("{counts}");
    // Not of jumps of its clock: to an emulation slower than the camera, pictures that waited look like some.
    assert_eq!((counts.outages, counts.recoveries), (1, 1));
    let started = Instant::now();
    drop(source);
    assert!(started.elapsed() < Duration::from_secs(2), "{:?}", started.elapsed());
    next(&mut *open(V4lOptions::default()));
}
