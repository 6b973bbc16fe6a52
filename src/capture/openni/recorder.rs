//! `.oni` recordings of streams, made by OpenNI2 itself.

use super::device_handle::Stream;
use super::ffi;
use super::runtime::Runtime;
use std::ffi::{CString, c_int};
use std::path::Path;
use std::ptr::null_mut;

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
