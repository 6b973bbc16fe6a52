//! What can go wrong while virtual objects are read.

use std::path::PathBuf;

#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    #[error("{}: cannot be read: {source}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{}: {bytes} bytes are more than the limit of {limit} for this kind of file", path.display())]
    TooLarge { path: PathBuf, bytes: u64, limit: u64 },
    /// The glTF file, or something it refers to, is not usable.
    #[error("{}: {what}", path.display())]
    Model { path: PathBuf, what: String },
    /// The scene file is not TOML, or a key is unknown, missing or of the wrong type.
    #[error("{}: not a scene file: {what}", path.display())]
    SceneFile { path: PathBuf, what: String },
    /// A key of an object has a value that means nothing. `index` counts from 1.
    #[error("{}: object {index} ({file}): `{key}` {what}", path.display())]
    Object { path: PathBuf, index: usize, file: String, key: &'static str, what: String },
}

/// Reads a whole file after looking at its size.
pub(super) fn read_limited(path: &std::path::Path, limit: u64) -> Result<Vec<u8>, SceneError> {
    use std::io::Read;
    let failed = |source| SceneError::Read { path: path.to_owned(), source };
    let file = std::fs::File::open(path).map_err(failed)?;
    let bytes = file.metadata().map_err(failed)?.len();
    let too_large = |bytes| SceneError::TooLarge { path: path.to_owned(), bytes, limit };
    if bytes > limit {
        return Err(too_large(bytes));
    }
    let mut data = Vec::with_capacity(bytes as usize);
    // A file that grows, or a device without a length, must not fill the memory either.
    file.take(limit + 1).read_to_end(&mut data).map_err(failed)?;
    if data.len() as u64 > limit { Err(too_large(data.len() as u64)) } else { Ok(data) }
}
