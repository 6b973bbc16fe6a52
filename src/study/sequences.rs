//! Made sequences on disk, each made once.

use super::StudyError;
use crate::output::OutputError;
use crate::stop::Stop;
use crate::synth::{OPTIONS_FILE, SynthOptions, generate_until};
use std::path::{Path, PathBuf};

/// A folder of made sequences.
#[derive(Clone, Debug)]
pub struct SequenceStore {
    folder: PathBuf,
}

impl SequenceStore {
    pub fn new(folder: impl Into<PathBuf>) -> Self {
        Self { folder: folder.into() }
    }

    /// Whether the sequence `name` is there, made with these options.
    pub fn has(&self, name: &str, options: &SynthOptions) -> bool {
        made_with(&self.folder.join(name)).as_ref() == Some(options)
    }

    /// The sequence `name`, made now where it is not there, or was made with other options.
    ///
    /// `progress(done, all)` counts frames while it is made.
    pub fn get(
        &self,
        name: &str,
        options: &SynthOptions,
        stop: &Stop,
        progress: &dyn Fn(usize, usize),
    ) -> Result<PathBuf, StudyError> {
        let path = self.folder.join(name);
        if self.has(name, options) {
            return Ok(path);
        }
        let partial = self.folder.join(format!("{name}.partial"));
        for stale in [&path, &partial] {
            if stale.exists() {
                std::fs::remove_dir_all(stale).map_err(|e| OutputError::io(stale, e))?;
            }
        }
        std::fs::create_dir_all(&self.folder).map_err(|e| OutputError::io(&self.folder, e))?;
        generate_until(stop, options, &partial, progress)?;
        std::fs::rename(&partial, &path).map_err(|e| OutputError::io(&partial, e))?;
        Ok(path)
    }
}

/// The options that a complete made sequence was made with.
fn made_with(path: &Path) -> Option<SynthOptions> {
    serde_json::from_slice(&std::fs::read(path.join(OPTIONS_FILE)).ok()?).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    #[test]
    fn a_sequence_is_made_once_and_again_for_other_options() {
        let folder = tempfile::tempdir().unwrap();
        let store = SequenceStore::new(folder.path().join("made"));
        let mut options = SynthOptions {
            scene: "sphere".into(),
            frames: 1,
            width: 32,
            height: 24,
            samples: 1,
            bounces: 1,
            ..SynthOptions::default()
        };
        let count = Cell::new(0);
        let made = |options: &SynthOptions| {
            let path = store
                .get("a", options, &Stop::default(), &|_, _| count.set(count.get() + 1))
                .unwrap();
            (path.join("rgb.txt").exists(), count.get())
        };
        assert_eq!(made(&options), (true, 1));
        assert_eq!(made(&options), (true, 1));
        options.seed = 2;
        assert_eq!(made(&options), (true, 2));
        std::fs::remove_file(folder.path().join("made/a").join(OPTIONS_FILE)).unwrap();
        assert_eq!(made(&options), (true, 3), "what is not complete is made anew");
    }
}
