//! Finished runs on disk, so that an interrupted study goes on where it stopped.

use super::measure::Outcome;
use super::plan::{Job, Kind};
use crate::config::Settings;
use crate::output::OutputError;
use crate::study::StudyError;
use crate::synth::SynthOptions;
use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

/// One line a run, each whole and on disk as soon as it is there.
#[derive(Debug)]
pub(super) struct RunLog {
    path: PathBuf,
    file: File,
    done: HashMap<String, Outcome>,
}

/// Everything that a result depends on, as text.
#[derive(serde::Serialize)]
struct Key<'a> {
    version: &'a str,
    kind: Kind,
    method: &'a str,
    sensor_noise: bool,
    warm_up: usize,
    sequence: &'a SynthOptions,
    settings: &'a Settings,
}

#[derive(serde::Serialize, serde::Deserialize)]
struct Line {
    key: String,
    result: Outcome,
}

impl RunLog {
    /// Opens `path` for appending, making it and its folder where they are missing.
    pub fn open(path: &Path) -> Result<Self, StudyError> {
        let error = |e: std::io::Error| OutputError::io(path, e);
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(error)?;
        }
        let mut file = OpenOptions::new().create(true).append(true).open(path).map_err(error)?;
        let text = std::fs::read_to_string(path).map_err(error)?;
        // Lines of other versions, and one that was cut short, are no results.
        let lines = text.lines().filter_map(|line| serde_json::from_str::<Line>(line).ok());
        let done = lines.map(|line| (line.key, line.result)).collect();
        if !text.is_empty() && !text.ends_with('\n') {
            file.write_all(b"\n").map_err(error)?;
        }
        Ok(Self { path: path.to_owned(), file, done })
    }

    pub fn key(job: &Job, warm_up: usize) -> Result<String, StudyError> {
        let key = Key {
            version: env!("CARGO_PKG_VERSION"),
            kind: job.kind,
            method: &job.method.name,
            sensor_noise: job.sensor_noise,
            warm_up,
            sequence: &job.options,
            settings: &job.method.settings,
        };
        serde_json::to_string(&key).map_err(|e| StudyError::Options(e.to_string()))
    }

    pub fn get(&self, key: &str) -> Option<&Outcome> {
        self.done.get(key)
    }

    /// Keeps a result as it will be read back: the last digit of a number may change on the way, and
    /// a study that was interrupted must not differ from one that was not.
    pub fn push(&mut self, key: &str, result: Outcome) -> Result<(), StudyError> {
        let line = Line { key: key.to_owned(), result };
        let text = serde_json::to_string(&line).map_err(|e| self.error(e.into()))?;
        self.file.write_all(format!("{text}\n").as_bytes()).map_err(|e| self.error(e))?;
        let line: Line = serde_json::from_str(&text).map_err(|e| self.error(e.into()))?;
        self.done.insert(line.key, line.result);
        Ok(())
    }

    fn error(&self, source: std::io::Error) -> OutputError {
        OutputError::io(&self.path, source)
    }
}
