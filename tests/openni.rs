//! Sensors and recordings through the real OpenNI2, with a virtual sensor behind it.
#![cfg(target_os = "linux")]

mod common;

use common::recording::small_demo;
use common::text;
use common::virtual_sensor::{Played, TWO_CAMERAS, installed, scenario, with_sensor};
use kinlight::capture::live::{DeviceError, LiveDevice, LiveDriver};
use kinlight::capture::openni::{OniFiles, OniOptions, OniSource, OpenniDriver, OpenniOptions};
use kinlight::capture::{Calibration, FrameSource, RawFrame, Registration};
use kinlight::image::{Image, Size};
use std::path::Path;
use std::time::{Duration, Instant};

const SIZE: [usize; 2] = [64, 48];
const FRAMES: usize = 12;
const SOON: Duration = Duration::from_secs(5);
const USUAL: &str = "fov 1.0 0.8\nregistration yes\n";

fn noise() -> Played {
    Played::noise(SIZE, SIZE, FRAMES)
}

fn open(options: OpenniOptions) -> Result<Box<dyn LiveDevice>, DeviceError> {
    OpenniDriver::new(None, options).open()
}

/// The device's time of a frame, as the sensor makes it.
fn time_s(frame: usize, fps: i64) -> f64 {
    (1_000_000 + frame as i64 * 1_000_000 / fps) as f64 / 1e6
}

/// Depth and colour are what was played, bit for bit.
fn same(frame: &RawFrame, played: &Played, index: usize, per_metre: f32) {
    let (depth, color) = &played.frames[index];
    let depth_m: Vec<f32> = depth.iter().map(|&d| f32::from(d) / per_metre).collect();
    assert_eq!(frame.depth_m.as_slice(), depth_m, "depth of frame {index}");
    assert_eq!(frame.color.as_slice(), color, "colour of frame {index}");
}

fn next(device: &mut dyn LiveDevice) -> Result<RawFrame, DeviceError> {
    device.wait(SOON).map(|f| f.expect("a frame in time"))
}

/// Nothing more comes, and that is found out in time.
fn silent(device: &mut dyn LiveDevice) {
    let (patience, started) = (Duration::from_millis(300), Instant::now());
    assert!(device.wait(patience).expect("no error").is_none());
    let waited = started.elapsed();
    assert!(waited >= patience && waited < Duration::from_secs(2), "{waited:?}");
}

fn notes(device: &dyn LiveDevice) -> String {
    device.info().notes.join("\n")
}

#[test]
fn frames_camera_and_times_are_the_sensors() {
    scenario(
        "frames_camera_and_times_are_the_sensors",
        |folder| noise().write(folder, USUAL),
        |_| {
            let before = std::env::current_dir().unwrap();
            let mut device = open(OpenniOptions::default()).unwrap();
            assert_eq!(std::env::current_dir().unwrap(), before);
            let info = device.info();
            assert_eq!(
                (info.uri.as_str(), info.vendor.as_str()),
                ("virtual://kinlight", "kinlight")
            );
            assert_eq!(info.modes, ["depth: 64x48 depth in mm, 30/s", "colour: 64x48 RGB, 30/s"]);
            assert!(notes(&*device).contains("registered to colour by the device"));
            assert!(notes(&*device).contains("paired by their times"));
            let camera = device.camera();
            assert_eq!((camera.width, camera.height, camera.cx, camera.cy), (64, 48, 31.5, 23.5));
            let focal =
                [(32.0 / 0.5f64.tan()) as f32, (24.0 / (0.5 * f64::from(0.8f32)).tan()) as f32];
            assert_eq!([camera.fx, camera.fy], focal);
            for k in 0..FRAMES {
                let frame = next(&mut *device).unwrap();
                assert_eq!((frame.index, frame.timestamp_s), (k, time_s(k, 30)));
                same(&frame, &noise(), k, 1000.0);
            }
            silent(&mut *device);
            // Closed and opened again in the same process.
            drop(device);
            let mut again = open(OpenniOptions::default()).unwrap();
            same(&next(&mut *again).unwrap(), &noise(), 0, 1000.0);
        },
    );
}

#[test]
fn in_real_time_no_frame_is_another() {
    scenario(
        "in_real_time_no_frame_is_another",
        |folder| {
            let script = format!("{USUAL}pace clock\nsync yes\noffset-us 4000\n");
            Played::noise(SIZE, SIZE, 45).write(folder, &script);
        },
        |_| {
            let played = Played::noise(SIZE, SIZE, 45);
            let mut device = open(OpenniOptions::default()).unwrap();
            assert!(notes(&*device).contains("synchronised by the device"));
            let mut seen = Vec::new();
            while let Some(frame) = device.wait(Duration::from_millis(500)).unwrap() {
                let k = ((frame.timestamp_s - 1.004) * 30.0).round() as usize;
                assert!((frame.timestamp_s - time_s(k, 30) - 0.004).abs() < 1e-9);
                same(&frame, &played, k, 1000.0);
                seen.push(k);
            }
            assert!(seen.windows(2).all(|w| w[0] < w[1]), "{seen:?}");
            // A busy machine may read late, and the library keeps only the newest frame.
            assert!(seen.len() > 5, "{seen:?}");
        },
    );
}

#[test]
fn units_rates_and_mirroring_are_the_devices() {
    scenario(
        "units_rates_and_mirroring_are_the_devices",
        |folder| {
            noise().write(folder, &format!("{USUAL}depth-format 100um\nmirror-stuck yes\n"));
        },
        |_| {
            let options = OpenniOptions { fps: Some(15), ..OpenniOptions::default() };
            let mut device = open(options).unwrap();
            assert_eq!(device.info().modes[0], "depth: 64x48 depth in 0.1 mm, 15/s");
            assert!(notes(&*device).contains("colour stays mirrored"));
            for k in 0..FRAMES {
                let frame = next(&mut *device).unwrap();
                assert_eq!(frame.timestamp_s, time_s(k, 15));
                same(&frame, &noise(), k, 10_000.0);
            }
            drop(device);
            let none = OpenniOptions { size: Some([640, 480]), ..OpenniOptions::default() };
            let error = open(none).err().expect("no such mode");
            assert!(matches!(error, DeviceError::Unsupported(_)), "{error:?}");
            assert!(error.to_string().contains("64x48 RGB, 15/s"), "{error}");
        },
    );
}

/// A smooth surface, which registration does not tear.
fn slope(count: usize) -> Played {
    let mut played = Played::noise([32, 24], SIZE, count);
    for (k, (depth, _)) in played.frames.iter_mut().enumerate() {
        for (i, d) in depth.iter_mut().enumerate() {
            *d = (1000 + 10 * k + 7 * (i % 32) + 3 * (i / 32)) as u16;
        }
    }
    played
}

#[test]
fn without_the_devices_registration_the_calibrations_is_used() {
    scenario(
        "without_the_devices_registration_the_calibrations_is_used",
        |folder| {
            slope(3).write(folder, "fov 1.0 0.8\n");
            std::fs::write(folder.join("two.toml"), TWO_CAMERAS).unwrap();
        },
        |folder| {
            let known = Calibration::from_toml(TWO_CAMERAS).unwrap();
            let path = Some(folder.join("two.toml"));
            let options = OpenniOptions { calibration: path, ..OpenniOptions::default() };
            let mut device = open(options).unwrap();
            assert!(notes(&*device).contains("registered to colour here"));
            assert_eq!(device.camera(), known.color.pinhole());
            let transform = known.color_from_depth.unwrap().pose().unwrap();
            let depth = known.depth.unwrap();
            let mut expected = Registration::new(&depth, known.color.pinhole(), &transform);
            for k in 0..3 {
                let frame = next(&mut *device).unwrap();
                let metres = slope(3).frames[k].0.iter().map(|&d| f32::from(d) / 1000.0).collect();
                let mut out = Image::default();
                expected.register(&Image::from_vec(Size::new(32, 24), metres), &mut out);
                assert!(out.as_slice().iter().filter(|&&d| d > 0.0).count() > 2000);
                assert_eq!(frame.depth_m, out);
            }
            drop(device);
            let device = open(OpenniOptions::default()).unwrap();
            assert!(notes(&*device).contains("depth is not registered to colour"));
        },
    );
}

#[test]
fn exposure_is_held_where_the_device_can() {
    for (name, lock, said) in [
        ("exposure_is_held_where_the_device_can", "yes", "are held since frame 1"),
        (
            "exposure_is_held_where_the_device_can",
            "no",
            "exposure and white balance cannot be held",
        ),
    ] {
        scenario(
            name,
            |folder| {
                noise().write(folder, &format!("{USUAL}lock {lock}\n"));
                std::fs::write(folder.join("said"), said).unwrap();
            },
            |folder| {
                let said = std::fs::read_to_string(folder.join("said")).unwrap();
                let after = Some(Duration::from_millis(20));
                let options =
                    OpenniOptions { hold_exposure_after: after, ..OpenniOptions::default() };
                let mut device = open(options).unwrap();
                next(&mut *device).unwrap();
                assert!(!notes(&*device).contains("held"), "{}", notes(&*device));
                std::thread::sleep(Duration::from_millis(30));
                next(&mut *device).unwrap();
                assert!(notes(&*device).contains(&said), "{}", notes(&*device));
            },
        );
    }
}

/// The first frames of the demo, every fourth pixel.
fn demo() -> Played {
    Played::of(&small_demo(6))
}

#[test]
fn a_recording_plays_what_was_recorded() {
    scenario(
        "a_recording_plays_what_was_recorded",
        |folder| demo().write(folder, USUAL),
        |folder| {
            let (played, file) = (demo(), folder.join("room.oni"));
            let record = Some(OniFiles::new(&file));
            let mut device = open(OpenniOptions { record, ..OpenniOptions::default() }).unwrap();
            // The library's recorder starts on a thread of its own.
            std::thread::sleep(Duration::from_millis(500));
            let camera = device.camera();
            for _ in &played.frames {
                next(&mut *device).unwrap();
            }
            drop(device);

            let mut source = OniSource::open(&file, &OniOptions::default()).unwrap();
            let second = OniSource::open(&file, &OniOptions::default()).unwrap_err();
            assert!(second.to_string().contains("once at a time"), "{second}");
            assert_eq!(source.info().counts, [played.frames.len(); 2]);
            assert_eq!(source.len(), Some(played.frames.len()));
            assert_eq!(source.camera(), camera);
            for k in 0..played.frames.len() {
                let frame = source.next_frame().unwrap().expect("as many as were recorded");
                same(&frame, &played, k, 1000.0);
                assert_eq!(frame.index, k);
                let since_first = time_s(k, 30) - time_s(0, 30);
                assert!((frame.timestamp_s - since_first).abs() < 1e-9, "{}", frame.timestamp_s);
            }
            assert!(source.next_frame().unwrap().is_none());
            // Backwards, onwards, past the end.
            for k in [2, 3, 5, 0] {
                same(&source.frame(k).unwrap(), &played, k, 1000.0);
            }
            let beyond = source.frame(6).unwrap_err().to_string();
            assert!(beyond.contains("ends after 6 pairs"), "{beyond}");

            as_the_program_sees_it(folder, &file);
            drop(source);
            again_and_again(&file, &played);
            broken_files(&file, &played);
        },
    );
}

/// Runs the program with the sensor; gives its result.
fn program(folder: &Path, args: &[&str]) -> serde_json::Value {
    let program = Path::new(env!("CARGO_BIN_EXE_kinlight"));
    let output = with_sensor(program, folder).args(args).arg("--json").output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{args:?}: {said}");
    serde_json::from_slice(&output.stdout).unwrap()
}

fn as_the_program_sees_it(folder: &Path, file: &Path) {
    let report = program(folder, &["info", text(file)]);
    assert_eq!(report["info"]["pairs"], 6);
    assert_eq!(report["info"]["layout"], "oni");
    assert_eq!(report["frames_looked_at"], serde_json::json!([0, 1, 5]));
    let out = folder.join("out");
    let replay = ["replay", text(file), "--preset", "ours-fast", "--backend", "cpu"];
    let result =
        program(folder, &[&replay[..], &["--frames", "1..5", "--out", text(&out)]].concat());
    assert_eq!((&result["frames"], &result["skipped"]), (&4.into(), &serde_json::json!([])));
}

#[test]
fn a_stream_from_a_sensor_is_the_replay_of_its_recording_bit_for_bit() {
    scenario(
        "a_stream_from_a_sensor_is_the_replay_of_its_recording_bit_for_bit",
        |folder| demo().write(folder, USUAL),
        |folder| {
            let [recorded, streamed, replayed] =
                ["recorded", "streamed", "replayed"].map(|name| folder.join(name));
            let all = ["--device", "openni", "--every-frame", "--frames", "6", "--out"];
            let compute = ["--preset", "ours-fast", "--backend", "cpu"];
            let record = [&["record"], &all[..], &[text(&recorded)]].concat();
            assert_eq!(program(folder, &record)["frames"], 6);
            let stream = [&["stream"], &all[..], &[text(&streamed)], &compute].concat();
            assert_eq!(program(folder, &stream)["frames"], 6);
            let replay = ["replay", text(&recorded), "--out", text(&replayed)];
            program(folder, &[&replay[..], &compute].concat());
            for file in ["light.jsonl", "trajectory.txt", "mesh.ply"] {
                let [a, b] = [&streamed, &replayed].map(|at| std::fs::read(at.join(file)).unwrap());
                assert!(a == b, "{file} differs");
            }
        },
    );
}

/// The player's thread does not outlive what it plays for: closed at once, midway and at the end.
fn again_and_again(file: &Path, played: &Played) {
    for round in 0..12 {
        let mut source = OniSource::open(file, &OniOptions::default()).unwrap();
        for k in 0..[0, 3, 6][round % 3] {
            same(&source.next_frame().unwrap().expect("a frame"), played, k, 1000.0);
        }
    }
}

/// Emptied, something else, and cut off: an error or fewer frames, never a crash, a wait without end or
/// frames that are not there.
fn broken_files(file: &Path, played: &Played) {
    let bytes = std::fs::read(file).unwrap();
    let broken = file.with_file_name("broken.oni");
    for content in [&[][..], b"no recording at all"] {
        std::fs::write(&broken, content).unwrap();
        let error = OniSource::open(&broken, &OniOptions::default()).unwrap_err().to_string();
        assert!(error.contains("broken.oni") && error.contains("no .oni recording"), "{error}");
    }
    // The index is written last: without it nothing plays. (Behind it the recorder leaves as much again.)
    let mut refused = 0;
    for eighths in 1..8 {
        std::fs::write(&broken, &bytes[..bytes.len() * eighths / 8]).unwrap();
        match OniSource::open(&broken, &OniOptions::default()) {
            Ok(mut source) => {
                let mut frames = 0;
                while let Some(frame) = source.next_frame().unwrap() {
                    same(&frame, played, frames, 1000.0);
                    frames += 1;
                }
                assert_eq!(frames, played.frames.len(), "cut behind the index: {eighths}/8");
            }
            Err(error) => {
                assert!(error.to_string().contains("without its index"), "{error}");
                refused += 1;
            }
        }
    }
    assert!(refused >= 3, "{refused}");
    // A hole in the middle: what plays ends, and no frame comes twice.
    let mut holed = bytes;
    let quarter = holed.len() / 4;
    holed[quarter - 9_000..quarter + 90_000].fill(0);
    std::fs::write(&broken, &holed).unwrap();
    let mut source = OniSource::open(&broken, &OniOptions::default()).unwrap();
    let mut times = Vec::new();
    while let Some(frame) = source.next_frame().unwrap() {
        times.push(frame.timestamp_s);
    }
    assert!(times.len() < 6 && times.windows(2).all(|w| w[0] < w[1]), "{times:?}");
    let absent = OniSource::open(&file.with_file_name("none.oni"), &OniOptions::default());
    assert!(absent.unwrap_err().to_string().contains("No such file"));
}

#[test]
fn a_sensor_that_is_not_there_or_taken_is_said_so() {
    for (fault, absent) in [("absent", true), ("busy", false)] {
        scenario(
            "a_sensor_that_is_not_there_or_taken_is_said_so",
            |folder| {
                noise().write(folder, &format!("{USUAL}fault {fault}\n"));
                std::fs::write(folder.join("absent"), absent.to_string()).unwrap();
            },
            |folder| {
                let absent = std::fs::read_to_string(folder.join("absent")).unwrap() == "true";
                for uri in [None, Some("virtual://kinlight".to_owned())] {
                    let error = OpenniDriver::new(uri, OpenniOptions::default()).open();
                    match error.err().expect("it cannot be opened") {
                        DeviceError::Absent(_) if absent => {}
                        DeviceError::Busy(why) if !absent => {
                            assert!(why.contains("other programs"))
                        }
                        other => panic!("{other:?}"),
                    }
                }
                let other = Some("virtual://other".to_owned());
                let error = OpenniDriver::new(other, OpenniOptions::default()).open();
                let error = error.err().expect("there is no such device");
                assert!(matches!(error, DeviceError::Absent(_)), "{error:?}");
            },
        );
    }
}

#[test]
fn an_unplugged_sensor_is_lost_and_comes_back() {
    scenario(
        "an_unplugged_sensor_is_lost_and_comes_back",
        |folder| noise().write(folder, &format!("{USUAL}fault unplug 5 400\n")),
        |folder| {
            let files = OniFiles::new(folder.join("room.oni"));
            let record = Some(files.clone());
            let mut driver =
                OpenniDriver::new(None, OpenniOptions { record, ..OpenniOptions::default() });
            let mut device = driver.open().unwrap();
            for k in 0..5 {
                same(&next(&mut *device).unwrap(), &noise(), k, 1000.0);
            }
            let started = Instant::now();
            let error = device.wait(SOON).unwrap_err();
            assert!(matches!(error, DeviceError::Lost(_)), "{error:?}");
            assert!(started.elapsed() < Duration::from_secs(2), "{:?}", started.elapsed());
            drop(device);
            let error = driver.open().err().expect("it is not back yet");
            assert!(matches!(error, DeviceError::Absent(_)), "{error:?}");
            std::thread::sleep(Duration::from_millis(800));
            let mut device = driver.open().expect("it is back");
            for k in 0..FRAMES {
                same(&next(&mut *device).unwrap(), &noise(), k, 1000.0);
            }
            drop(device);
            assert_eq!(files.begun(), ["room.oni", "room-2.oni"].map(|name| folder.join(name)));
            assert!(files.begun().iter().all(|file| file.is_file()));
        },
    );
}

#[test]
fn a_sensor_that_stalls_keeps_no_one_waiting() {
    scenario(
        "a_sensor_that_stalls_keeps_no_one_waiting",
        |folder| noise().write(folder, &format!("{USUAL}fault stall 3\n")),
        |_| {
            let mut device = open(OpenniOptions::default()).unwrap();
            for k in 0..3 {
                same(&next(&mut *device).unwrap(), &noise(), k, 1000.0);
            }
            silent(&mut *device);
            silent(&mut *device);
            let started = Instant::now();
            drop(device);
            assert!(started.elapsed() < Duration::from_secs(2), "{:?}", started.elapsed());
        },
    );
}

#[test]
fn one_bad_frame_costs_one_frame() {
    for (fault, said) in
        [("half 4", "3072 of 6144 bytes"), ("stride 4", "6144 of 6426 bytes"), ("no-color 4", "")]
    {
        scenario(
            "one_bad_frame_costs_one_frame",
            |folder| {
                noise().write(folder, &format!("{USUAL}fault {fault}\n"));
                std::fs::write(folder.join("said"), said).unwrap();
            },
            |folder| {
                let said = std::fs::read_to_string(folder.join("said")).unwrap();
                let mut device = open(OpenniOptions::default()).unwrap();
                for k in 0..FRAMES {
                    if k == 4 {
                        if said.is_empty() {
                            continue;
                        }
                        let error = next(&mut *device).unwrap_err();
                        assert!(matches!(error, DeviceError::BadFrame(_)), "{error:?}");
                        assert!(error.to_string().contains(&said), "{error}");
                    } else {
                        let frame = next(&mut *device).unwrap();
                        assert_eq!(frame.timestamp_s, time_s(k, 30));
                        same(&frame, &noise(), k, 1000.0);
                    }
                }
                silent(&mut *device);
            },
        );
    }
}

#[test]
fn a_clock_that_jumps_is_said_and_times_go_on() {
    for by_us in [-700_000, 90_000_000] {
        scenario(
            "a_clock_that_jumps_is_said_and_times_go_on",
            |folder| {
                noise().write(folder, &format!("{USUAL}fault jump 6 {by_us}\n"));
                std::fs::write(folder.join("by"), format!("{:.3}", f64::from(by_us) * 1e-6))
                    .unwrap();
            },
            |folder| {
                let by = std::fs::read_to_string(folder.join("by")).unwrap();
                let mut device = open(OpenniOptions::default()).unwrap();
                for k in 0..FRAMES {
                    let frame = next(&mut *device).unwrap();
                    same(&frame, &noise(), k, 1000.0);
                    // Microseconds are cut off in each step.
                    let late = frame.timestamp_s - time_s(k, 30);
                    assert!(late.abs() < 1e-5, "frame {k}: {late}");
                }
                let jumps = notes(&*device).matches(&format!("clock jumped by {by}")).count();
                assert_eq!(jumps, 2, "of either stream: {}", notes(&*device));
            },
        );
    }
}

#[test]
fn a_missing_library_is_said_with_its_package() {
    // Its own process: this one may have loaded OpenNI2.
    let empty = tempfile::tempdir().unwrap();
    let file = empty.path().join("room.oni");
    std::fs::write(&file, b"").unwrap();
    let program = Path::new(env!("CARGO_BIN_EXE_kinlight"));
    let info = |folder: &Path| {
        let output = with_sensor(program, folder).args(["info", text(&file)]).output().unwrap();
        assert_eq!(output.status.code(), Some(3));
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    let said = info(empty.path());
    assert!(said.contains("libopenni2-0") && said.contains(text(empty.path())), "{said}");
    // A file of that name that is no library.
    std::fs::write(empty.path().join("libOpenNI2.so.0"), b"no library").unwrap();
    let said = info(empty.path());
    assert!(said.contains("libopenni2-0") && said.contains("cannot be loaded"), "{said}");
    // The library without drivers.
    if let Some(installed) = installed() {
        let library = "libOpenNI2.so.0";
        std::fs::copy(installed.join(library), empty.path().join(library)).unwrap();
        let said = info(empty.path());
        assert!(said.contains("OpenNI2/Drivers"), "{said}");
    }
}

#[test]
fn a_library_without_drivers_stays_without() {
    scenario(
        "a_library_without_drivers_stays_without",
        |folder| std::fs::remove_dir_all(folder.join("OpenNI2")).unwrap(),
        |_| {
            for _ in 0..2 {
                let error = open(OpenniOptions::default()).err().expect("there is no driver");
                assert!(matches!(error, DeviceError::NoDriver(_)), "{error:?}");
                assert!(error.to_string().contains("OpenNI2/Drivers"), "{error}");
            }
        },
    );
}
