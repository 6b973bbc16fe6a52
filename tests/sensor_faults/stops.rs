//! Interrupts, whatever the sensor does.

use crate::rig::{Does, Rig};
use crate::table::Row;
use crate::{FAULT, REAL_TIME, everything_is_there, in_parts, missing, sees, stopped};
use std::time::Duration;

/// Where an interrupt may find a run.
#[derive(Clone, Copy)]
pub struct State {
    name: &'static str,
    script: &'static str,
    args: &'static [&'static str],
    /// The run is there, for some time already.
    reached: fn(&Rig, &str) -> bool,
}

pub const STATES: [State; 4] = [
    State {
        name: "interrupted while streaming",
        script: "",
        args: &[],
        reached: |rig, _| rig.written() >= 5,
    },
    State {
        name: "interrupted while the sensor stalls",
        script: "fault stall 20",
        args: &["--stall", "60s"],
        reached: |rig, _| rig.happened("frame", FAULT - 1),
    },
    State {
        name: "interrupted while it is unplugged",
        script: "fault unplug 20",
        args: &[],
        reached: |_, said| said.contains("camera lost"),
    },
    State {
        name: "interrupted while the driver opens it again and does not return",
        script: "fault unplug 20 200\nreopen-ms 20000",
        args: &[],
        reached: |rig, _| rig.happened("open", 1),
    },
];

/// Ends in time with all its files, whatever the sensor does.
pub fn stops(does: Does, state: &State) -> Option<Row> {
    let rig = Rig::new(does, &format!("{REAL_TIME}{}", state.script))?;
    let mut run = rig.start(state.args);
    let said = rig.at(&format!("{}.err", does.name()));
    run.until(state.name, || {
        (state.reached)(&rig, &std::fs::read_to_string(&said).unwrap_or_default())
    });
    if !state.script.is_empty() {
        std::thread::sleep(Duration::from_millis(500));
    }
    run.signal("-INT");
    let ended = run.end();
    let stop_s = stopped(&ended, &format!("{}, {}", does.name(), state.name));
    let seen = rig.seen();
    let lost = missing(&in_parts(&seen));
    assert!(!seen.is_empty() && in_parts(&seen).len() == 1, "{seen:?}");
    everything_is_there(&rig);
    Some(Row {
        fault: state.name.into(),
        command: does.name(),
        sees: sees(&ended),
        exit: ended.code(),
        recovery_ms: None,
        frames: format!("{} of {}", seen.len(), seen.len() + lost),
        stop_s: Some(stop_s),
    })
}
