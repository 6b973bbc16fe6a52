//! What kinlight works without, and does more with.

use super::process::{self, Ended};
use serde::Serialize;
use std::process::Command;
use std::time::Duration;

/// A program.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Optional {
    pub program: &'static str,
    /// What it says of its version; `None` where it is not there.
    pub version: Option<String>,
    /// What it is for, and how it is had.
    pub used_for: &'static str,
    pub install: &'static str,
}

pub fn optional(limit: Duration) -> Vec<Optional> {
    vec![Optional {
        program: "ffmpeg",
        version: version_of("ffmpeg", limit),
        used_for: "--video",
        install: "apt install ffmpeg",
    }]
}

/// The first line of what `program -version` prints.
fn version_of(program: &str, limit: Duration) -> Option<String> {
    let finished = process::run(Command::new(program).arg("-version"), limit).ok()?;
    let line = finished.lines().next().map(|line| line.trim().to_owned());
    line.filter(|_| finished.ended == Ended::Exited(0))
}

/// Optional features of the build, and whether this one has them.
pub fn features() -> [(&'static str, bool); 3] {
    [
        ("gpu", cfg!(feature = "gpu")),
        ("opencv", cfg!(feature = "opencv")),
        ("v4l", cfg!(feature = "v4l")),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_that_is_not_there_has_no_version() {
        assert_eq!(version_of("no-such-program-anywhere", Duration::from_secs(5)), None);
        if cfg!(unix) {
            // It prints, but says that something is wrong.
            assert_eq!(version_of("false", Duration::from_secs(5)), None);
        }
    }
}
