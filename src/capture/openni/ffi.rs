//! The part of OpenNI 2.2's C interface that is used here: structures as they lie in memory, and
//! functions found by name when the library is loaded.

#![allow(unsafe_code, reason = "calls of a C library")]

use libloading::{Error, Library};
use std::ffi::{c_char, c_int, c_void};

/// Major times 1000 plus minor version of this interface.
pub const API_VERSION: c_int = 2002;

pub type Status = c_int;
pub const OK: Status = 0;
pub const NOT_IMPLEMENTED: Status = 2;
pub const NOT_SUPPORTED: Status = 3;
pub const NO_DEVICE: Status = 6;
pub const TIME_OUT: Status = 102;

pub const SENSOR_COLOR: c_int = 2;
pub const SENSOR_DEPTH: c_int = 3;

pub const DEPTH_1_MM: c_int = 100;
pub const DEPTH_100_UM: c_int = 101;
pub const RGB888: c_int = 200;

pub const DEVICE_REGISTRATION: c_int = 5;
pub const DEVICE_PLAYBACK_SPEED: c_int = 100;
pub const DEVICE_PLAYBACK_REPEAT: c_int = 101;

pub const STREAM_HORIZONTAL_FOV: c_int = 1;
pub const STREAM_VERTICAL_FOV: c_int = 2;
pub const STREAM_VIDEO_MODE: c_int = 3;
pub const STREAM_MIRRORING: c_int = 7;
pub const STREAM_FRAME_COUNT: c_int = 8;
pub const STREAM_AUTO_WHITE_BALANCE: c_int = 100;
pub const STREAM_AUTO_EXPOSURE: c_int = 101;

pub const REGISTRATION_OFF: c_int = 0;
pub const REGISTRATION_DEPTH_TO_COLOR: c_int = 1;

/// Size of text fields, with the NUL.
pub const MAX_STR: usize = 256;

/// Opaque objects of the library.
pub type DeviceHandle = *mut c_void;
pub type StreamHandle = *mut c_void;
pub type RecorderHandle = *mut c_void;
pub type CallbackHandle = *mut c_void;

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct VideoMode {
    pub pixel_format: c_int,
    pub width: c_int,
    pub height: c_int,
    pub fps: c_int,
}

#[repr(C)]
pub struct SensorInfo {
    pub sensor_type: c_int,
    pub mode_count: c_int,
    pub modes: *const VideoMode,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct DeviceInfo {
    pub uri: [c_char; MAX_STR],
    pub vendor: [c_char; MAX_STR],
    pub name: [c_char; MAX_STR],
    pub usb_vendor: u16,
    pub usb_product: u16,
}

impl DeviceInfo {
    pub const EMPTY: Self = Self {
        uri: [0; MAX_STR],
        vendor: [0; MAX_STR],
        name: [0; MAX_STR],
        usb_vendor: 0,
        usb_product: 0,
    };
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct Version {
    pub major: c_int,
    pub minor: c_int,
    pub maintenance: c_int,
    pub build: c_int,
}

#[repr(C)]
pub struct Frame {
    pub data_size: c_int,
    pub data: *const c_void,
    pub sensor_type: c_int,
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

pub type DeviceCallback = unsafe extern "C" fn(*const DeviceInfo, *mut c_void);
pub type StateCallback = unsafe extern "C" fn(*const DeviceInfo, c_int, *mut c_void);

#[repr(C)]
pub struct DeviceCallbacks {
    pub connected: Option<DeviceCallback>,
    pub disconnected: Option<DeviceCallback>,
    pub state_changed: Option<StateCallback>,
}

// Against OniCTypes.h of 2.2.0.33, as the C compiler lays it out.
#[cfg(target_pointer_width = "64")]
const _: () = {
    use std::mem::offset_of;
    assert!(size_of::<VideoMode>() == 16);
    assert!(size_of::<SensorInfo>() == 16);
    assert!(size_of::<DeviceInfo>() == 772);
    assert!(size_of::<DeviceCallbacks>() == 24);
    assert!(size_of::<Frame>() == 80);
    assert!(offset_of!(Frame, data) == 8);
    assert!(offset_of!(Frame, timestamp_us) == 24);
    assert!(offset_of!(Frame, mode) == 44);
    assert!(offset_of!(Frame, stride) == 72);
};

macro_rules! functions {
    ($($name:ident = $symbol:literal: fn($($argument:ty),*) $(-> $result:ty)?;)*) => {
        /// The functions of a loaded library.
        pub struct Api {
            $(pub $name: unsafe extern "C" fn($($argument),*) $(-> $result)?,)*
            /// Keeps the code in memory that the pointers point to.
            _library: Library,
        }

        impl Api {
            /// Finds every function.
            ///
            /// # Safety
            /// The library must be OpenNI 2: names are all that is checked.
            pub unsafe fn of(library: Library) -> Result<Self, Error> {
                // SAFETY: by the caller's promise the functions have the types that the header gives
                // them, which are those listed below; the pointers stay with the library.
                unsafe {
                    Ok(Self {
                        $($name: *library.get(concat!($symbol, "\0").as_bytes())?,)*
                        _library: library,
                    })
                }
            }
        }
    };
}

functions! {
    initialize = "oniInitialize": fn(c_int) -> Status;
    version = "oniGetVersion": fn() -> Version;
    extended_error = "oniGetExtendedError": fn() -> *const c_char;
    device_list = "oniGetDeviceList": fn(*mut *mut DeviceInfo, *mut c_int) -> Status;
    release_device_list = "oniReleaseDeviceList": fn(*mut DeviceInfo) -> Status;
    register_callbacks = "oniRegisterDeviceCallbacks": fn(*const DeviceCallbacks, *mut c_void, *mut CallbackHandle) -> Status;
    wait_for_any = "oniWaitForAnyStream": fn(*mut StreamHandle, c_int, *mut c_int, c_int) -> Status;
    device_open = "oniDeviceOpen": fn(*const c_char, *mut DeviceHandle) -> Status;
    device_close = "oniDeviceClose": fn(DeviceHandle) -> Status;
    device_info = "oniDeviceGetInfo": fn(DeviceHandle, *mut DeviceInfo) -> Status;
    device_sensor = "oniDeviceGetSensorInfo": fn(DeviceHandle, c_int) -> *const SensorInfo;
    device_set = "oniDeviceSetProperty": fn(DeviceHandle, c_int, *const c_void, c_int) -> Status;
    device_get = "oniDeviceGetProperty": fn(DeviceHandle, c_int, *mut c_void, *mut c_int) -> Status;
    device_registers = "oniDeviceIsImageRegistrationModeSupported": fn(DeviceHandle, c_int) -> c_int;
    device_sync = "oniDeviceEnableDepthColorSync": fn(DeviceHandle) -> Status;
    stream_create = "oniDeviceCreateStream": fn(DeviceHandle, c_int, *mut StreamHandle) -> Status;
    stream_destroy = "oniStreamDestroy": fn(StreamHandle);
    stream_start = "oniStreamStart": fn(StreamHandle) -> Status;
    stream_stop = "oniStreamStop": fn(StreamHandle);
    stream_read = "oniStreamReadFrame": fn(StreamHandle, *mut *mut Frame) -> Status;
    stream_set = "oniStreamSetProperty": fn(StreamHandle, c_int, *const c_void, c_int) -> Status;
    stream_get = "oniStreamGetProperty": fn(StreamHandle, c_int, *mut c_void, *mut c_int) -> Status;
    stream_has = "oniStreamIsPropertySupported": fn(StreamHandle, c_int) -> c_int;
    frame_release = "oniFrameRelease": fn(*mut Frame);
    recorder_create = "oniCreateRecorder": fn(*const c_char, *mut RecorderHandle) -> Status;
    recorder_attach = "oniRecorderAttachStream": fn(RecorderHandle, StreamHandle, c_int) -> Status;
    recorder_start = "oniRecorderStart": fn(RecorderHandle) -> Status;
    recorder_stop = "oniRecorderStop": fn(RecorderHandle);
    recorder_destroy = "oniRecorderDestroy": fn(*mut RecorderHandle) -> Status;
}
