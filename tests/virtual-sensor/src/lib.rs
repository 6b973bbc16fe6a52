//! An OpenNI2 driver without a sensor: plays the folder that `KINLIGHT_VIRTUAL_SENSOR` names as the
//! device `virtual://kinlight`. The folder's content: [`script`].
#![allow(non_snake_case, clippy::missing_safety_doc, clippy::not_unsafe_ptr_arg_deref)]

mod abi;
mod script;
mod sensor;

use abi::*;
use script::{Fault, Moment, Script};
use sensor::{ANNOUNCER, Address, Announcer, Device, PLUGGED, SCRIPT, Stream, URI, announce, lock};
use std::ffi::{c_char, c_int, c_void};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};

/// How often the device was opened.
static OPENED: AtomicUsize = AtomicUsize::new(0);

// All pointers below are the library's, valid for the call, or were made here by `Box::into_raw` and not
// yet freed: OpenNI2 serialises the calls on a device and on a stream. That is the safety of every block.

#[unsafe(no_mangle)]
pub extern "C" fn oniDriverCreate(_services: *mut c_void) {}

#[unsafe(no_mangle)]
pub extern "C" fn oniDriverDestroy() {
    *lock(&ANNOUNCER) = None;
}

#[unsafe(no_mangle)]
pub extern "C" fn oniDriverInitialize(
    connected: DeviceCallback,
    disconnected: DeviceCallback,
    _state_changed: *const c_void,
    cookie: *mut c_void,
) -> c_int {
    let Some(folder) = std::env::var_os("KINLIGHT_VIRTUAL_SENSOR") else { return ERROR };
    match Script::read(Path::new(&folder)) {
        Ok(script) => {
            script.go_wrong_at(Moment::Initialize);
            let present = !script.has(Fault::Absent);
            *lock(&SCRIPT) = Some(Arc::new(script));
            *lock(&ANNOUNCER) =
                Some(Announcer { connected, disconnected, cookie: Address(cookie) });
            if present {
                announce(true);
            }
            OK
        }
        Err(problem) => {
            eprintln!("virtual sensor: {problem}");
            ERROR
        }
    }
}

/// Opening by name does not bring the device back: it is announced or not there.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oniDriverTryDevice(uri: *const c_char) -> c_int {
    let ours = unsafe { text(uri) } == URI.as_bytes();
    if ours && PLUGGED.load(SeqCst) { OK } else { ERROR }
}

#[unsafe(no_mangle)]
pub extern "C" fn oniDriverDeviceOpen(_uri: *const c_char, _mode: *const c_char) -> *mut Device {
    let Some(script) = lock(&SCRIPT).clone().filter(|s| !s.has(Fault::Busy)) else {
        return std::ptr::null_mut();
    };
    script.go_wrong_at(Moment::Open);
    let before = OPENED.fetch_add(1, SeqCst);
    script.note("open", before);
    if before > 0 {
        std::thread::sleep(script.reopen);
    }
    Box::into_raw(Box::new(Device::new(script)))
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn oniDriverDeviceClose(device: *mut Device) {
    drop(unsafe { Box::from_raw(device) });
}

/// Any address but NULL says that frames are synchronised.
#[unsafe(no_mangle)]
pub extern "C" fn oniDriverEnableFrameSync(_streams: *mut *mut Stream, _n: c_int) -> *mut c_void {
    let offered = lock(&SCRIPT).as_ref().is_some_and(|s| s.sync);
    std::ptr::without_provenance_mut(usize::from(offered))
}

#[unsafe(no_mangle)]
pub extern "C" fn oniDriverDisableFrameSync(_group: *mut c_void) {}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn oniDriverDeviceGetSensorInfoList(
    device: *mut Device,
    sensors: *mut *mut SensorInfo,
    count: *mut c_int,
) -> c_int {
    unsafe {
        let list = &mut (*device).sensors;
        *sensors = list.as_mut_ptr();
        *count = list.len() as c_int;
    }
    OK
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn oniDriverDeviceCreateStream(
    device: *mut Device,
    sensor: c_int,
) -> *mut Stream {
    let shared = Arc::clone(unsafe { &(*device).shared });
    if sensor != DEPTH && (sensor != COLOR || !shared.script.has_color()) {
        return std::ptr::null_mut();
    }
    Box::into_raw(Box::new(Stream::new(sensor, shared)))
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn oniDriverDeviceDestroyStream(_device: *mut Device, stream: *mut Stream) {
    unsafe { Box::from_raw(stream) }.stop();
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn oniDriverDeviceSetProperty(
    device: *mut Device,
    property: c_int,
    data: *const c_void,
    size: c_int,
) -> c_int {
    let device = unsafe { &mut *device };
    match unsafe { take::<c_int>(data, size) } {
        Some(value) if property == DEVICE_REGISTRATION && device.shared.script.registration => {
            device.registration = value;
            OK
        }
        _ => NOT_IMPLEMENTED,
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn oniDriverDeviceGetProperty(
    device: *mut Device,
    property: c_int,
    data: *mut c_void,
    size: *mut c_int,
) -> c_int {
    match property {
        DEVICE_REGISTRATION => unsafe { put((*device).registration, data, size) },
        DEVICE_SERIAL => unsafe { put(*b"VIRT0001\0", data, size) },
        _ => NOT_IMPLEMENTED,
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn oniDriverDeviceIsPropertySupported(_d: *mut Device, property: c_int) -> c_int {
    c_int::from(property == DEVICE_REGISTRATION || property == DEVICE_SERIAL)
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn oniDriverDeviceSetPropertyChangedCallback(
    device: *mut Device,
    callback: PropertyCallback,
    cookie: *mut c_void,
) {
    unsafe { (*device).property = Some((callback, Address(cookie))) };
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn oniDriverDeviceNotifyAllProperties(device: *mut Device) {
    let (value, told) = unsafe { ((*device).registration, (*device).property) };
    if let Some((callback, cookie)) = told {
        callback(device.cast(), DEVICE_REGISTRATION, (&raw const value).cast(), 4, cookie.0);
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn oniDriverDeviceInvoke(
    _device: *mut Device,
    _command: c_int,
    _data: *mut c_void,
    _size: c_int,
) -> c_int {
    NOT_IMPLEMENTED
}

#[unsafe(no_mangle)]
pub extern "C" fn oniDriverDeviceIsCommandSupported(
    _device: *mut Device,
    _command: c_int,
) -> c_int {
    0
}

/// The library calls this whenever a reader waits and no frame is there.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oniDriverDeviceTryManualTrigger(device: *mut Device) -> c_int {
    let shared = Arc::clone(unsafe { &(*device).shared });
    shared.poked();
    OK
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn oniDriverDeviceIsImageRegistrationModeSupported(
    device: *mut Device,
    mode: c_int,
) -> c_int {
    c_int::from(mode == 0 || unsafe { &*device }.shared.script.registration)
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn oniDriverStreamSetServices(
    stream: *mut Stream,
    services: *mut StreamServices,
) {
    unsafe { (*stream).services = services };
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn oniDriverStreamSetProperty(
    stream: *mut Stream,
    property: c_int,
    data: *const c_void,
    size: c_int,
) -> c_int {
    unsafe { (*stream).set(property, data, size) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn oniDriverStreamGetProperty(
    stream: *mut Stream,
    property: c_int,
    data: *mut c_void,
    size: *mut c_int,
) -> c_int {
    unsafe { (*stream).get(property, data, size) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn oniDriverStreamIsPropertySupported(
    stream: *mut Stream,
    property: c_int,
) -> c_int {
    c_int::from(unsafe { (*stream).has(property) })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn oniDriverStreamSetPropertyChangedCallback(
    stream: *mut Stream,
    callback: PropertyCallback,
    cookie: *mut c_void,
) {
    unsafe { (*stream).property = Some((callback, Address(cookie))) };
}

/// Recorders ask for this; the player delivers nothing of a recording without stride and cropping.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oniDriverStreamNotifyAllProperties(stream: *mut Stream) {
    let Some((callback, cookie)) = (unsafe { (*stream).property }) else { return };
    let all = [
        STRIDE,
        MAX_VALUE,
        MIN_VALUE,
        HORIZONTAL_FOV,
        VERTICAL_FOV,
        MIRRORING,
        CROPPING,
        VIDEO_MODE,
    ];
    for property in all {
        let mut bytes = [0u64; 4];
        let mut size = size_of_val(&bytes) as c_int;
        if unsafe { (*stream).get(property, bytes.as_mut_ptr().cast(), &mut size) } == OK {
            callback(stream.cast(), property, bytes.as_ptr().cast(), size, cookie.0);
        }
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn oniDriverStreamInvoke(
    _stream: *mut Stream,
    _command: c_int,
    _data: *mut c_void,
    _size: c_int,
) -> c_int {
    NOT_IMPLEMENTED
}

#[unsafe(no_mangle)]
pub extern "C" fn oniDriverStreamIsCommandSupported(
    _stream: *mut Stream,
    _command: c_int,
) -> c_int {
    0
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn oniDriverStreamGetRequiredFrameSize(stream: *mut Stream) -> c_int {
    let stream = unsafe { &*stream };
    let mode = stream.device.mode(stream.sensor);
    mode.width * mode.height * if stream.sensor == DEPTH { 2 } else { 3 }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn oniDriverStreamSetNewFrameCallback(
    stream: *mut Stream,
    callback: NewFrameCallback,
    cookie: *mut c_void,
) {
    unsafe { (*stream).new_frame = Some((callback, Address(cookie))) };
}

#[unsafe(no_mangle)]
pub extern "C" fn oniDriverStreamConvertDepthToColorCoordinates(
    _depth: *mut Stream,
    _color: *mut Stream,
    _x: c_int,
    _y: c_int,
    _z: u16,
    _color_x: *mut c_int,
    _color_y: *mut c_int,
) -> c_int {
    NOT_IMPLEMENTED
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn oniDriverStreamStart(stream: *mut Stream) -> c_int {
    let device = Arc::clone(unsafe { &(*stream).device });
    device.script.go_wrong_at(Moment::Start);
    unsafe { (*stream).start(stream.cast()) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn oniDriverStreamStop(stream: *mut Stream) {
    unsafe { (*stream).stop() };
}
