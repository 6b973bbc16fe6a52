//! Standard output and standard error that take nothing.

use crate::common::recording::small_demo;
use crate::common::text;
use crate::made::{Made, PROGRAM};
use std::fs::File;
use std::process::{Command, Stdio};

fn full() -> File {
    File::options().write(true).open("/dev/full").expect("Linux has it")
}

/// A pipe that nobody reads.
fn unread() -> Stdio {
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    writer.into()
}

#[test]
fn a_reader_that_goes_is_no_mistake_and_a_full_disk_is() {
    let made = Made::new(&small_demo(3));
    let (sequence, out) = (made.sequence(), made.at("out"));
    let quick = ["--preset", "ours-fast-mobile", "--backend", "cpu", "--out", text(&out)];
    let replay = [&["replay", text(&sequence)], &quick[..]].concat();
    let other = made.at("synth");
    let synth =
        ["synth", "--scene", "sphere", "--frames", "1", "--size", "32,24", "--samples", "1"];
    let synth = [&synth[..], &[text(&other)]].concat();
    for args in [&replay[..], &["info", text(&sequence)], &synth[..]] {
        for json in [&[][..], &["--json"]] {
            let run = |stdout: Stdio| {
                let _ = std::fs::remove_dir_all(&other);
                let mut command = Command::new(PROGRAM);
                let output = command.args(args).args(json).stdout(stdout).stderr(Stdio::piped());
                let output = output.output().unwrap();
                let stderr = String::from_utf8(output.stderr).unwrap();
                assert!(!stderr.contains("panicked"), "{args:?}: {stderr}");
                (output.status.code(), stderr)
            };
            let (code, said) = run(unread());
            assert_eq!(code, Some(0), "{args:?}: {said}");
            let (code, said) = run(full().into());
            assert_eq!(code, Some(5), "{args:?}: {said}");
            assert!(said.contains("kinlight: standard output: cannot write: No space"), "{said}");
        }
    }
    assert!(out.join("report.html").exists());
}

#[test]
fn without_standard_error_exit_codes_are_as_ever() {
    let made = Made::new(&small_demo(2));
    let (sequence, out) = (made.sequence(), made.at("out"));
    let quick = ["--preset", "ours-fast-mobile", "--backend", "cpu", "--out", text(&out)];
    let replay = [&["replay", text(&sequence)], &quick[..]].concat();
    let cases: [(&[&str], i32); 4] = [
        (&replay, 0),
        (&["replay", "no/such/place"], 3),
        (&["replay", "--preset", "best"], 2),
        (&["stream", "--device", "play:no/such/place"], 6),
    ];
    for (args, code) in cases {
        for stderr in [full().into(), unread()] {
            let mut command = Command::new(PROGRAM);
            let output =
                command.args(args).arg("--json").arg("-v").stderr(stderr).output().unwrap();
            assert_eq!(output.status.code(), Some(code), "{args:?}");
            serde_json::from_slice::<serde_json::Value>(&output.stdout).expect("the result");
        }
    }
}
