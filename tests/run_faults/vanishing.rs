//! Folders and files that go away, or can no longer be written, while a run uses them.

use crate::common::process::{Ended, Running, lines};
use crate::common::recording::looped_time_s;
use crate::made::{Made, log_of, long};
use crate::whole::{frames_of_run, whole_files};
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;

/// Holds the run while the world changes; gives the lines of its log.
fn meanwhile(run: &mut Running, log: &Path, change: impl FnOnce(usize)) {
    run.until("some frames", || lines(log) > 3);
    run.signal("-STOP");
    let state = format!("/proc/{}/stat", run.id());
    run.until("it stands still", || fs::read_to_string(&state).unwrap().contains(") T "));
    change(lines(log));
    run.signal("-CONT");
}

fn failed(ended: &Ended, code: i32, kind: &str, words: &[&str]) {
    assert_eq!(ended.code(), code, "{}", ended.stderr);
    let json = ended.json();
    assert_eq!(json["error"]["kind"], kind);
    let message = json["error"]["message"].as_str().expect("a message");
    words.iter().for_each(|word| assert!(message.contains(word), "{word} is not in {message}"));
}

#[test]
fn a_removed_output_folder_ends_the_run_and_is_not_made_again() {
    let made = Made::new(&long(400));
    for command in ["replay", "stream", "record", "convert", "synth"] {
        let out = made.at(command);
        let mut run = made.start(command, &out);
        meanwhile(&mut run, &log_of(command, &out), |_| fs::remove_dir_all(&out).unwrap());
        let ended = run.end();
        failed(&ended, 5, "output", &[command]);
        // The second is said where the run was held between a picture and its final name.
        let said = ["was removed", "No such file"].iter().any(|words| ended.stderr.contains(words));
        assert!(said, "{}", ended.stderr);
        // A picture that was in the making when the run was held may have come after.
        assert!(!out.join("rgb.txt").exists() && !out.join("light.jsonl").exists(), "{command}");
    }
}

#[test]
fn a_log_that_is_removed_is_named() {
    let made = Made::new(&long(400));
    let out = made.at("out");
    let mut run = made.start("replay", &out);
    meanwhile(&mut run, &out.join("light.jsonl"), |_| {
        fs::remove_file(out.join("trajectory.txt")).unwrap();
    });
    failed(&run.end(), 5, "output", &["trajectory.txt: was removed while it was being written"]);
    whole_files(&out);
}

/// Runs as a user who may not do everything.
fn as_a_user(made: &Made, command: &str, out: &Path) -> Command {
    let plain = made.command(command, out);
    let administrator = Command::new("id").arg("-u").output().is_ok_and(|o| o.stdout == b"0\n");
    if !administrator {
        return plain;
    }
    // The program itself may lie where only its builder may go.
    let program = made.at("kinlight");
    if !program.exists() {
        fs::copy(plain.get_program(), &program).unwrap();
    }
    let mut command = Command::new("setpriv");
    command.args(["--reuid=65534", "--regid=65534", "--clear-groups"]).arg(program);
    command.args(plain.get_args());
    command
}

fn allow(path: &Path, mode: u32) {
    fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
}

#[test]
fn a_folder_that_becomes_read_only_is_an_error_of_the_output() {
    let made = Made::new(&long(400));
    allow(made.folder(), 0o777);
    for (command, inner) in [("replay", "frames"), ("record", "rgb"), ("synth", "depth")] {
        let out = made.at(command);
        let mut run = made.run(as_a_user(&made, command, &out), command);
        meanwhile(&mut run, &log_of(command, &out), |_| allow(&out.join(inner), 0o555));
        failed(
            &run.end(),
            5,
            "output",
            &[inner, "cannot write", "Permission denied"].map(|w| {
                // Of recordings the system's words come alone.
                if command != "replay" && w == "cannot write" { "" } else { w }
            }),
        );
        whole_files(&out);
        if command == "replay" {
            assert!(frames_of_run(&out) > 3 && out.join("summary.json").exists());
        }
        allow(&out.join(inner), 0o777);
    }
    allow(made.folder(), 0o555);
    let out = made.at("never");
    for command in ["replay", "record", "synth", "convert"] {
        // Nothing can be written into the folder: not what it says either.
        let output = as_a_user(&made, command, &out).output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(5), "{command}: {stderr}");
        assert!(stderr.contains("Permission denied") && stderr.contains("never"), "{stderr}");
    }
    allow(made.folder(), 0o777);
}

#[test]
fn a_picture_that_vanishes_costs_its_frame_and_no_other() {
    let made = Made::new(&long(60));
    let out = made.at("out");
    let mut run = made.start("replay", &out);
    let mut gone = Vec::new();
    meanwhile(&mut run, &out.join("light.jsonl"), |done| {
        // Those that are not read yet.
        for (index, folder) in [(done + 5, "rgb"), (done + 9, "depth")] {
            let time = format!("{:.6}", looped_time_s(index));
            let name = format!("{folder}/{time}.png");
            fs::remove_file(made.sequence().join(&name)).unwrap();
            gone.push((index, name));
        }
    });
    let ended = run.end();
    let json = ended.succeeded().json();
    assert_eq!((&json["frames"], json["skipped"].as_array().unwrap().len()), (&58.into(), 2));
    for ((index, name), skipped) in gone.iter().zip(json["skipped"].as_array().unwrap()) {
        assert_eq!(skipped["index"], *index);
        assert!(skipped["reason"].as_str().unwrap().contains(name.as_str()), "{skipped}");
        ended.line(name);
    }
    assert_eq!(frames_of_run(&out), 58);
}

#[test]
fn a_recording_that_vanishes_ends_the_run_with_what_it_has() {
    let made = Made::new(&long(400));
    let out = made.at("out");
    let mut run = made.start("replay", &out);
    meanwhile(&mut run, &out.join("light.jsonl"), |_| {
        fs::rename(made.sequence(), made.at("elsewhere")).unwrap();
    });
    failed(&run.end(), 3, "sequence", &["sequence", "is no longer there; frames from"]);
    assert!(frames_of_run(&out) > 3);
    let (files, temporary) = whole_files(&out);
    assert!(temporary == 0 && files.contains(&out.join("mesh.ply")), "{files:?}");
}
