//! `run.json`: what made a folder of results.

use crate::output::{OutputError, atomic_write};
use crate::pipeline::BackendRecord;
use crate::study::Machine;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Name of the file.
pub const RUN_RECORD: &str = "run.json";

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunRecord {
    pub preset: String,
    /// The recording, as it was named on the command line.
    pub sequence: String,
    pub command: String,
    pub machine: Machine,
    /// Why the CPU computed, where that was left to the program.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub on_cpu_because: Option<String>,
}

impl RunRecord {
    /// Of this process: its command line and its machine; `backend` is what computed.
    pub fn here(preset: &str, sequence: &Path, backend: BackendRecord) -> Self {
        let arguments = std::env::args_os().skip(1).map(|a| quoted(&a.to_string_lossy()));
        let words: Vec<String> = std::iter::once("kinlight".to_owned()).chain(arguments).collect();
        Self {
            preset: preset.to_owned(),
            sequence: sequence.display().to_string(),
            command: words.join(" "),
            machine: Machine { backend: backend.history(), ..Machine::here() },
            on_cpu_because: None,
        }
    }

    pub fn write(&self, folder: &Path) -> Result<(), OutputError> {
        let json = serde_json::to_vec_pretty(self).expect("a record is plain data");
        atomic_write(&folder.join(RUN_RECORD), |out| out.write_all(&json))
    }
}

/// As a shell takes it back.
fn quoted(argument: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=,:+@%^".contains(c);
    match !argument.is_empty() && argument.chars().all(plain) {
        true => argument.to_owned(),
        false => format!("'{}'", argument.replace('\'', r"'\''")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arguments_are_quoted_for_a_shell() {
        assert_eq!(quoted("--set"), "--set");
        assert_eq!(quoted("tracking.iterations=[8, 4]"), "'tracking.iterations=[8, 4]'");
        assert_eq!(quoted("it's"), r"'it'\''s'");
        assert_eq!(quoted(""), "''");
    }

    #[test]
    fn a_record_comes_back() {
        let folder = tempfile::tempdir().unwrap();
        let record = RunRecord::here("ours", Path::new("sequences/demo"), BackendRecord::cpu());
        record.write(folder.path()).unwrap();
        let text = std::fs::read(folder.path().join(RUN_RECORD)).unwrap();
        assert_eq!(serde_json::from_slice::<RunRecord>(&text).unwrap(), record);
        assert!(record.command.starts_with("kinlight"));
    }
}
