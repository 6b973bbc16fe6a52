//! An open device, its streams and its frames, closed and released when dropped.

#![allow(unsafe_code, reason = "calls of a C library")]

use super::ffi::{self, VideoMode};
use super::runtime::{FoundDevice, Runtime, losses};
use crate::capture::live::DeviceError;
use std::ffi::{c_int, c_void};
use std::marker::PhantomData;
use std::ptr::{NonNull, null_mut};
use std::sync::Arc;
use std::time::Duration;

/// Values that properties consist of.
///
/// # Safety
/// Implemented for plain data only, where every bit pattern is a value.
unsafe trait Plain: Copy + Default {}
// SAFETY: numbers.
unsafe impl Plain for c_int {}
// SAFETY: numbers.
unsafe impl Plain for f32 {}
// SAFETY: four numbers.
unsafe impl Plain for VideoMode {}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sensor {
    Depth,
    Color,
}

impl Sensor {
    fn code(self) -> c_int {
        match self {
            Self::Depth => ffi::SENSOR_DEPTH,
            Self::Color => ffi::SENSOR_COLOR,
        }
    }
}

/// An open device or recording.
pub struct Device {
    pub(super) runtime: &'static Runtime,
    handle: NonNull<c_void>,
    found: FoundDevice,
    /// How often it had been unplugged before it was opened.
    losses_before: usize,
}

// SAFETY: OpenNI2 locks its objects; nothing in them belongs to a thread.
unsafe impl Send for Device {}
// SAFETY: as above; `&Device` gives only calls that the library itself serialises.
unsafe impl Sync for Device {}

impl Device {
    pub(super) fn of(
        runtime: &'static Runtime,
        handle: ffi::DeviceHandle,
        losses_before: usize,
    ) -> Option<Self> {
        let handle = NonNull::new(handle)?;
        let mut info = ffi::DeviceInfo::EMPTY;
        // SAFETY: the handle is that of an open device, the output valid.
        unsafe { (runtime.api.device_info)(handle.as_ptr(), &mut info) };
        Some(Self { runtime, handle, found: FoundDevice::of(&info), losses_before })
    }

    pub fn found(&self) -> &FoundDevice {
        &self.found
    }

    /// It was unplugged after it was opened, and stays lost for this handle even when it is back.
    pub fn is_lost(&self) -> bool {
        losses(&self.found.uri) > self.losses_before
    }

    /// Every mode that a sensor offers; empty where there is no such sensor.
    pub fn modes(&self, sensor: Sensor) -> Vec<VideoMode> {
        // SAFETY: the device is open; the answer is NULL or lives as long as the device.
        let info = unsafe { (self.runtime.api.device_sensor)(self.handle.as_ptr(), sensor.code()) };
        let Some(info) = NonNull::new(info.cast_mut()) else { return Vec::new() };
        // SAFETY: see above.
        let info = unsafe { info.as_ref() };
        match usize::try_from(info.mode_count) {
            // SAFETY: the library gives so many modes; they are copied.
            Ok(count) if !info.modes.is_null() => {
                unsafe { std::slice::from_raw_parts(info.modes, count) }.to_vec()
            }
            _ => Vec::new(),
        }
    }

    fn get<T: Plain>(&self, property: c_int) -> Option<T> {
        let (mut value, mut size) = (T::default(), size_of::<T>() as c_int);
        let data = (&raw mut value).cast();
        // SAFETY: `value` is plain data and has room for `size` bytes.
        let status = unsafe {
            (self.runtime.api.device_get)(self.handle.as_ptr(), property, data, &mut size)
        };
        (status == ffi::OK && size as usize == size_of::<T>()).then_some(value)
    }

    fn set<T: Plain>(&self, property: c_int, value: T) -> Result<(), String> {
        let (data, size) = ((&raw const value).cast(), size_of::<T>() as c_int);
        // SAFETY: `value` has `size` bytes and outlives the call.
        let status =
            unsafe { (self.runtime.api.device_set)(self.handle.as_ptr(), property, data, size) };
        self.runtime.check(status)
    }

    /// Whether the device can deliver depth as its colour camera sees it.
    pub fn offers_registration(&self) -> bool {
        let mode = ffi::REGISTRATION_DEPTH_TO_COLOR;
        // SAFETY: the device is open.
        unsafe { (self.runtime.api.device_registers)(self.handle.as_ptr(), mode) != 0 }
    }

    /// What the device says that it does; of a recording, what was so when it was made.
    pub fn registration(&self) -> Option<bool> {
        self.get::<c_int>(ffi::DEVICE_REGISTRATION).map(|v| v != ffi::REGISTRATION_OFF)
    }

    pub fn set_registration(&self, on: bool) -> Result<(), String> {
        let value = if on { ffi::REGISTRATION_DEPTH_TO_COLOR } else { ffi::REGISTRATION_OFF };
        self.set(ffi::DEVICE_REGISTRATION, value)
    }

    /// Depth and colour exposed together and delivered by equal frame numbers. Both streams must have been
    /// started: the library synchronises those that run at the time of this call.
    pub fn enable_sync(&self) -> Result<(), String> {
        // SAFETY: the device is open.
        self.runtime.check(unsafe { (self.runtime.api.device_sync)(self.handle.as_ptr()) })
    }

    /// Of a recording: one frame whenever one is waited for, and from the start again after the last.
    pub fn play_by_request(&self) -> Result<(), String> {
        self.set(ffi::DEVICE_PLAYBACK_REPEAT, 1 as c_int)?;
        self.set(ffi::DEVICE_PLAYBACK_SPEED, -1.0f32)
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: the handle was opened once and is closed once; streams hold the device, so none is left.
        unsafe { (self.runtime.api.device_close)(self.handle.as_ptr()) };
    }
}

/// A sensor's stream of frames.
pub struct Stream {
    pub(super) device: Arc<Device>,
    handle: NonNull<c_void>,
}

// SAFETY: as for `Device`. Not `Sync`: a stream is read from one thread at a time.
unsafe impl Send for Stream {}

impl Stream {
    pub fn new(device: &Arc<Device>, sensor: Sensor) -> Result<Self, String> {
        let (runtime, mut handle) = (device.runtime, null_mut());
        // SAFETY: the device is open, the output valid.
        let status = unsafe {
            (runtime.api.stream_create)(device.handle.as_ptr(), sensor.code(), &mut handle)
        };
        runtime.check(status)?;
        let handle = NonNull::new(handle).ok_or("no handle")?;
        Ok(Self { device: Arc::clone(device), handle })
    }

    fn api(&self) -> &'static ffi::Api {
        &self.device.runtime.api
    }

    pub(super) fn raw(&self) -> ffi::StreamHandle {
        self.handle.as_ptr()
    }

    fn get<T: Plain>(&self, property: c_int) -> Option<T> {
        let (mut value, mut size) = (T::default(), size_of::<T>() as c_int);
        let data = (&raw mut value).cast();
        // SAFETY: `value` is plain data and has room for `size` bytes.
        let status = unsafe { (self.api().stream_get)(self.raw(), property, data, &mut size) };
        (status == ffi::OK && size as usize == size_of::<T>()).then_some(value)
    }

    fn set<T: Plain>(&self, property: c_int, value: T) -> Result<(), String> {
        let (data, size) = ((&raw const value).cast(), size_of::<T>() as c_int);
        // SAFETY: `value` has `size` bytes and outlives the call.
        let status = unsafe { (self.api().stream_set)(self.raw(), property, data, size) };
        self.device.runtime.check(status)
    }

    fn has(&self, property: c_int) -> bool {
        // SAFETY: the stream exists.
        unsafe { (self.api().stream_has)(self.raw(), property) != 0 }
    }

    pub fn mode(&self) -> Option<VideoMode> {
        self.get(ffi::STREAM_VIDEO_MODE)
    }

    pub fn set_mode(&self, mode: VideoMode) -> Result<(), String> {
        self.set(ffi::STREAM_VIDEO_MODE, mode)
    }

    /// Horizontal and vertical field of view, radians. Asked for without asking whether it is there: players
    /// of recordings deny what they then give.
    pub fn fov(&self) -> Option<[f32; 2]> {
        Some([self.get(ffi::STREAM_HORIZONTAL_FOV)?, self.get(ffi::STREAM_VERTICAL_FOV)?])
    }

    /// Left and right are exchanged: the usual state of many sensors.
    pub fn is_mirrored(&self) -> bool {
        self.get::<c_int>(ffi::STREAM_MIRRORING).is_some_and(|v| v != 0)
    }

    pub fn stop_mirroring(&self) -> Result<(), String> {
        self.set(ffi::STREAM_MIRRORING, 0 as c_int)
    }

    /// Exposure and white balance stay as they are now; says which cannot be held.
    pub fn lock_exposure(&self) -> Result<(), String> {
        let controls = [
            ("exposure", ffi::STREAM_AUTO_EXPOSURE),
            ("white balance", ffi::STREAM_AUTO_WHITE_BALANCE),
        ];
        let free: Vec<_> = controls
            .into_iter()
            .filter(|&(_, property)| !self.has(property) || self.set(property, 0 as c_int).is_err())
            .map(|(name, _)| name)
            .collect();
        if free.is_empty() { Ok(()) } else { Err(free.join(" and ")) }
    }

    /// Of a recording.
    pub fn frame_count(&self) -> Option<usize> {
        self.get::<c_int>(ffi::STREAM_FRAME_COUNT).and_then(|n| usize::try_from(n).ok())
    }

    pub fn start(&self) -> Result<(), String> {
        // SAFETY: the stream exists.
        self.device.runtime.check(unsafe { (self.api().stream_start)(self.raw()) })
    }

    pub fn stop(&self) {
        // SAFETY: the stream exists; stopping a stopped one does nothing.
        unsafe { (self.api().stream_stop)(self.raw()) };
    }

    /// Waits until one of the streams has a frame; gives its position. `None` at the end of the time.
    pub fn wait_any(streams: &[&Self], timeout: Duration) -> Result<Option<usize>, DeviceError> {
        let Some(first) = streams.first() else { return Ok(None) };
        let milliseconds = timeout.as_micros().div_ceil(1000).min(c_int::MAX as u128) as c_int;
        let mut handles: Vec<_> = streams.iter().map(|stream| stream.raw()).collect();
        // SAFETY: the streams exist, and the runtime is one per process.
        unsafe { first.device.runtime.wait_for_any(&mut handles, milliseconds) }
    }

    /// The newest frame. Without one this blocks for ever: [wait](Self::wait_any) first.
    pub fn read(&self) -> Result<FrameRef<'_>, DeviceError> {
        let mut frame = null_mut();
        // SAFETY: the stream exists, the output is valid.
        let status = unsafe { (self.api().stream_read)(self.raw(), &mut frame) };
        let lost = |why| DeviceError::Lost(format!("reading a frame: {why}"));
        self.device.runtime.check(status).map_err(lost)?;
        let frame = NonNull::new(frame).ok_or_else(|| {
            DeviceError::BadFrame("the driver announced a frame and gave none".into())
        })?;
        Ok(FrameRef { api: self.api(), frame, _stream: PhantomData })
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        // SAFETY: created once, destroyed once; frames borrow the stream, so none is left.
        unsafe { (self.api().stream_destroy)(self.raw()) };
    }
}

/// A frame of the library's, given back when dropped.
pub struct FrameRef<'stream> {
    api: &'static ffi::Api,
    frame: NonNull<ffi::Frame>,
    _stream: PhantomData<&'stream Stream>,
}

impl FrameRef<'_> {
    /// What the driver says about the frame; nothing of it has been checked.
    pub fn header(&self) -> &ffi::Frame {
        // SAFETY: the library does not change a frame between reading and release.
        unsafe { self.frame.as_ref() }
    }

    /// The bytes that the driver says it has written.
    pub fn data(&self) -> &[u8] {
        let (header, data) = (self.header(), self.header().data.cast::<u8>());
        match usize::try_from(header.data_size) {
            // SAFETY: the buffer has `data_size` bytes at least and is not written to any more.
            Ok(size) if !data.is_null() => unsafe { std::slice::from_raw_parts(data, size) },
            _ => &[],
        }
    }
}

impl Drop for FrameRef<'_> {
    fn drop(&mut self) {
        // SAFETY: read once, released once.
        unsafe { (self.api.frame_release)(self.frame.as_ptr()) };
    }
}
