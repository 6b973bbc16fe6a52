//! What can go wrong while virtual objects are read.

use std::path::{Path, PathBuf};

#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    #[error("{}: cannot be read: {source}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    /// The glTF file, or something it refers to, is not usable.
    #[error("{}: {what}", path.display())]
    Model { path: PathBuf, what: String },
    /// The scene file is not TOML, or a key is unknown, missing or of the wrong type.
    #[error("{}: not a scene file: {what}", path.display())]
    SceneFile { path: PathBuf, what: String },
    /// A scene file that nobody chose names what lies outside its folder.
    #[error("{}: {what}; name the file with --scene to read it even so", path.display())]
    Elsewhere { path: PathBuf, what: String },
    /// A key of an object has a value that means nothing. `index` counts from 1.
    #[error("{}: object {index} ({file}): `{key}` {what}", path.display())]
    Object { path: PathBuf, index: usize, file: String, key: &'static str, what: String },
}

/// Reads a whole file after looking at its size.
pub(super) fn read_limited(path: &Path, limit: u64) -> Result<Vec<u8>, SceneError> {
    crate::files::read(path, limit)
        .map_err(|source| SceneError::Read { path: path.to_owned(), source })
}
