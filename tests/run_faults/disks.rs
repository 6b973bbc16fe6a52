//! Disks that fill up.

use crate::common::process::lines;
use crate::common::recording::small_demo;
use crate::common::{skipped, text};
use crate::made::{Made, PROGRAM, log_of, long};
use crate::whole::{frames_of_recording, frames_of_run, whole_files};
use std::process::Command;

/// How a process may have a disk of its own: as the administrator, or as one of a namespace where users may make
/// those.
fn own_disks() -> Option<&'static [&'static str]> {
    let may = |options: &[&str]| {
        let mut command = Command::new("unshare");
        command.args(options).args(["sh", "-c", "mount -t tmpfs -o size=64k tmpfs /mnt"]);
        command.output().is_ok_and(|output| output.status.success())
    };
    let found = [&["-m"][..], &["-rm"]].into_iter().find(|options| may(options));
    if found.is_none() {
        skipped("no right to mount a small disk; the limit of file sizes stands for it");
    }
    found
}

/// Mounts a disk of some KiB, runs the rest, and keeps what is on the disk, which goes with the process.
const ON_A_SMALL_DISK: &str = "disk=$1; keep=$2; size=$3; shift 3\n\
    mkdir -p \"$disk\" && mount -t tmpfs -o size=${size}k tmpfs \"$disk\" || exit 99\n\
    \"$@\"; code=$?; cp -a \"$disk/out\" \"$keep\"; exit $code";

#[test]
fn on_a_full_disk_what_was_written_is_whole() {
    let Some(unshare) = own_disks() else { return };
    let (large, small) = (Made::new(&small_demo(12)), Made::new(&long(400)));
    for (command, made, kib) in [
        ("replay", &large, 200),
        ("stream", &small, 400),
        ("record", &small, 1000),
        ("convert", &small, 1000),
        ("synth", &small, 1000),
        ("compare", &large, 300),
    ] {
        let (disk, keep) = (made.at("disk"), made.at(&format!("{command}-kept")));
        let mut process = Command::new("unshare");
        process.args(unshare).args(["sh", "-c", ON_A_SMALL_DISK, "sh", text(&disk), text(&keep)]);
        process.arg(kib.to_string()).arg(PROGRAM);
        process.args(made.arguments(command, &disk.join("out")));
        let ended = made.run(process, command).end();
        assert_eq!(ended.code(), 5, "{command}: {}", ended.stderr);
        let message = ended.json()["error"]["message"].as_str().unwrap().to_owned();
        assert!(message.contains("no space left on the disk"), "{message}");
        assert!(message.contains("disk/out/"), "the file is named: {message}");
        let (files, temporary) = whole_files(&keep);
        assert_eq!(temporary, 0, "{command}: half a file is removed: {files:?}");
        let frames = match command {
            "replay" | "stream" => frames_of_run(&keep),
            "compare" => lines(&log_of(command, &keep)),
            _ => frames_of_recording(&keep),
        };
        println!("{command}: {frames} frames, then {message}");
        assert!(frames > 0, "{command}");
    }
}

/// A limit of file sizes, without a shell that takes its signal away: a log meets it, or the mesh.
#[test]
fn a_file_that_grows_too_large_is_an_error_and_not_the_end() {
    let (large, small) = (Made::new(&small_demo(12)), Made::new(&long(400)));
    let cases: [(&str, &Made, u32, &[&str], &str); 4] = [
        ("replay", &small, 8, &["--without", "frames"], "light.jsonl"),
        ("replay", &large, 64, &[], "mesh.ply"),
        ("record", &small, 32, &["--every-frame"], ".txt"),
        ("synth", &small, 8, &[], "object.glb"),
    ];
    for (command, made, kib, extra, named) in cases {
        let out = made.at(&format!("{command}-{kib}"));
        let mut process = Command::new("bash");
        process.args(["-c", "ulimit -f \"$0\"; exec \"$@\"", &kib.to_string()]);
        process.arg(PROGRAM).args(made.arguments(command, &out)).args(extra);
        let ended = made.run(process, command).end();
        assert_eq!(ended.code(), 5, "{command}: {}", ended.stderr);
        let message = ended.json()["error"]["message"].as_str().unwrap().to_owned();
        assert!(message.contains(named) && message.contains("too large"), "{message}");
        let (files, temporary) = whole_files(&out);
        assert!(temporary == 0 && !files.contains(&out.join("mesh.ply")), "{files:?}");
        println!("{command}: {} files, then {message}", files.len());
    }
}
