//! A colour camera beside a depth sensor: scripted, beside the virtual sensor behind the real OpenNI2.
#![cfg(target_os = "linux")]

mod common;

use common::text;
use common::virtual_sensor::{Played, TWO_CAMERAS, scenario, with_sensor};
use kinlight::capture::live::{
    ColorCamera, ColorDriver, ColorPicture, DeviceError, DeviceInfo, LiveDevice, LiveDriver,
    LiveOptions, LiveSource,
};
use kinlight::capture::openni::{OniFiles, OpenniDriver, OpenniOptions};
use kinlight::capture::{Calibration, FrameSource, RawFrame, Registration};
use kinlight::image::{Image, Size};
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

const COLOR: Size = Size::new(64, 48);
const DEPTH: Size = Size::new(32, 24);
const SOON: Duration = Duration::from_secs(5);
/// Slow, so that half a period is long beside what a busy machine adds.
const FPS: usize = 10;
const PERIOD_S: f64 = 1.0 / FPS as f64;

/// Depth alone: a smooth surface, another in each frame.
fn depth_frames(count: usize) -> Played {
    let depth = |k: usize| {
        (0..DEPTH.pixels())
            .map(|i| (1000 + 10 * k + 7 * (i % DEPTH.width) + 3 * (i / DEPTH.width)) as u16)
            .collect()
    };
    Played {
        depth_size: [DEPTH.width, DEPTH.height],
        color_size: [0, 0],
        frames: (0..count).map(|k| (depth(k), Vec::new())).collect(),
    }
}

fn prepare(folder: &Path, frames: usize, script: &str) {
    depth_frames(frames).write(folder, &format!("fps {FPS}\npace clock\n{script}"));
    std::fs::write(folder.join("two.toml"), TWO_CAMERAS).unwrap();
}

/// Depth of each frame as the colour camera sees it.
fn registered(frames: usize) -> Vec<Image<f32>> {
    let known = Calibration::from_toml(TWO_CAMERAS).unwrap();
    let transform = known.color_from_depth.unwrap().pose().unwrap();
    let mut registration =
        Registration::new(&known.depth.unwrap(), known.color.pinhole(), &transform);
    let registered = |(depth, _): &(Vec<u16>, _)| {
        let metres = depth.iter().map(|&d| f32::from(d) / 1000.0).collect();
        let mut out = Image::default();
        registration.register(&Image::from_vec(DEPTH, metres), &mut out);
        out
    };
    depth_frames(frames).frames.iter().map(registered).collect()
}

/// Which depth frame it is.
fn depth_number(frame: &RawFrame, all: &[Image<f32>]) -> usize {
    all.iter().position(|depth| *depth == frame.depth_m).expect("depth of one of the frames")
}

/// What the camera does for a picture, instead of giving it.
#[derive(Clone)]
enum Act {
    Lose,
    Bad,
    Small,
}

/// A camera that takes a picture each period, beginning when it is opened.
#[derive(Clone, Default)]
struct Script {
    /// From taking to delivering.
    latency: Duration,
    /// By how much its clock is ahead of when pictures are taken.
    ahead: Duration,
    /// At these pictures of the first opening.
    acts: Vec<(usize, Act)>,
    /// Nothing comes after this many.
    silent_after: Option<usize>,
    /// Errors of the openings to come.
    openings: Arc<Mutex<VecDeque<DeviceError>>>,
    opened: Arc<AtomicUsize>,
    closed: Arc<AtomicUsize>,
    /// When each picture of the newest opening was dated.
    dated: Arc<Mutex<Vec<Instant>>>,
}

impl ColorDriver for Script {
    fn open(&mut self) -> Result<Box<dyn ColorCamera>, DeviceError> {
        if let Some(error) = self.openings.lock().unwrap().pop_front() {
            return Err(error);
        }
        if self.opened.fetch_add(1, SeqCst) > 0 {
            self.acts.clear();
        }
        self.dated.lock().unwrap().clear();
        let info = DeviceInfo {
            uri: "scripted:0".into(),
            vendor: "kinlight".into(),
            name: "camera".into(),
            modes: vec!["colour: as the script says".into()],
            notes: vec!["a note of the camera's".into()],
        };
        Ok(Box::new(Camera { script: self.clone(), info, began: Instant::now(), next: 0 }))
    }
}

struct Camera {
    script: Script,
    info: DeviceInfo,
    began: Instant,
    next: usize,
}

impl Drop for Camera {
    fn drop(&mut self) {
        self.script.closed.fetch_add(1, SeqCst);
    }
}

/// Tells pictures apart.
fn color_of(picture: usize) -> [u8; 3] {
    [picture as u8, 200 - picture as u8, 77]
}

impl ColorCamera for Camera {
    fn info(&self) -> &DeviceInfo {
        &self.info
    }

    fn size(&self) -> Size {
        COLOR
    }

    fn rate_hz(&self) -> f64 {
        FPS as f64
    }

    fn wait(&mut self, timeout: Duration) -> Result<Option<ColorPicture>, DeviceError> {
        let k = self.next;
        let taken = self.began + Duration::from_secs_f64(k as f64 * PERIOD_S);
        let silent = self.script.silent_after.is_some_and(|most| k >= most);
        let wait = (taken + self.script.latency).saturating_duration_since(Instant::now());
        if silent || wait > timeout {
            std::thread::sleep(timeout);
            return Ok(None);
        }
        std::thread::sleep(wait);
        self.next += 1;
        let dated = taken + self.script.ahead;
        self.script.dated.lock().unwrap().push(dated);
        let act = self.script.acts.iter().find(|(at, _)| *at == k).map(|(_, act)| act);
        let size = match act {
            Some(Act::Lose) => return Err(DeviceError::Lost("scripted:0 was unplugged".into())),
            Some(Act::Bad) => return Err(DeviceError::BadFrame("7 of 9216 bytes".into())),
            Some(Act::Small) => Size::new(4, 3),
            None => COLOR,
        };
        Ok(Some(ColorPicture { taken: dated, pixels: Image::new(size, color_of(k)) }))
    }

    fn hold_exposure(&mut self) -> Result<(), String> {
        Err("white balance".into())
    }
}

fn options(folder: &Path) -> OpenniOptions {
    OpenniOptions { calibration: Some(folder.join("two.toml")), ..OpenniOptions::default() }
}

fn driver(script: &Script, options: OpenniOptions) -> OpenniDriver {
    OpenniDriver::new(None, options).with_color(Box::new(script.clone()))
}

fn next(device: &mut dyn LiveDevice) -> RawFrame {
    device.wait(SOON).expect("no error").expect("a frame in time")
}

/// What a busy machine may add: threads that start late, frames that are read late.
const LATE_S: f64 = 0.045;

/// Each test runs again in a process of its own, where arguments are files in its folder.
fn pairs(name: &str, latency_ms: u64, ahead_ms: i64) {
    const FRAMES: usize = 24;
    scenario(
        name,
        |folder| prepare(folder, FRAMES, ""),
        |folder| {
            let all = registered(FRAMES);
            assert!(all[0].as_slice().iter().filter(|&&d| d > 0.0).count() > 2000);
            let script = Script {
                latency: Duration::from_millis(latency_ms),
                ahead: Duration::from_millis(ahead_ms.unsigned_abs()),
                ..Script::default()
            };
            let asked = OpenniOptions { color_delay_s: ahead_ms as f64 * 1e-3, ..options(folder) };
            let before = Instant::now();
            let mut driver = driver(&script, asked);
            let after = Instant::now();
            // Loads the library, so that opening takes no time when it counts.
            drop(driver.open().unwrap());
            let mut device = driver.open().unwrap();
            let started = Instant::now();
            assert_eq!(
                device.camera(),
                Calibration::from_toml(TWO_CAMERAS).unwrap().color.pinhole()
            );
            let mut seen = Vec::new();
            while let Some(frame) = device.wait(Duration::from_millis(700)).unwrap() {
                let [number, ..] = frame.color[(0, 0)];
                let picture = usize::from(number);
                assert_eq!(frame.color, Image::new(COLOR, color_of(picture)));
                let dated = script.dated.lock().unwrap()[picture];
                let taken = dated - script.ahead;
                // Frames have the time of colour, by the host's clock.
                let [least, most] = [after, before].map(|epoch| (taken - epoch).as_secs_f64());
                assert!(
                    (least - 1e-6..=most + 1e-6).contains(&frame.timestamp_s),
                    "{least} {} {most}",
                    frame.timestamp_s
                );
                // The sensor starts last of all, a moment before the device is open.
                let depth = depth_number(&frame, &all);
                let depth_taken = started + Duration::from_secs_f64(depth as f64 * PERIOD_S);
                let apart_s = if taken > depth_taken {
                    (taken - depth_taken).as_secs_f64()
                } else {
                    -(depth_taken - taken).as_secs_f64()
                };
                seen.push((picture, depth, apart_s));
            }
            // Half a period is what pairing allows.
            let far = seen.iter().find(|(.., apart_s)| apart_s.abs() > 0.5 * PERIOD_S + LATE_S);
            assert!(far.is_none(), "{seen:?}");
            assert!(seen.len() > FRAMES / 2, "{seen:?}");
            assert!(seen.windows(2).all(|w| w[0].0 < w[1].0 && w[0].1 < w[1].1), "{seen:?}");
        },
    );
}

#[test]
fn colour_pairs_with_depth_of_the_same_moment() {
    pairs("colour_pairs_with_depth_of_the_same_moment", 0, 0);
}

#[test]
fn colour_that_takes_long_to_deliver_pairs_with_depth_of_its_moment() {
    pairs("colour_that_takes_long_to_deliver_pairs_with_depth_of_its_moment", 260, 0);
}

#[test]
fn colour_that_is_dated_late_pairs_with_depth_of_its_moment() {
    pairs("colour_that_is_dated_late_pairs_with_depth_of_its_moment", 30, 250);
}

/// Until the source has given so many frames; what it counted by then.
fn take(source: &mut LiveSource, frames: usize) -> Vec<RawFrame> {
    (0..frames).map(|_| source.next_frame().unwrap().expect("it has no end")).collect()
}

#[test]
fn a_lost_camera_is_a_lost_device_and_both_come_back() {
    scenario(
        "a_lost_camera_is_a_lost_device_and_both_come_back",
        |folder| prepare(folder, 100, ""),
        |folder| {
            let script = Script { acts: vec![(6, Act::Lose)], ..Script::default() };
            let driver = driver(&script, options(folder));
            let mut source = LiveSource::open(Box::new(driver), LiveOptions::default()).unwrap();
            let away = [1, 2].map(|_| DeviceError::Absent("/dev/video9 is not there".into()));
            script.openings.lock().unwrap().extend(away);
            let frames = take(&mut source, 12);
            let counts = source.counts();
            assert_eq!((counts.outages, counts.recoveries, counts.clock_jumps), (1, 1, 0));
            assert!(counts.attempts >= 3, "{counts:?}");
            assert_eq!(script.opened.load(SeqCst), 2);
            assert_eq!(script.closed.load(SeqCst), 1, "the first is closed");
            let times: Vec<_> = frames.iter().map(|f| f.timestamp_s).collect();
            assert!(times.windows(2).all(|w| w[0] < w[1]), "{times:?}");
            let started = Instant::now();
            drop(source);
            assert!(started.elapsed() < Duration::from_secs(2), "{:?}", started.elapsed());
            assert_eq!(script.closed.load(SeqCst), 2);
        },
    );
}

#[test]
fn a_lost_sensor_takes_the_camera_with_it_and_both_come_back() {
    scenario(
        "a_lost_sensor_takes_the_camera_with_it_and_both_come_back",
        |folder| prepare(folder, 100, "fault unplug 6 300\n"),
        |folder| {
            let script = Script::default();
            let driver = driver(&script, options(folder));
            let mut source = LiveSource::open(Box::new(driver), LiveOptions::default()).unwrap();
            take(&mut source, 12);
            let counts = source.counts();
            assert_eq!((counts.outages, counts.recoveries), (1, 1));
            // While the sensor is away the camera is opened with each attempt, and closed again.
            let opened = script.opened.load(SeqCst);
            assert!(opened >= 2);
            assert_eq!(script.closed.load(SeqCst), opened - 1);
        },
    );
}

#[test]
fn bad_pictures_cost_themselves_and_a_silent_camera_keeps_no_one_waiting() {
    scenario(
        "bad_pictures_cost_themselves_and_a_silent_camera_keeps_no_one_waiting",
        |folder| prepare(folder, 100, ""),
        |folder| {
            let acts = vec![(2, Act::Bad), (4, Act::Small)];
            let script = Script { acts, silent_after: Some(8), ..Script::default() };
            let mut device = driver(&script, options(folder)).open().unwrap();
            let (mut pictures, mut errors) = (Vec::new(), Vec::new());
            loop {
                match device.wait(Duration::from_millis(700)) {
                    Ok(Some(frame)) => pictures.push(frame.color[(0, 0)][0]),
                    Ok(None) => break,
                    Err(DeviceError::BadFrame(why)) => errors.push(why),
                    Err(error) => panic!("{error:?}"),
                }
            }
            assert!(pictures.iter().all(|k| ![2, 4].contains(k) && *k < 8), "{pictures:?}");
            assert!(pictures.contains(&3) && pictures.contains(&7), "{pictures:?}");
            assert_eq!(errors, ["7 of 9216 bytes", "a colour picture of 4x3, not 64x48"]);
            let started = Instant::now();
            drop(device);
            assert!(started.elapsed() < Duration::from_secs(2), "{:?}", started.elapsed());
            assert_eq!(script.closed.load(SeqCst), 1);
        },
    );
}

#[test]
fn what_was_done_and_what_the_camera_cannot_is_said() {
    scenario(
        "what_was_done_and_what_the_camera_cannot_is_said",
        // One that could register depth to a colour camera of its own.
        |folder| prepare(folder, 60, "registration yes\n"),
        |folder| {
            let hold_exposure_after = Some(Duration::from_millis(20));
            let asked = OpenniOptions { hold_exposure_after, ..options(folder) };
            let script = Script::default();
            let mut device = driver(&script, asked).open().unwrap();
            let notes = |device: &dyn LiveDevice| device.info().notes.join("\n");
            assert_eq!(
                device.info().modes,
                ["depth: 32x24 depth in mm, 10/s", "colour: as the script says"]
            );
            for said in [
                "colour is from scripted:0 (kinlight camera)",
                "a note of the camera's",
                "depth is registered to colour here",
                "paired by the host's clock",
            ] {
                assert!(notes(&*device).contains(said), "{said}: {}", notes(&*device));
            }
            let all = registered(60);
            let patience = Instant::now() + SOON;
            let held = "white balance cannot be held";
            while !notes(&*device).contains(held) && Instant::now() < patience {
                depth_number(&next(&mut *device), &all);
            }
            assert!(notes(&*device).contains(held), "{}", notes(&*device));
        },
    );
}

#[test]
fn colour_is_corrected_as_its_calibration_says() {
    scenario(
        "colour_is_corrected_as_its_calibration_says",
        |folder| {
            prepare(folder, 60, "");
            let swap = "[photometry]\ncolor_matrix = [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]\n";
            std::fs::write(folder.join("two.toml"), format!("{TWO_CAMERAS}{swap}")).unwrap();
        },
        |folder| {
            let mut device = driver(&Script::default(), options(folder)).open().unwrap();
            let [a, b, c] = next(&mut *device).color[(5, 5)];
            let [r, g, blue] = color_of(usize::from(b));
            assert_eq!([a, b, c], [g, r, blue]);
        },
    );
}

#[test]
fn what_is_missing_is_named() {
    scenario(
        "what_is_missing_is_named",
        |folder| prepare(folder, 60, ""),
        |folder| {
            let error = |asked: OpenniOptions| {
                let script = Script::default();
                let error = driver(&script, asked).open().err().expect("it cannot be opened");
                assert!(matches!(error, DeviceError::Unsupported(_)), "{error:?}");
                assert_eq!(script.opened.load(SeqCst), script.closed.load(SeqCst));
                error.to_string()
            };
            let calibrated = |name: &str, content: String| -> OpenniOptions {
                let path = folder.join(name);
                std::fs::write(&path, content).unwrap();
                OpenniOptions { calibration: Some(path), ..OpenniOptions::default() }
            };
            let none = error(OpenniOptions::default());
            assert!(none.contains("[color], [depth] and [color_from_depth]"), "{none}");
            let color_alone: String =
                TWO_CAMERAS.split("[depth]").next().unwrap().replace("false", "true");
            let said = error(calibrated("color.toml", color_alone));
            assert!(said.contains("color.toml has no [depth] and [color_from_depth]"), "{said}");
            let no_pose = TWO_CAMERAS.split("[color_from_depth]").next().unwrap();
            let said = error(calibrated("no_pose.toml", no_pose.replace("false", "true")));
            assert!(said.contains("no_pose.toml has no [color_from_depth]"), "{said}");
            let other = TWO_CAMERAS.replacen("height = 48", "height = 60", 1);
            let said = error(calibrated("other.toml", other));
            assert!(said.contains("pictures are 64x48, the calibration is for 64x60"), "{said}");
            let said = error(OpenniOptions { color_delay_s: -0.9, ..options(folder) });
            assert!(said.contains("-900 ms") && said.contains("up to 700 ms"), "{said}");
            let record = Some(OniFiles::new(folder.join("room.oni")));
            let said = error(OpenniOptions { record, ..options(folder) });
            assert!(said.contains("no .oni with a colour camera beside it"), "{said}");
            assert!(!folder.join("room.oni").exists());

            // The sensor's own registration counts for nothing.
            let said_registered = TWO_CAMERAS.replace("registered = false", "registered = true");
            let asked = calibrated("registered.toml", said_registered);
            let mut device = driver(&Script::default(), asked).open().unwrap();
            depth_number(&next(&mut *device), &registered(60));
            let notes = device.info().notes.join("\n");
            assert!(notes.contains("registered.toml counts depth as registered"), "{notes}");
            drop(device);

            // A sensor without colour says so where no camera stands beside it.
            let alone = OpenniDriver::new(None, options(folder)).open().err().unwrap();
            assert!(alone.to_string().contains("no colour stream"), "{alone}");
            let script = Script::default();
            let away = DeviceError::Absent("/dev/video9 is not there".into());
            script.openings.lock().unwrap().push_back(away);
            let error = driver(&script, options(folder)).open().err().unwrap();
            assert!(matches!(error, DeviceError::Absent(_)), "{error:?}");
        },
    );
}

#[test]
fn the_program_says_what_its_camera_lacks() {
    scenario(
        "the_program_says_what_its_camera_lacks",
        |folder| prepare(folder, 60, ""),
        |folder| {
            let out: PathBuf = folder.join("out");
            let calibration = folder.join("two.toml");
            let run = |args: &[&str]| {
                let program = Path::new(env!("CARGO_BIN_EXE_kinlight"));
                let record = ["record", "--out", text(&out), "--frames", "3"];
                let output = with_sensor(program, folder).args(record).args(args).output().unwrap();
                let said = String::from_utf8_lossy(&output.stderr).into_owned();
                (output.status.code(), said)
            };
            let calibrated = ["--calibration", text(&calibration), "--color-device"];
            let (code, said) = run(&["--color-device", "v4l"]);
            assert!(code == Some(2) && said.contains("--calibration"), "{said}");
            let (code, said) = run(&[&calibrated[..], &["webcam"]].concat());
            assert!(code == Some(2) && said.contains("'webcam'"), "{said}");
            let (code, said) = run(&[&calibrated[..], &["v4l:/dev/no-such-video"]].concat());
            if cfg!(feature = "v4l") {
                assert_eq!(code, Some(6), "{said}");
                assert!(said.contains("/dev/no-such-video is not there"), "{said}");
            } else {
                assert_eq!(code, Some(2), "{said}");
                assert!(said.contains("--features v4l"), "{said}");
            }
        },
    );
}
