//! Faults of a depth sensor that streams in real time, through `kinlight record` and `kinlight stream` as a user
//! runs them: what is said, what is lost, how soon it goes on, and whether it ends when it should.
//!
//! The results are printed (`--nocapture`) and added to the file that `KINLIGHT_FAULT_TABLE` names, as Markdown.
#![cfg(target_os = "linux")]

mod common;
#[path = "sensor_faults/paced.rs"]
mod paced;
#[path = "sensor_faults/rig.rs"]
mod rig;
#[path = "sensor_faults/stops.rs"]
mod stops;
#[path = "sensor_faults/table.rs"]
mod table;

use common::process::{Ended, on_this_machine};
use rig::{Does, Event, PERIOD_MS, Rig, Seen, true_position_m};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Mutex;
use std::time::Duration;
use stops::{STATES, stops};
use table::{Row, markdown, publish};

/// In real time, as a sensor does it.
const REAL_TIME: &str = "pace clock\n";

/// Documented: an interrupt ends `stream` and `record` within this.
const STOP: Duration = Duration::from_secs(2);

/// The fault comes with this frame.
const FAULT: usize = 20;

/// Farther off, the camera would not be in the map of before: the volume's voxels are 3.1 cm wide.
const ANOTHER_PLACE_M: f64 = 0.03;

/// What is wrong, and what a run must make of it.
struct Fault {
    name: &'static str,
    script: String,
    /// Words of the line that the user sees; none where nothing is said.
    says: &'static [&'static str],
    effect: Effect,
}

#[derive(Clone, Copy, PartialEq)]
enum Effect {
    Nothing,
    /// The device is opened again, and plays from its first frame.
    Reopened,
    /// So many frames are no good.
    Bad(usize),
    /// Colour is missing this often, and depth finds no partner.
    Alone(usize),
}

fn faults() -> Vec<Fault> {
    let fault = |name, script: &str, says, effect| Fault {
        name,
        script: format!("{REAL_TIME}{script}"),
        says,
        effect,
    };
    vec![
        fault("none", "", &[], Effect::Nothing),
        fault(
            "unplugged for 1 s",
            "fault unplug 20 1000",
            &["camera lost: virtual://kinlight was unplugged; it is opened again"],
            Effect::Reopened,
        ),
        fault(
            "stalls",
            "fault stall 20",
            &["camera lost: no good frame for 2.", "; it is opened again"],
            Effect::Reopened,
        ),
        fault(
            "three frames with half of their bytes",
            "fault half 20\nfault half 23\nfault half 26",
            &["bad frame left out: frame ", "19200 of 38400 bytes"],
            Effect::Bad(3),
        ),
        fault(
            "three frames with a wrong stride",
            "fault stride 20\nfault stride 23\nfault stride 26",
            &["bad frame left out: frame ", "38400 of 39114 bytes"],
            Effect::Bad(3),
        ),
        fault(
            "three frames without colour",
            "fault no-color 20\nfault no-color 23\nfault no-color 26",
            &[],
            Effect::Alone(3),
        ),
        fault(
            "the clock jumps 90 s ahead",
            "fault jump 20 90000000",
            &["the device's clock jumped by 9", "times go on without"],
            Effect::Nothing,
        ),
        fault(
            "the clock jumps 0.7 s back",
            "fault jump 20 -700000",
            &["the device's clock jumped by -0.", "times go on without"],
            Effect::Nothing,
        ),
    ]
}

#[test]
fn what_a_sensor_does_wrong_costs_no_more_than_it_must() {
    let jobs: Vec<Job> = [Does::Record, Does::Stream]
        .into_iter()
        .flat_map(|does| {
            let recoverable =
                faults().into_iter().map(move |fault| job(move || survives(does, &fault)));
            let hopeless = [
                ("absent", "fault absent", "OpenNI2 sees no camera: is it plugged in"),
                ("taken by another program", "fault busy", "close other programs that use it"),
            ];
            let hopeless =
                hopeless.map(|(name, script, says)| job(move || refuses(does, name, script, says)));
            let stops = STATES.map(|state| job(move || stops(does, &state)));
            recoverable.chain(hopeless).chain([job(move || gives_up(does))]).chain(stops)
        })
        .collect();
    let rows = two_at_a_time(&jobs);
    if !rows.is_empty() {
        publish(&markdown(&rows));
    }
}

type Job = Box<dyn Fn() -> Option<Row> + Sync>;

fn job(work: impl Fn() -> Option<Row> + Sync + 'static) -> Job {
    Box::new(work)
}

/// They mostly wait.
fn two_at_a_time(jobs: &[Job]) -> Vec<Row> {
    let (next, rows) = (Mutex::new(0..jobs.len()), Mutex::new(BTreeMap::new()));
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                loop {
                    let taken = next.lock().unwrap().next();
                    let Some(i) = taken else { return };
                    if let Some(row) = jobs[i]() {
                        rows.lock().unwrap().insert(i, row);
                    }
                }
            });
        }
    });
    rows.into_inner().unwrap().into_values().collect()
}

/// What concerns the camera of what was said.
fn sees(ended: &Ended) -> Vec<String> {
    let loud = |l: &&str| {
        ["[WARN", "[ERROR", "kinlight:"].iter().any(|start| l.starts_with(start))
            || l.contains("camera back")
    };
    let mut lines: Vec<String> = Vec::new();
    for line in ended.stderr.lines().filter(loud) {
        if !lines.iter().any(|l| l == line) {
            lines.push(line.to_owned());
        }
    }
    lines
}

/// Ended by an interrupt, in time, as a success.
fn stopped(ended: &Ended, what: &str) -> f64 {
    ended.succeeded();
    let bound = on_this_machine(STOP);
    assert!(ended.took < bound, "{what}: {:?} of {bound:?}", ended.took);
    ended.took.as_secs_f64()
}

/// The run goes on after the fault.
fn survives(does: Does, fault: &Fault) -> Option<Row> {
    let rig = Rig::new(does, &fault.script)?;
    let mut run = rig.start(&[]);
    let mut before = BTreeMap::new();
    if fault.effect == Effect::Reopened {
        run.until("the fault", || last_before_gap(&rig.log()));
        std::thread::sleep(Duration::from_millis(300));
        before = rig.files();
        run.until("the device is back", || opened_again(&rig.log()).is_some_and(|e| e.len() > 4));
        let written = rig.written();
        run.until("frames after the fault", || rig.written() >= written + 4);
    } else {
        run.until("the faults", || rig.happened("frame", FAULT + 7));
        let written = rig.written();
        run.until("frames after them", || rig.written() >= written + 3);
    }
    run.signal("-INT");
    let ended = run.end();
    let what = format!("{}, {}", does.name(), fault.name);
    let stop_s = stopped(&ended, &what);
    for words in fault.says {
        ended.line(words);
    }
    rig.still_has(&before);

    let (seen, log) = (rig.seen(), rig.log());
    let live = &ended.json()["live"];
    let count = |key: &str| live[key].as_u64().unwrap() as usize;
    let parts = in_parts(&seen);
    let mut off_m = None;
    match fault.effect {
        Effect::Reopened => {
            assert_eq!(parts.len(), 2, "{what}: {seen:?}");
            assert_eq!((count("outages"), count("recoveries")), (1, 1), "{live}");
            if does == Does::Stream {
                off_m = Some(the_map_survives(&parts, &what));
            }
        }
        _ => {
            assert_eq!(parts.len(), 1, "{what}: {seen:?}");
            assert_eq!(count("outages"), 0, "{what}: {live}");
            // Whatever the clock does, frames are as far apart as they are; where those at the jump were
            // read late, the time between them is not known.
            let (first, last) = (&seen[0], &seen[seen.len() - 1]);
            let passed_s = last.time_s - first.time_s;
            let played_s = (last.played - first.played) as f64 * PERIOD_MS / 1e3;
            let at_jump = seen.windows(2).find(|w| w[1].played >= FAULT).expect("frames after it");
            let unknown_s = (at_jump[1].played - at_jump[0].played - 1) as f64 * PERIOD_MS / 1e3;
            let off_s = (passed_s - played_s).abs();
            assert!(off_s < 1e-3 + unknown_s, "{what}: {passed_s} s for {played_s} s");
        }
    }
    let broken = [FAULT, FAULT + 3, FAULT + 6];
    let (bad, alone) = match fault.effect {
        Effect::Bad(n) => (n, 0),
        Effect::Alone(n) => (0, n),
        _ => (0, 0),
    };
    if bad + alone > 0 {
        assert!(!seen.iter().any(|s| broken.contains(&s.played)), "{what}: {seen:?}");
    }
    // A busy machine may read late: the library keeps only the newest.
    assert!(count("bad") <= bad && (bad == 0 || count("bad") > 0), "{what}: {live}");
    let lost = missing(&parts);
    let replaced = count("dropped") + dropped_writing(&ended);
    let frames = format!(
        "{} of {}{}{}{}",
        seen.len(),
        seen.len() + lost,
        told(bad + alone, "broken"),
        told(replaced, "dropped for newer ones"),
        off_m.map_or(String::new(), |m| format!("; after it off by {:.0} mm at most", m * 1e3)),
    );
    let recovery_ms = (fault.effect == Effect::Reopened).then(|| recovery_ms(&log));
    Some(Row {
        fault: fault.name.into(),
        command: does.name(),
        sees: sees(&ended),
        exit: ended.code(),
        recovery_ms,
        frames,
        stop_s: Some(stop_s),
    })
}

fn told(count: usize, what: &str) -> String {
    if count > 0 { format!("; {count} {what}") } else { String::new() }
}

fn dropped_writing(ended: &Ended) -> usize {
    ended.json()["dropped_writing"].as_u64().unwrap_or(0) as usize
}

/// The frame before the fault is given, and none came for a while.
fn last_before_gap(log: &[Event]) -> bool {
    log.iter().any(|e| e.what == "unplug" || (e.what == "frame" && e.frame == FAULT - 1))
}

/// Frames since the device was opened the second time.
fn opened_again(log: &[Event]) -> Option<Vec<&Event>> {
    let again = log.iter().position(|e| e.what == "open" && e.frame == 1)?;
    Some(log[again..].iter().filter(|e| e.what == "frame").collect())
}

/// From the fault (unplugged, or the first frame due that did not come) to the next frame.
fn recovery_ms(log: &[Event]) -> f64 {
    let unplugged = log.iter().find(|e| e.what == "unplug").map(|e| e.at_us as f64 / 1e3);
    let last =
        log.iter().find(|e| e.what == "frame" && e.frame == FAULT - 1).expect("it was given");
    let began_ms = unplugged.unwrap_or(last.at_us as f64 / 1e3 + PERIOD_MS);
    opened_again(log).expect("it was opened again")[0].at_us as f64 / 1e3 - began_ms
}

/// The device begins with its first frame when it is opened: a part for each opening.
fn in_parts(seen: &[Seen]) -> Vec<&[Seen]> {
    seen.chunk_by(|a, b| a.played < b.played).collect()
}

/// Frames that the sensor gave between the first and the last that came through.
fn missing(parts: &[&[Seen]]) -> usize {
    let gaps = |part: &&[Seen]| {
        let first = part[0].played;
        part.last().expect("not empty").played + 1 - first - part.len()
    };
    parts.iter().map(gaps).sum()
}

/// Tracking goes on in the same world: after the fault, too, the camera is where it truly is, in the axes of the first
/// frame of all. Gives the distance of the worst frame.
fn the_map_survives(parts: &[&[Seen]], what: &str) -> f64 {
    let [before, after] = parts else { panic!("two parts") };
    assert_eq!(after.last().expect("frames").state, "tracking", "{what}: {after:?}");
    let off_m = |seen: &Seen| {
        let there = true_position_m(before[0].played, seen.played);
        let squares = |here: [f64; 3]| (0..3).map(|i| (here[i] - there[i]).powi(2)).sum::<f64>();
        seen.position_m.map(|here| squares(here).sqrt())
    };
    let worst_m = |part: &[Seen]| part.iter().filter_map(off_m).fold(0.0, f64::max);
    let (then_m, now_m) = (worst_m(before), worst_m(after));
    println!("{what}: off by at most {:.1} mm before, {:.1} mm after", then_m * 1e3, now_m * 1e3);
    assert!(after.iter().any(|s| s.position_m.is_some()) && now_m < ANOTHER_PLACE_M, "{what}");
    now_m
}

/// A sensor that cannot be opened is an error at once, and leaves nothing behind.
fn refuses(does: Does, name: &str, script: &str, says: &str) -> Option<Row> {
    let rig = Rig::new(does, &format!("{REAL_TIME}{script}"))?;
    let ended = rig.start(&[]).end();
    assert_eq!(ended.code(), 6, "{}", ended.stderr);
    ended.line(says);
    let message = ended.json()["error"]["message"].as_str().expect("a message").to_owned();
    assert!(message.contains(says), "{message}");
    assert!(!rig.out().exists(), "nothing is written");
    Some(Row {
        fault: name.into(),
        command: does.name(),
        sees: sees(&ended),
        exit: ended.code(),
        recovery_ms: None,
        frames: "-".into(),
        stop_s: None,
    })
}

/// Without a limit the run waits; with one, the camera that stays away is the error, and what was taken before is
/// whole.
fn gives_up(does: Does) -> Option<Row> {
    let rig = Rig::new(does, &format!("{REAL_TIME}fault unplug {FAULT}"))?;
    let ended = rig.start(&["--give-up-after", "500ms"]).end();
    assert_eq!(ended.code(), 6, "{}", ended.stderr);
    ended.line("kinlight: camera virtual://kinlight: OpenNI2 has no device virtual://kinlight");
    let seen = rig.seen();
    assert!(!seen.is_empty() && seen.iter().all(|s| s.played < FAULT), "{seen:?}");
    everything_is_there(&rig);
    Some(Row {
        fault: "unplugged for good, --give-up-after 500ms".into(),
        command: does.name(),
        sees: sees(&ended),
        exit: ended.code(),
        recovery_ms: None,
        frames: format!("{} of {}", seen.len(), seen.len() + missing(&in_parts(&seen))),
        stop_s: None,
    })
}

/// What belongs to the end of a run is written, and no temporary file is left.
fn everything_is_there(rig: &Rig) {
    let names: &[&str] = match rig.does {
        Does::Record => &["rgb.txt", "depth.txt", "associations.txt", "calibration.toml"],
        Does::Stream => {
            &["light.jsonl", "trajectory.txt", "mesh.ply", "timings.json", "summary.json"]
        }
    };
    let files = rig.files();
    for name in names {
        assert!(files.get(&rig.out().join(name)).is_some_and(|bytes| !bytes.is_empty()), "{name}");
    }
    let folders: Vec<PathBuf> = ["", "rgb", "depth", "frames"].map(|f| rig.out().join(f)).into();
    for folder in folders.iter().filter(|f| f.is_dir()) {
        let hidden = std::fs::read_dir(folder)
            .unwrap()
            .filter(|entry| entry.as_ref().unwrap().file_name().to_string_lossy().starts_with('.'));
        assert_eq!(hidden.count(), 0, "{} has leftovers", folder.display());
    }
}
