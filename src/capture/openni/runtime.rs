//! The one OpenNI2 of this process: loaded and initialised once, kept until the process ends.
//!
//! Initialising changes the working directory for a moment and shutting down with a driver's thread still
//! running crashes, so neither is repeated: devices that come later are announced by their drivers.

#![allow(unsafe_code, reason = "calls of a C library")]

use super::device_handle::Device;
use super::ffi::{self, Api};
use super::library;
use crate::capture::live::DeviceError;
use std::collections::BTreeMap;
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::path::Path;
use std::ptr::null_mut;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// A loaded and initialised OpenNI2.
pub struct Runtime {
    pub(super) api: Api,
    path: String,
    /// Errors are explained by a text that the next call overwrites.
    calling: Mutex<()>,
}

/// A device that a driver has announced.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct FoundDevice {
    pub uri: String,
    pub vendor: String,
    pub name: String,
}

/// How initialising went. It is not tried twice: the library would say yes the second time, without drivers.
static RUNTIME: Mutex<Option<Result<&'static Runtime, DeviceError>>> = Mutex::new(None);
/// How often each device was unplugged, by URI, since the process started.
static LOSSES: Mutex<BTreeMap<String, usize>> = Mutex::new(BTreeMap::new());

/// The data behind these locks are whole after every statement, so a panic elsewhere does not matter.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Runtime {
    /// The process's runtime, loaded at the first call that succeeds.
    ///
    /// # Errors
    /// [`DeviceError::NoDriver`] where the library or all of its drivers are missing.
    pub fn get() -> Result<&'static Self, DeviceError> {
        let mut slot = lock(&RUNTIME);
        if let Some(known) = &*slot {
            return known.clone();
        }
        let (api, path) = library::load()?;
        let runtime: &'static Self =
            Box::leak(Box::new(Self { api, path, calling: Mutex::new(()) }));
        slot.insert(runtime.initialize().map(|()| runtime)).clone()
    }

    fn initialize(&self) -> Result<(), DeviceError> {
        // SAFETY: called once per process, under the lock of the one runtime.
        let status = unsafe { (self.api.initialize)(ffi::API_VERSION) };
        self.check(status).map_err(|why| {
            let path = &self.path;
            DeviceError::NoDriver(format!(
                "OpenNI2 ({path}) finds no drivers: {why}; they belong into OpenNI2/Drivers beside it"
            ))
        })?;
        self.listen();
        Ok(())
    }

    fn listen(&self) {
        let callbacks = ffi::DeviceCallbacks {
            connected: None,
            disconnected: Some(device_lost),
            state_changed: None,
        };
        let mut handle = null_mut();
        // SAFETY: the callbacks are functions of this program, use no cookie, and are copied by the
        // library before it returns.
        let status = unsafe { (self.api.register_callbacks)(&callbacks, null_mut(), &mut handle) };
        if let Err(why) = self.check(status) {
            log::warn!("OpenNI2 will not say when a device is unplugged: {why}");
        }
    }

    /// The devices that are there now. Files are none.
    pub fn devices(&self) -> Result<Vec<FoundDevice>, DeviceError> {
        let (mut list, mut count) = (null_mut(), 0);
        // SAFETY: both outputs are valid; the library allocates the list.
        let status = unsafe { (self.api.device_list)(&mut list, &mut count) };
        self.check(status).map_err(|why| DeviceError::Lost(format!("devices: {why}")))?;
        let found = (0..usize::try_from(count).unwrap_or(0))
            // SAFETY: the list has `count` entries until it is released below.
            .map(|i| FoundDevice::of(unsafe { &*list.add(i) }))
            .collect();
        // SAFETY: the list is the library's own and is not used any more.
        unsafe { (self.api.release_device_list)(list) };
        Ok(found)
    }

    /// Opens a device by URI, or the first that is there.
    ///
    /// # Errors
    /// [`DeviceError::Absent`] where it is not there, [`DeviceError::Busy`] where it is and cannot be opened.
    pub fn open(&'static self, uri: Option<&str>) -> Result<Device, DeviceError> {
        let devices = self.devices()?;
        let uri = match (uri, devices.first()) {
            (Some(uri), _) => uri,
            (None, Some(first)) => &first.uri,
            (None, None) => {
                return Err(DeviceError::Absent(
                    "OpenNI2 sees no camera: is it plugged in, with power, and is there a driver for it \
                     in OpenNI2/Drivers (a Kinect needs libfreenect's)?"
                        .into(),
                ));
            }
        };
        self.open_by_name(uri).map_err(|why| {
            if devices.iter().any(|d| d.uri == uri) {
                DeviceError::Busy(format!(
                    "{uri} is there but cannot be opened ({why}): close other programs that use it, and \
                     see that its udev rule gives you access"
                ))
            } else {
                DeviceError::Absent(format!("OpenNI2 has no device {uri} ({why})"))
            }
        })
    }

    /// Opens a recording.
    pub(super) fn open_file(&'static self, path: &Path) -> Result<Device, String> {
        let path = path.canonicalize().map_err(|e| e.to_string())?;
        let name = path.to_str().ok_or("OpenNI2 opens files by names in UTF-8 only")?;
        if name.len() >= ffi::MAX_STR {
            return Err(format!(
                "OpenNI2 opens files by names of at most {} bytes",
                ffi::MAX_STR - 1
            ));
        }
        self.open_by_name(name)
    }

    fn open_by_name(&'static self, uri: &str) -> Result<Device, String> {
        let name = CString::new(uri).map_err(|_| "a name with a zero byte")?;
        let before = losses(uri);
        let _one = lock(&self.calling);
        let mut handle = null_mut();
        // SAFETY: the name is NUL-terminated, the output valid.
        let status = unsafe { (self.api.device_open)(name.as_ptr(), &mut handle) };
        // A handle that comes with an error must not be closed: that would count a device as closed that
        // was never open.
        self.check(status)?;
        Device::of(self, handle, before).ok_or_else(|| "no handle".into())
    }

    /// Waits until one of the streams has a frame; gives its position, `None` at the end of the time.
    /// Milliseconds are rounded up.
    ///
    /// # Safety
    /// The handles are those of living streams of this runtime.
    pub(super) unsafe fn wait_for_any(
        &self,
        handles: &mut [ffi::StreamHandle],
        milliseconds: c_int,
    ) -> Result<Option<usize>, DeviceError> {
        let mut index: c_int = -1;
        let count = handles.len() as c_int;
        // SAFETY: the handles are valid by the caller's promise, the output is.
        let status = unsafe {
            (self.api.wait_for_any)(handles.as_mut_ptr(), count, &mut index, milliseconds)
        };
        if status == ffi::TIME_OUT {
            return Ok(None);
        }
        self.check(status)
            .map_err(|why| DeviceError::Lost(format!("waiting for a frame: {why}")))?;
        Ok(usize::try_from(index).ok().filter(|&i| i < handles.len()))
    }

    /// What the library says about a call that failed.
    pub(super) fn check(&self, status: ffi::Status) -> Result<(), String> {
        if status == ffi::OK {
            return Ok(());
        }
        let kind = match status {
            ffi::NOT_IMPLEMENTED => "not implemented",
            ffi::NOT_SUPPORTED => "not supported",
            ffi::NO_DEVICE => "no device",
            ffi::TIME_OUT => "timed out",
            _ => "error",
        };
        // SAFETY: the text is the library's own, NUL-terminated, valid until its next call; it is copied.
        let text = unsafe { (self.api.extended_error)() };
        let text = if text.is_null() {
            String::new()
        } else {
            // SAFETY: as above.
            unsafe { CStr::from_ptr(text) }
                .to_string_lossy()
                .split_whitespace()
                .collect::<Vec<_>>()
                .join(" ")
        };
        Err(if text.is_empty() { format!("{kind} {status}") } else { text })
    }
}

impl FoundDevice {
    pub(super) fn of(info: &ffi::DeviceInfo) -> Self {
        Self { uri: text(&info.uri), vendor: text(&info.vendor), name: text(&info.name) }
    }
}

/// A field of fixed size, which need not be NUL-terminated where it is full.
fn text(field: &[c_char]) -> String {
    let bytes: Vec<u8> = field.iter().map(|&c| c as u8).take_while(|&c| c != 0).collect();
    String::from_utf8_lossy(&bytes).into_owned()
}

pub(super) fn losses(uri: &str) -> usize {
    lock(&LOSSES).get(uri).copied().unwrap_or(0)
}

/// Called by the library on a thread of its own.
unsafe extern "C" fn device_lost(info: *const ffi::DeviceInfo, _cookie: *mut c_void) {
    // SAFETY: NULL, or a description that is valid for the call.
    if let Some(info) = unsafe { info.as_ref() } {
        *lock(&LOSSES).entry(FoundDevice::of(info).uri).or_default() += 1;
    }
}
