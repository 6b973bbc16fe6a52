//! Running the program as a user does.
#![allow(dead_code, reason = "each test binary uses a part")]

pub mod process;
pub mod recording;
pub mod virtual_sensor;

#[path = "../../src/test_data.rs"]
mod test_data;

#[allow(unused_imports, reason = "each test binary uses a part")]
pub use test_data::real_data as real_sequence;

use std::path::Path;
use std::process::{Command, Output};

pub fn kinlight(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_kinlight"))
        .args(args)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("the program starts")
}

/// Runs and demands success; gives the JSON result.
pub fn kinlight_json(args: &[&str]) -> serde_json::Value {
    let output = kinlight(&[args, &["--json"]].concat());
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("one JSON value on standard output")
}

pub fn text(path: &Path) -> &str {
    path.to_str().expect("test paths are UTF-8")
}

/// Says so on the terminal itself: what `eprintln!` prints is hidden for tests that pass.
pub fn skipped(why: &str) {
    use std::io::Write;
    writeln!(std::io::stderr(), "SKIPPED: {why}").expect("standard error is open");
}
