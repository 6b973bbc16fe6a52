//! What OpenNI2 2.2 and its drivers hand to each other.

use std::ffi::{c_char, c_int, c_void};

pub const OK: c_int = 0;
pub const ERROR: c_int = 1;
pub const NOT_IMPLEMENTED: c_int = 2;
pub const BAD_PARAMETER: c_int = 4;

pub const COLOR: c_int = 2;
pub const DEPTH: c_int = 3;

pub const DEPTH_1_MM: c_int = 100;
pub const DEPTH_100_UM: c_int = 101;
pub const RGB888: c_int = 200;

pub const DEVICE_SERIAL: c_int = 3;
pub const DEVICE_REGISTRATION: c_int = 5;

pub const CROPPING: c_int = 0;
pub const HORIZONTAL_FOV: c_int = 1;
pub const VERTICAL_FOV: c_int = 2;
pub const VIDEO_MODE: c_int = 3;
pub const MAX_VALUE: c_int = 4;
pub const MIN_VALUE: c_int = 5;
pub const STRIDE: c_int = 6;
pub const MIRRORING: c_int = 7;
pub const AUTO_WHITE_BALANCE: c_int = 100;
pub const AUTO_EXPOSURE: c_int = 101;

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VideoMode {
    pub format: c_int,
    pub width: c_int,
    pub height: c_int,
    pub fps: c_int,
}

#[repr(C)]
pub struct SensorInfo {
    pub sensor: c_int,
    pub mode_count: c_int,
    pub modes: *mut VideoMode,
}

#[repr(C)]
pub struct DeviceInfo {
    pub uri: [u8; 256],
    pub vendor: [u8; 256],
    pub name: [u8; 256],
    pub usb_vendor: u16,
    pub usb_product: u16,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct Cropping {
    pub enabled: c_int,
    pub x: c_int,
    pub y: c_int,
    pub width: c_int,
    pub height: c_int,
}

#[repr(C)]
pub struct Frame {
    pub data_size: c_int,
    pub data: *mut c_void,
    pub sensor: c_int,
    pub timestamp_us: u64,
    pub index: c_int,
    pub width: c_int,
    pub height: c_int,
    pub mode: VideoMode,
    pub cropping: c_int,
    pub crop_x: c_int,
    pub crop_y: c_int,
    pub stride: c_int,
}

#[repr(C)]
pub struct StreamServices {
    pub me: *mut c_void,
    pub default_size: extern "C" fn(*mut c_void) -> c_int,
    pub acquire: extern "C" fn(*mut c_void) -> *mut Frame,
    pub add_ref: extern "C" fn(*mut c_void, *mut Frame),
    pub release: extern "C" fn(*mut c_void, *mut Frame),
}

pub type DeviceCallback = extern "C" fn(*const DeviceInfo, *mut c_void);
pub type NewFrameCallback = extern "C" fn(*mut c_void, *mut Frame, *mut c_void);
pub type PropertyCallback = extern "C" fn(*mut c_void, c_int, *const c_void, c_int, *mut c_void);

/// A fixed field of a C structure, NUL-terminated.
pub fn field(text: &str) -> [u8; 256] {
    let mut bytes = [0; 256];
    let length = text.len().min(255);
    bytes[..length].copy_from_slice(&text.as_bytes()[..length]);
    bytes
}

/// Answers a property query.
///
/// # Safety
/// `data` points to `*size` writable bytes.
pub unsafe fn put<T: Copy>(value: T, data: *mut c_void, size: *mut c_int) -> c_int {
    // SAFETY: the caller's promise; the size is checked before the write, which may be unaligned.
    unsafe {
        if usize::try_from(*size).is_ok_and(|s| s < size_of::<T>()) {
            return BAD_PARAMETER;
        }
        data.cast::<T>().write_unaligned(value);
        *size = size_of::<T>() as c_int;
    }
    OK
}

/// # Safety
/// `data` points to `size` readable bytes.
pub unsafe fn take<T: Copy>(data: *const c_void, size: c_int) -> Option<T> {
    // SAFETY: the caller's promise, and the size fits.
    (size as usize == size_of::<T>()).then(|| unsafe { data.cast::<T>().read_unaligned() })
}

/// A C string that lives as long as the library.
///
/// # Safety
/// `text` is NULL or NUL-terminated.
pub unsafe fn text<'a>(text: *const c_char) -> &'a [u8] {
    if text.is_null() {
        return &[];
    }
    // SAFETY: the caller's promise.
    unsafe { std::ffi::CStr::from_ptr(text) }.to_bytes()
}
