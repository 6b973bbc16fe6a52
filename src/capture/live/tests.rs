//! Sources on devices that fail in every way.

use super::scripted::{Act, Script};
use super::*;
use crate::capture::writer::{ColorFormat, DepthCompression, FrameRef, TumWriter};
use crate::capture::{CaptureError, FrameSource, RawFrame};
use crate::image::{Image, Size};
use crate::math::Pinhole;
use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

const fn ms(n: u64) -> Duration {
    Duration::from_millis(n)
}

fn every() -> LiveOptions {
    LiveOptions {
        delivery: Delivery::Every,
        stall: ms(150),
        first_frame: ms(150),
        reopen_first: ms(5),
        reopen_longest: ms(40),
        ..LiveOptions::default()
    }
}

fn newest() -> LiveOptions {
    LiveOptions { delivery: Delivery::Newest { capacity: 2 }, ..every() }
}

fn open(script: &Script, options: LiveOptions) -> LiveSource {
    LiveSource::open(script.driver(), options).unwrap()
}

fn all(source: &mut LiveSource) -> Vec<RawFrame> {
    std::iter::from_fn(|| source.next_frame().unwrap()).collect()
}

fn times(frames: &[RawFrame]) -> Vec<f64> {
    frames.iter().map(|f| f.timestamp_s).collect()
}

fn lost() -> Act {
    Act::Fail(DeviceError::Lost("unplugged".into()))
}

/// Waits until `done`, for at most two seconds.
fn until(what: &str, done: impl Fn() -> bool) {
    let deadline = Instant::now() + ms(2000);
    while !done() {
        assert!(Instant::now() < deadline, "{what}");
        std::thread::sleep(ms(2));
    }
}

#[test]
fn every_frame_comes_in_order_with_the_devices_times() {
    let given: Vec<f64> = (0..200).map(|i| 1e9 + f64::from(i) / 30.0).collect();
    let script = Script::new(Script::frames(given.clone()));
    let mut source = open(&script, every());
    let frames = all(&mut source);
    assert_eq!(times(&frames), given);
    assert!(frames.iter().enumerate().all(|(i, f)| f.index == i));
    let counts = source.counts();
    assert_eq!((counts.captured, counts.delivered, counts.dropped), (200, 200, 0));
    assert_eq!((counts.outages, counts.bad, counts.clock_jumps), (0, 0, 0));
    assert!(source.next_frame().unwrap().is_none(), "the end stays");
}

#[test]
fn the_newest_frames_are_kept_and_the_others_counted() {
    let script = Script::new(Script::frames((0..50).map(f64::from)));
    // one second a frame by the device, none by the host: no jump for a recording, so not asked here
    let options = LiveOptions { stall: ms(5000), ..newest() };
    let mut source = open(&script, options);
    until("all captured", || source.counts().captured == 50);
    let frames = all(&mut source);
    assert_eq!(frames.len(), 2);
    assert_eq!(frames.iter().map(|f| f.index).collect::<Vec<_>>(), [0, 1]);
    let counts = source.counts();
    assert_eq!((counts.delivered, counts.dropped), (2, 48));
    assert!(frames[1].timestamp_s > frames[0].timestamp_s);
}

#[test]
fn a_frames_age_is_that_since_its_arrival_and_waiting_is_told_apart() {
    let script = Script::new([Act::Frame(0.0), Act::Silence(ms(80)), Act::Frame(0.08)]);
    let mut source = open(&script, newest());
    until("captured", || source.counts().captured == 1);
    std::thread::sleep(ms(30));
    source.next_frame().unwrap().unwrap();
    let first = source.arrival().unwrap();
    assert!(first.age >= ms(30) && first.waited < ms(25), "{first:?}");
    source.next_frame().unwrap().unwrap();
    let second = source.arrival().unwrap();
    assert!(second.waited >= ms(20) && second.age < ms(25), "{second:?}");
}

#[test]
fn a_lost_device_is_opened_again_until_it_is_back() {
    let acts = [Act::Frame(1.0), lost(), Act::Frame(1.1), lost(), Act::Frame(1.2)];
    let script = Script::new(acts);
    let mut source = open(&script, every());
    let absent = DeviceError::Absent("nothing there".into());
    script.openings.lock().unwrap().extend([absent.clone(), absent]);
    assert_eq!(times(&all(&mut source)), [1.0, 1.1, 1.2]);
    let counts = source.counts();
    assert_eq!((counts.outages, counts.recoveries), (2, 2));
    assert_eq!(counts.attempts, 4, "two in vain");
    // 5 ms after the loss, then 10 and 20 after the attempts; 5 for the second loss
    assert!(counts.down_s >= 0.040, "{}", counts.down_s);
    assert_eq!(script.opened.load(Ordering::SeqCst), 3);
    drop(source);
    assert_eq!(script.closed.load(Ordering::SeqCst), 3, "devices are closed");
}

#[test]
fn a_stall_opens_the_device_again() {
    let script = Script::new([Act::Frame(1.0), Act::Silence(ms(100)), Act::Frame(1.1)]);
    let mut source = open(&script, every());
    assert_eq!(times(&all(&mut source)), [1.0, 1.1]);
    assert_eq!(source.counts().outages, 0, "100 ms are not 150");

    let script = Script::new([Act::Frame(1.0), Act::Silence(ms(10_000)), Act::Frame(1.1)]);
    let mut source = open(&script, every());
    source.next_frame().unwrap().unwrap();
    until("noticed", || source.counts().outages == 1);
    until("opened again", || script.opened.load(Ordering::SeqCst) >= 2);
    // opened again, it is silent as before
    assert_eq!(source.counts().recoveries, 0);
    assert!(source.monitor().is_down());
}

#[test]
fn the_first_frame_of_a_device_may_take_longer() {
    let script = Script::new([
        Act::Silence(ms(300)),
        Act::Frame(1.0),
        Act::Silence(ms(300)),
        Act::Frame(1.3),
    ]);
    let mut source = open(&script, LiveOptions { first_frame: ms(5000), ..every() });
    assert_eq!(source.next_frame().unwrap().unwrap().timestamp_s, 1.0);
    assert_eq!(source.counts().outages, 0);
    until("the second silence is a stall", || source.counts().outages == 1);
}

#[test]
fn an_opening_that_is_slow_is_waited_for() {
    let mut script = Script::new([Act::Frame(1.0), lost(), Act::Frame(1.1)]);
    script.opening = ms(900); // more than a stall and half a second
    let mut source = open(&script, every());
    assert_eq!(times(&all(&mut source)), [1.0, 1.1]);
    assert_eq!(source.counts().attempts, 1);
}

#[test]
fn a_queue_that_is_full_for_long_is_no_stall() {
    let script = Script::new(Script::frames((0..4).map(f64::from)));
    let mut source = open(&script, every());
    for i in 0..4 {
        std::thread::sleep(ms(200));
        assert_eq!(source.next_frame().unwrap().unwrap().timestamp_s, f64::from(i));
    }
    assert_eq!(source.counts().outages, 0);
}

#[test]
fn bad_frames_are_left_out_and_counted() {
    let bad = Act::Fail(DeviceError::BadFrame("cut off".into()));
    let acts = [
        Act::Frame(1.0),
        bad,
        Act::Small(1.1),
        Act::Frame(f64::NAN),
        Act::Frame(1.2),
        Act::Frame(1.2),
        Act::Frame(1.3),
    ];
    let mut source = open(&Script::new(acts), every());
    let frames = all(&mut source);
    assert_eq!(times(&frames), [1.0, 1.2, 1.3]);
    assert_eq!(frames[2].index, 2);
    assert_eq!((source.counts().bad, source.counts().captured), (4, 3));
    assert_eq!(source.counts().outages, 0);
}

#[test]
fn times_rise_when_the_clock_jumps() {
    let acts = Script::frames([10.0, 10.1, 3.0, 3.1]).chain([lost()]);
    let script = Script::new(acts.chain(Script::frames([0.0, 0.1])));
    let mut source = open(&script, every());
    let seen = times(&all(&mut source));
    assert_eq!(seen[..2], [10.0, 10.1]);
    assert!(seen.windows(2).all(|w| w[1] > w[0]), "{seen:?}");
    assert!((seen[3] - seen[2] - 0.1).abs() < 1e-9 && (seen[5] - seen[4] - 0.1).abs() < 1e-9);
    assert_eq!(source.counts().clock_jumps, 2);
}

#[test]
fn a_driver_that_does_not_return_is_left_behind_and_replaced() {
    let script = Script::new([Act::Frame(1.0), Act::Hang, Act::Frame(1.1), Act::Frame(1.2)]);
    let mut source = open(&script, every());
    assert_eq!(times(&all(&mut source)), [1.0, 1.1, 1.2]);
    let counts = source.counts();
    assert_eq!((counts.outages, counts.recoveries), (1, 1));
    script.release();
    until("the thread left behind closes its device", || script.closed.load(Ordering::SeqCst) == 2);
}

#[test]
fn a_driver_that_never_returns_ends_the_source_and_does_not_hold_its_end() {
    let script = Script::new([Act::Frame(1.0)].into_iter().chain([const { Act::Hang }; 9]));
    let mut source = open(&script, LiveOptions { stall: ms(10), ..every() });
    source.next_frame().unwrap().unwrap();
    let error = loop {
        match source.next_frame() {
            Ok(Some(_)) => {}
            Ok(None) => panic!("an end without a reason"),
            Err(error) => break error,
        }
    };
    assert!(error.to_string().contains("have not returned"), "{error}");
    let start = Instant::now();
    drop(source);
    assert!(start.elapsed() < ms(2000), "{:?}", start.elapsed());
    script.release();
}

#[test]
fn a_stop_takes_less_than_two_seconds_whatever_the_driver_does() {
    for act in [Act::Hang, Act::Silence(ms(60_000)), lost()] {
        let script = Script::new([Act::Frame(1.0), act]);
        let options = LiveOptions { stall: ms(60_000), reopen_first: ms(60_000), ..every() };
        let options = LiveOptions { reopen_longest: ms(60_000), ..options };
        let mut source = open(&script, options);
        source.next_frame().unwrap().unwrap();
        std::thread::sleep(ms(20)); // the second act has begun
        let monitor = source.monitor();
        let stopping = std::thread::spawn(move || {
            std::thread::sleep(ms(50));
            monitor.stop();
        });
        let start = Instant::now();
        assert!(source.next_frame().unwrap().is_none());
        drop(source);
        assert!(start.elapsed() < ms(2000), "{:?}", start.elapsed());
        stopping.join().unwrap();
        script.release();
    }
}

#[test]
fn the_first_opening_fails_at_once_and_says_why() {
    let script = Script::new([]);
    let absent = DeviceError::Absent("no camera 'x'".into());
    script.openings.lock().unwrap().push_back(absent);
    let error = LiveSource::open(script.driver(), every()).map(|_| ()).unwrap_err();
    assert_eq!(error.to_string(), "no camera 'x'");
}

#[test]
fn what_cannot_be_mended_ends_the_source() {
    let failed = |script: &Script, options: LiveOptions| {
        let mut source = open(script, options);
        source.next_frame().unwrap().unwrap();
        let error = source.next_frame().unwrap_err();
        assert!(matches!(error, CaptureError::Sequence(_)));
        assert!(source.next_frame().unwrap().is_none(), "said once");
        error.to_string()
    };
    let unsupported = Act::Fail(DeviceError::Unsupported("no such mode".into()));
    let error = failed(&Script::new([Act::Frame(1.0), unsupported]), every());
    assert!(error.contains("no such mode"), "{error}");

    let mut script = Script::new([Act::Frame(1.0), lost(), Act::Frame(1.1)]);
    script.other_camera = true;
    let error = failed(&script, every());
    assert!(error.contains("another camera"), "{error}");

    let error = failed(&Script::new([Act::Frame(1.0), Act::Panic]), every());
    assert!(error.contains("panicked"), "{error}");
}

#[test]
fn a_device_that_stays_away_ends_the_source_where_that_is_set() {
    let script = Script::new([Act::Frame(1.0), lost()]);
    let mut source = open(&script, LiveOptions { give_up_after: Some(ms(100)), ..every() });
    let gone = DeviceError::Absent("still unplugged".into());
    script.openings.lock().unwrap().extend(vec![gone; 1000]);
    source.next_frame().unwrap().unwrap();
    let start = Instant::now();
    let error = source.next_frame().unwrap_err().to_string();
    assert!(error.contains("still unplugged"), "{error}");
    assert!(start.elapsed() >= ms(90) && start.elapsed() < ms(1000), "{:?}", start.elapsed());
}

#[test]
fn frames_and_time_may_be_limited() {
    let script = Script::new(Script::frames((0..9).map(f64::from)));
    let mut source = open(&script, LiveOptions { most_frames: Some(3), ..every() });
    assert_eq!(all(&mut source).len(), 3);

    let script = Script::new([Act::Frame(0.0), Act::Silence(ms(60_000))]);
    let limits = LiveOptions { most_time: Some(ms(120)), stall: ms(60_000), ..every() };
    let start = Instant::now();
    assert_eq!(all(&mut open(&script, limits)).len(), 1);
    assert!(start.elapsed() >= ms(110) && start.elapsed() < ms(1500), "{:?}", start.elapsed());
}

/// 30 frames a second from 100 s on.
fn record(folder: &Path, frames: usize) {
    let camera = Pinhole { width: 4, height: 3, fx: 5.0, fy: 5.0, cx: 1.5, cy: 1.0 };
    let (color, compression) = (ColorFormat::Png, DepthCompression::Fast);
    let mut writer = TumWriter::create(folder, camera, color, compression).unwrap();
    for i in 0..frames {
        writer
            .push(&FrameRef {
                timestamp_s: 100.0 + i as f64 / 30.0,
                color: &Image::new(Size::new(4, 3), [i as u8; 3]),
                depth_m: &Image::new(Size::new(4, 3), 1.0),
                second_depth_m: None,
                world_from_camera: None,
            })
            .unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn a_played_camera_that_was_away_has_missed_what_happened() {
    let folder = tempfile::tempdir().unwrap();
    record(folder.path(), 45);
    let driver = PlayedDriver::new(folder.path(), true).losing_device_before(&[10]);
    let options = LiveOptions { delivery: Delivery::Newest { capacity: 100 }, ..newest() };
    let start = Instant::now();
    let mut source = LiveSource::open(Box::new(driver), options).unwrap();
    let frames = all(&mut source);
    // it is not shorter than its frames say
    assert!(start.elapsed() >= ms(44_000 / 30 - 50), "{:?}", start.elapsed());
    let number = |f: &RawFrame| usize::from(f.color.as_slice()[0][0]);
    for frame in &frames {
        assert!((frame.timestamp_s - 100.0 - number(frame) as f64 / 30.0).abs() < 1e-6);
    }
    let before = frames.iter().filter(|f| number(f) < 10).count();
    assert_eq!(before, 10);
    // away for 250 ms: seven frames or more
    assert!(number(&frames[10]) >= 17, "{}", number(&frames[10]));
    let counts = source.counts();
    assert_eq!((counts.outages, counts.recoveries, counts.clock_jumps), (1, 1, 0));
    assert!(counts.down_s >= 0.25, "{}", counts.down_s);
}

#[test]
fn a_played_recording_comes_whole_where_it_is_not_paced() {
    let folder = tempfile::tempdir().unwrap();
    record(folder.path(), 45);
    std::fs::write(folder.path().join("depth/100.500000.png"), b"broken").unwrap();
    let driver = PlayedDriver::new(folder.path(), false).losing_device_before(&[0, 20]);
    let mut source = LiveSource::open(Box::new(driver), every()).unwrap();
    let frames = all(&mut source);
    assert_eq!(frames.len(), 44);
    let counts = source.counts();
    assert_eq!((counts.bad, counts.outages, counts.dropped), (1, 2, 0));
}

#[test]
fn a_looped_recording_plays_forth_and_back_with_times_that_rise() {
    let folder = tempfile::tempdir().unwrap();
    record(folder.path(), 4);
    let driver = PlayedDriver::new(folder.path(), false).looped(true);
    let options = LiveOptions { most_frames: Some(10), ..every() };
    let mut source = LiveSource::open(Box::new(driver), options).unwrap();
    let frames = all(&mut source);
    let numbers: Vec<_> = frames.iter().map(|f| f.color.as_slice()[0][0]).collect();
    assert_eq!(numbers, [0, 1, 2, 3, 2, 1, 0, 1, 2, 3]);
    for (k, frame) in frames.iter().enumerate() {
        assert!((frame.timestamp_s - 100.0 - k as f64 / 30.0).abs() < 1e-5, "{frame:?}");
    }
    assert_eq!(source.counts().clock_jumps, 0);
}
