//! Runs that are killed.

use crate::common::process::lines;
use crate::common::recording::small_demo;
use crate::common::text;
use crate::made::{Made, QUICK, log_of, long};
use crate::whole::{frames_of_recording, whole_files};
use kinlight::math::random::Rng;
use std::time::Duration;

#[test]
fn wherever_a_run_is_killed_what_has_a_name_is_whole() {
    let made = Made::new(&long(400));
    let mut rng = Rng::new(&[7]);
    for command in ["replay", "compare", "convert", "synth", "stream", "record"] {
        for round in 0..4 {
            let out = made.at(&format!("{command}-{round}"));
            let mut run = made.start(command, &out);
            // From the first files on (before that there is nothing to see), or from the first frame on.
            let log = log_of(command, &out);
            run.until("files", || if round < 2 { out.exists() } else { lines(&log) > 1 });
            std::thread::sleep(Duration::from_millis(u64::from(rng.next_u32() % 600)));
            run.signal("-KILL");
            run.end();
            let (files, temporary) = whole_files(&out);
            println!("{command}: {} files, {temporary} temporary", files.len());
            // At most one for each thread that writes.
            assert!(temporary <= 8, "{temporary}");
            if log_of(command, &out).ends_with("associations.txt") && out.join("rgb.txt").exists() {
                let listed = std::fs::read_to_string(out.join("rgb.txt")).unwrap();
                if listed.lines().count() > 1 && out.join("depth.txt").exists() {
                    frames_of_recording(&out);
                }
            }
        }
    }
}

#[test]
fn the_folder_of_a_killed_run_serves_the_next() {
    let made = Made::new(&small_demo(12));
    let (sequence, out) = (made.sequence(), made.at("out"));
    let mut run = made.start("replay", &out);
    run.until("frames", || out.join("frames/000002.png").exists());
    run.signal("-KILL");
    run.end();
    let again = made.start("replay", &out).end();
    assert_eq!(again.succeeded().json()["frames"], 12);
    let fresh = made.at("fresh");
    let args = ["replay", text(&sequence), "--out", text(&fresh)];
    crate::common::kinlight_json(&[&args[..], &QUICK].concat());
    for name in ["light.jsonl", "trajectory.txt", "mesh.ply", "frames/000011.png"] {
        let read = |folder: &std::path::Path| std::fs::read(folder.join(name)).unwrap();
        assert!(read(&out) == read(&fresh), "{name}");
    }
}
