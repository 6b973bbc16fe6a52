//! What each fuzz target does with its bytes. The targets in `fuzz/` call these bodies; so does a test,
//! with the files of `fuzz/corpus/`, on any machine.
//!
//! A body hands the bytes to one reader as they would come from a file (`frames`: to the pipeline, as pictures), and
//! panics where something holds of the result that must not. It says whether the reader took them.

mod frames;
mod records;
mod scene;
mod settings;

#[cfg(test)]
mod mutate;
#[cfg(test)]
mod replay;
#[cfg(test)]
mod seeds;

use std::fmt::Display;
use std::path::{Path, PathBuf};

/// A target's name, and its body.
pub struct Target {
    pub name: &'static str,
    pub body: fn(&[u8], &Scratch) -> bool,
}

/// One a reader, and one for the pipeline. The command line has a target of its own, in the program.
pub const TARGETS: [Target; 11] = [
    Target { name: "lists", body: crate::capture::fuzzing::lists },
    Target { name: "poses", body: crate::capture::fuzzing::poses },
    Target { name: "pictures", body: crate::capture::fuzzing::pictures },
    Target { name: "calibration", body: crate::capture::fuzzing::calibration },
    Target { name: "sequence", body: crate::capture::fuzzing::sequence },
    Target { name: "settings", body: settings::settings },
    Target { name: "scene", body: scene::scene },
    Target { name: "gltf", body: scene::gltf },
    Target { name: "records", body: records::records },
    Target { name: "calibrate", body: records::calibrate },
    Target { name: "frames", body: frames::frames },
];

/// A folder for readers that want files; best in memory.
#[derive(Debug)]
pub struct Scratch {
    root: PathBuf,
}

impl Scratch {
    /// `root` must be there, and be used for nothing else.
    pub fn new(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into() }
    }

    pub fn root(&self) -> &Path {
        &self.root
    }

    /// A folder below, made where it is missing.
    pub fn folder(&self, name: &str) -> PathBuf {
        let path = self.root.join(name);
        std::fs::create_dir_all(&path).expect("scratch folder");
        path
    }

    /// The same without what was in it.
    pub fn emptied(&self, name: &str) -> PathBuf {
        let path = self.root.join(name);
        if path.exists() {
            std::fs::remove_dir_all(&path).expect("scratch folder");
        }
        self.folder(name)
    }

    /// Writes a file, making its folder. What cannot be a file of that name is left out.
    pub fn write(&self, path: &Path, content: &[u8]) {
        assert!(path.starts_with(&self.root), "{}", path.display());
        if let Some(folder) = path.parent() {
            let _ = std::fs::create_dir_all(folder);
        }
        let _ = std::fs::write(path, content);
    }
}

/// Whether a reader took its input. Errors must be able to say what they are.
pub(crate) fn accepted<T>(read: Result<T, impl Display>) -> bool {
    match read {
        Ok(_) => true,
        Err(error) => {
            assert!(!error.to_string().is_empty());
            false
        }
    }
}

/// Several inputs in one, with a zero byte between them.
pub(crate) fn parts(data: &[u8]) -> impl Iterator<Item = &[u8]> {
    data.split(|&b| b == 0)
}

/// Several files in one: `@name`, a line's end, the content, a line's end before the next `@`. Names that
/// would lead out of a folder are left out.
pub(crate) fn files(data: &[u8]) -> impl Iterator<Item = (&str, &[u8])> {
    let mut rest = data.strip_prefix(b"@").unwrap_or_default();
    std::iter::from_fn(move || {
        if rest.is_empty() {
            return None;
        }
        let end = rest.windows(2).position(|w| w == b"\n@").unwrap_or(rest.len());
        let file = &rest[..end];
        rest = rest.get(end + 2..).unwrap_or_default();
        Some(file)
    })
    .filter_map(|file| {
        let end = file.iter().position(|&b| b == b'\n')?;
        let name = std::str::from_utf8(&file[..end]).ok()?;
        let plain = |c: char| c.is_ascii_alphanumeric() || "._-/".contains(c);
        let harmless = name.chars().all(plain) && !name.starts_with('/') && !name.contains("..");
        (harmless && !name.is_empty()).then_some((name, &file[end + 1..]))
    })
}
