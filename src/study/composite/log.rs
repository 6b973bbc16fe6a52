//! `runs.jsonl`: a line for each finished run, so that a study that was interrupted goes on.

use super::record::CompositeRun;
use super::runs::RunKey;
use crate::output::{OutputError, atomic_write};
use crate::study::StudyError;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

#[derive(Serialize, Deserialize)]
struct Finished {
    key: RunKey,
    run: CompositeRun,
}

pub struct RunLog {
    path: PathBuf,
    finished: Vec<Finished>,
}

impl RunLog {
    /// Reads what is there. Lines of another version of the program are of no use, and are dropped.
    pub fn open(path: PathBuf) -> Result<Self, StudyError> {
        let finished = match std::fs::read_to_string(&path) {
            Ok(text) => text.lines().filter_map(|l| serde_json::from_str(l).ok()).collect(),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => Vec::new(),
            Err(e) => {
                return Err(OutputError::content(&path, format!("cannot be read: {e}")).into());
            }
        };
        Ok(Self { path, finished })
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.finished.clear();
    }

    pub fn find(&self, key: &RunKey) -> Option<&CompositeRun> {
        self.finished.iter().find(|f| f.key == *key).map(|f| &f.run)
    }

    /// Adds a run and writes the file anew, so that it never holds half a line.
    pub fn push(&mut self, key: RunKey, run: CompositeRun) -> Result<(), StudyError> {
        self.finished.push(Finished { key, run });
        write_lines(&self.path, &self.finished)
    }
}

fn write_lines(path: &Path, finished: &[Finished]) -> Result<(), StudyError> {
    Ok(atomic_write(path, |w| {
        finished.iter().try_for_each(|f| {
            serde_json::to_writer(&mut *w, f)?;
            w.write_all(b"\n")
        })
    })?)
}
