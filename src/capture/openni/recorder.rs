//! `.oni` recordings of streams, made by OpenNI2 itself.

#![allow(unsafe_code, reason = "calls of a C library")]

use super::device_handle::Stream;
use super::ffi;
use super::runtime::Runtime;
use std::ffi::{CString, c_int};
use std::path::{Path, PathBuf};
use std::ptr::null_mut;
use std::sync::{Arc, Mutex, PoisonError};

/// Files that a device is recorded to: `name.oni`, and each time that it is opened again the next free one
/// of `name-2.oni`, `name-3.oni`, .. Clones are of one recording.
#[derive(Clone, Debug)]
pub struct OniFiles {
    path: PathBuf,
    begun: Arc<Mutex<Vec<PathBuf>>>,
}

impl OniFiles {
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self { path: path.into(), begun: Arc::default() }
    }

    /// Those that were begun until now.
    pub fn begun(&self) -> Vec<PathBuf> {
        self.begun.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Begins the next; nothing that is there is overwritten.
    pub(super) fn begin(&self) -> PathBuf {
        let mut begun = self.begun.lock().unwrap_or_else(PoisonError::into_inner);
        let mut names = (1..).map(|n| numbered(&self.path, n));
        let free = |path: &PathBuf| !begun.contains(path) && !path.exists();
        let path = names.find(free).unwrap_or_else(|| self.path.clone());
        begun.push(path.clone());
        path
    }
}

/// `name.oni`, `name-2.oni`, ..
fn numbered(path: &Path, number: usize) -> PathBuf {
    if number == 1 {
        return path.to_owned();
    }
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let extension = path.extension().map_or("oni".into(), |e| e.to_string_lossy());
    path.with_file_name(format!("{stem}-{number}.{extension}"))
}

/// The library's own recorder, to a `.oni` file.
pub struct OniRecorder {
    runtime: &'static Runtime,
    handle: ffi::RecorderHandle,
}

// SAFETY: as for `Device`.
unsafe impl Send for OniRecorder {}

impl OniRecorder {
    /// Starts to record streams that exist; what they deliver from about now on is written, by a thread of
    /// the library's. `lossy` stores colour as JPEG. Depth is always exact.
    ///
    /// The library stores times from each stream's first recorded frame, so the first colour and depth frame
    /// both get time 0, whatever was between them.
    pub fn start(path: &Path, streams: &[&Stream], lossy: bool) -> Result<Self, String> {
        let runtime = streams.first().ok_or("no stream to record")?.device.runtime;
        let name = path.to_str().ok_or("OpenNI2 writes files with names in UTF-8 only")?;
        let name = CString::new(name).map_err(|_| "a name with a zero byte")?;
        let mut handle = null_mut();
        // SAFETY: the name is NUL-terminated, the output valid.
        let status = unsafe { (runtime.api.recorder_create)(name.as_ptr(), &mut handle) };
        // A handle that comes with an error is not to be destroyed: its recorder is gone already.
        runtime.check(status)?;
        let recorder = Self { runtime, handle };
        for stream in streams {
            // SAFETY: recorder and stream exist. The library detaches a stream that is destroyed first.
            runtime.check(unsafe {
                (runtime.api.recorder_attach)(handle, stream.raw(), c_int::from(lossy))
            })?;
        }
        // SAFETY: the recorder exists.
        runtime.check(unsafe { (runtime.api.recorder_start)(handle) })?;
        Ok(recorder)
    }
}

impl Drop for OniRecorder {
    /// Writes what is left and the index.
    fn drop(&mut self) {
        // SAFETY: the recorder exists and is destroyed once.
        unsafe {
            (self.runtime.api.recorder_stop)(self.handle);
            (self.runtime.api.recorder_destroy)(&mut self.handle);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recordings_of_a_device_that_comes_back_overwrite_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("room-2.oni"), "of another day").unwrap();
        let files = OniFiles::new(at("room.oni"));
        assert_eq!(files.begin(), at("room.oni"));
        // Begun, even where the library has not made it yet.
        assert_eq!(files.clone().begin(), at("room-3.oni"));
        assert_eq!(files.begun(), [at("room.oni"), at("room-3.oni")]);
        assert_eq!(numbered(Path::new("room"), 2), Path::new("room-2.oni"));
    }
}
