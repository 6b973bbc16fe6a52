//! Small recordings, and commands that run over them.

use crate::common::process::{self, Running};
use crate::common::recording::{Recording, looped};
use crate::common::text;
use kinlight::image::Size;
use std::path::{Path, PathBuf};
use std::process::Command;

pub const PROGRAM: &str = env!("CARGO_BIN_EXE_kinlight");

/// Quick settings.
pub const QUICK: [&str; 5] = ["--preset", "ours-fast-mobile", "--backend", "cpu", "--no-object"];

/// A recording of small pictures and a folder for results.
pub struct Made {
    folder: tempfile::TempDir,
}

/// Frames that take little time.
pub fn long(frames: usize) -> Recording {
    looped(frames, Size::new(80, 60))
}

impl Made {
    pub fn new(recording: &Recording) -> Self {
        let made = Self { folder: tempfile::tempdir().unwrap() };
        recording.write(&made.sequence());
        made
    }

    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    pub fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn sequence(&self) -> PathBuf {
        self.at("sequence")
    }

    /// It plays as a camera.
    pub fn device(&self) -> String {
        format!("play:{}", self.sequence().display())
    }

    /// Arguments of each command that writes frame by frame, with `out` for its results.
    pub fn arguments(&self, command: &str, out: &Path) -> Vec<String> {
        let (sequence, device) = (self.sequence(), self.device());
        let all = match command {
            "replay" => [&["replay", text(&sequence), "--out", text(out)], &QUICK[..]].concat(),
            "compare" => {
                let presets = ["--presets", "ours-fast-mobile,ours-fast", "--warm-up", "1"];
                let quick = ["--backend", "cpu", "--no-object", "--frames-out"];
                [&["compare", text(&sequence), "--out", text(out)], &presets[..], &quick].concat()
            }
            "stream" => {
                let stream = ["stream", "--device", &device, "--frames-out", "--out", text(out)];
                [&stream[..], &QUICK].concat()
            }
            "record" => vec!["record", "--device", &device, "--out", text(out)],
            "convert" => vec!["convert", text(&sequence), text(out)],
            "synth" => vec![
                "synth",
                text(out),
                "--scene",
                "sphere",
                "--frames",
                "400",
                "--size",
                "160,120",
                "--samples",
                "4",
                "--kinect",
            ],
            other => panic!("{other}"),
        };
        all.into_iter().map(str::to_owned).chain(["--json".to_owned()]).collect()
    }

    pub fn command(&self, command: &str, out: &Path) -> Command {
        let mut process = Command::new(PROGRAM);
        process.args(self.arguments(command, out)).current_dir(env!("CARGO_MANIFEST_DIR"));
        process
    }

    pub fn start(&self, command: &str, out: &Path) -> Running {
        self.run(self.command(command, out), command)
    }

    pub fn run(&self, command: Command, name: &str) -> Running {
        process::start(command, self.folder(), name)
    }
}

/// Grows by a line with each frame that a command has finished.
pub fn log_of(command: &str, out: &Path) -> PathBuf {
    match command {
        "replay" | "stream" => out.join("light.jsonl"),
        "compare" => out.join("ours-fast-mobile/timings.csv"),
        _ => out.join("associations.txt"),
    }
}
