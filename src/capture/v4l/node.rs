//! Calls on a device node.
//!
//! The crate's calls and structures are used, not what it wraps them in: that panics at a camera's name which
//! is cut inside a character and at whatever is newer than the crate, and after a wait without a picture it
//! queues a buffer twice.

#![allow(unsafe_code, reason = "calls of the kernel")]

use super::modes::{Offered, Rates, Sizes};
use crate::image::Size;
use std::io;
use std::path::{Path, PathBuf};
use v4l::v4l_sys as sys;
use v4l::v4l2::{self, vidioc};

pub const CAPTURE: u32 = sys::v4l2_buf_type_V4L2_BUF_TYPE_VIDEO_CAPTURE;

/// A driver that numbers its formats, sizes or rates without end is not followed for ever.
const MOST_LISTED: u32 = 256;

/// Structures of the kernel's interface.
///
/// # Safety
/// Implemented for plain data only, of which all zeros are a value and whose addresses, where they have any,
/// may be NULL.
pub unsafe trait Plain: Copy {}

macro_rules! plain {
    ($($name:ident)*) => {
        // SAFETY: structures of linux/videodev2.h: numbers, arrays of numbers, unions of both; addresses in
        // them are read only for kinds of memory and controls that are not used here.
        $(unsafe impl Plain for sys::$name {})*
    };
}

plain!(
    v4l2_capability v4l2_fmtdesc v4l2_frmsizeenum v4l2_frmivalenum v4l2_format v4l2_streamparm
    v4l2_requestbuffers v4l2_buffer v4l2_control v4l2_queryctrl
);
// SAFETY: a number.
unsafe impl Plain for u32 {}

pub fn zeroed<T: Plain>() -> T {
    // SAFETY: a value, by the trait's promise.
    unsafe { std::mem::zeroed() }
}

/// What a device says it is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identity {
    pub card: String,
    pub driver: String,
    pub bus: String,
}

/// An open device node, closed when dropped.
pub struct Node {
    device: v4l::Device,
    pub path: PathBuf,
}

impl Node {
    pub fn open(path: &Path) -> io::Result<Self> {
        // The crate panics at a path with a zero byte; this says that there is no such file.
        std::fs::metadata(path)?;
        Ok(Self { device: v4l::Device::with_path(path)?, path: path.to_owned() })
    }

    pub fn fd(&self) -> std::ffi::c_int {
        self.device.handle().fd()
    }

    /// One of the requests that `T` is the structure of.
    pub fn call<T: Plain>(&self, request: vidioc::_IOC_TYPE, value: &mut T) -> io::Result<()> {
        // The number of a request holds the size of its structure.
        debug_assert_eq!((request >> 16) as usize & 0x3fff, size_of::<T>());
        loop {
            // SAFETY: the kernel reads and writes as many bytes as the value has; they outlive the call.
            let done = unsafe { v4l2::ioctl(self.fd(), request, (&raw mut *value).cast()) };
            match done {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                done => return done,
            }
        }
    }

    /// Whether a picture, or the end of the device, came in time.
    pub fn poll(&self, milliseconds: i32) -> io::Result<bool> {
        // POLLIN, the same on every Linux.
        match self.device.handle().poll(1, milliseconds) {
            Ok(ready) => Ok(ready > 0),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => Ok(false),
            Err(error) => Err(error),
        }
    }

    /// What it is, and the flags of what it can do.
    pub fn capabilities(&self) -> io::Result<(Identity, u32)> {
        let mut found: sys::v4l2_capability = zeroed();
        self.call(vidioc::VIDIOC_QUERYCAP, &mut found)?;
        // What this node does, where the device has several.
        let of_node = found.capabilities & sys::V4L2_CAP_DEVICE_CAPS != 0;
        let flags = if of_node { found.device_caps } else { found.capabilities };
        let identity = Identity {
            card: text(&found.card),
            driver: text(&found.driver),
            bus: text(&found.bus_info),
        };
        Ok((identity, flags))
    }

    /// Formats with their sizes and rates; of sizes in steps, the rates at the one nearest to `near`.
    pub fn offers(&self, near: Size) -> io::Result<Vec<Offered>> {
        let listed = listed(|index| {
            let mut found = sys::v4l2_fmtdesc { index, type_: CAPTURE, ..zeroed() };
            self.call(vidioc::VIDIOC_ENUM_FMT, &mut found).map(|()| found)
        })?;
        let offered = |format: sys::v4l2_fmtdesc| {
            let fourcc = format.pixelformat;
            // A driver without sizes to list has one: the present one.
            let sizes = self.sizes(fourcc).unwrap_or_default();
            let with_rates = |sizes: Sizes| {
                let rates = self.rates(fourcc, sizes.nearest(near)).unwrap_or_default();
                (sizes, rates)
            };
            Offered {
                fourcc: fourcc.to_le_bytes(),
                name: text(&format.description),
                sizes: sizes.into_iter().map(with_rates).collect(),
            }
        };
        Ok(listed.into_iter().map(offered).collect())
    }

    fn sizes(&self, pixel_format: u32) -> io::Result<Vec<Sizes>> {
        let listed = listed(|index| {
            let mut found = sys::v4l2_frmsizeenum { index, pixel_format, ..zeroed() };
            self.call(vidioc::VIDIOC_ENUM_FRAMESIZES, &mut found).map(|()| found)
        })?;
        let size = |width: u32, height: u32| Size::new(width as usize, height as usize);
        let sizes = |found: sys::v4l2_frmsizeenum| {
            if found.type_ == sys::v4l2_frmsizetypes_V4L2_FRMSIZE_TYPE_DISCRETE {
                // SAFETY: numbers in either member; the type says which.
                let one = unsafe { found.__bindgen_anon_1.discrete };
                return Sizes::One(size(one.width, one.height));
            }
            // SAFETY: as above.
            let steps = unsafe { found.__bindgen_anon_1.stepwise };
            Sizes::Steps {
                least: size(steps.min_width, steps.min_height),
                most: size(steps.max_width, steps.max_height),
                step: size(steps.step_width, steps.step_height),
            }
        };
        Ok(listed.into_iter().map(sizes).collect())
    }

    fn rates(&self, pixel_format: u32, size: Size) -> io::Result<Vec<Rates>> {
        let (width, height) = (size.width as u32, size.height as u32);
        let listed = listed(|index| {
            let mut found =
                sys::v4l2_frmivalenum { index, pixel_format, width, height, ..zeroed() };
            self.call(vidioc::VIDIOC_ENUM_FRAMEINTERVALS, &mut found).map(|()| found)
        })?;
        let rates = |found: sys::v4l2_frmivalenum| {
            if found.type_ == sys::v4l2_frmivaltypes_V4L2_FRMIVAL_TYPE_DISCRETE {
                // SAFETY: numbers in either member; the type says which.
                return Some(Rates::One(hz(unsafe { found.__bindgen_anon_1.discrete })?));
            }
            // SAFETY: as above.
            let steps = unsafe { found.__bindgen_anon_1.stepwise };
            // The longest interval is the lowest rate.
            Some(Rates::Between(hz(steps.max)?, hz(steps.min)?))
        };
        Ok(listed.into_iter().filter_map(rates).collect())
    }
}

/// Asks for one after another until the driver has no more.
fn listed<T>(ask: impl Fn(u32) -> io::Result<T>) -> io::Result<Vec<T>> {
    let mut all = Vec::new();
    for index in 0..MOST_LISTED {
        match ask(index) {
            Ok(one) => all.push(one),
            // The kernel's word for the end.
            Err(error) if error.kind() == io::ErrorKind::InvalidInput => break,
            Err(error) => return Err(error),
        }
    }
    Ok(all)
}

/// Of an interval; `None` of one that is none.
pub fn hz(interval: sys::v4l2_fract) -> Option<f64> {
    let rate = f64::from(interval.denominator) / f64::from(interval.numerator);
    (rate > 0.0 && rate.is_finite()).then_some(rate)
}

/// A field of fixed size, which need not be NUL-terminated where it is full, and may be cut inside a character.
fn text(field: &[u8]) -> String {
    let end = field.iter().position(|&b| b == 0).unwrap_or(field.len());
    String::from_utf8_lossy(&field[..end]).trim().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_the_kernel_has_cut_are_names() {
        assert_eq!(text(b"HD Webcam\0\0\0"), "HD Webcam");
        assert_eq!(text("Cam\u{e9}".as_bytes().split_last().unwrap().1), "Cam\u{fffd}");
        assert_eq!(text(b"full"), "full");
        assert_eq!(text(b"\0rest"), "");
    }

    #[test]
    fn intervals_that_are_none_have_no_rate() {
        let of = |numerator, denominator| hz(sys::v4l2_fract { numerator, denominator });
        assert_eq!(of(1, 30), Some(30.0));
        assert_eq!(of(0, 30), None);
        assert_eq!(of(1, 0), None);
        assert_eq!(of(0, 0), None);
    }

    #[test]
    fn what_is_no_camera_is_an_error() {
        let absent = Node::open(Path::new("/dev/no-such-video")).err().unwrap();
        assert_eq!(absent.raw_os_error(), Some(2));
        assert!(Node::open(Path::new("/dev/vid\0eo")).is_err());
        let null = Node::open(Path::new("/dev/null")).unwrap();
        assert_eq!(null.capabilities().unwrap_err().raw_os_error(), Some(25));
        assert!(null.offers(Size::new(640, 480)).is_err());
    }

    #[test]
    fn a_list_without_end_has_one() {
        assert_eq!(listed(Ok).unwrap().len(), MOST_LISTED as usize);
        let three = |index| match index {
            3 => Err(io::Error::from_raw_os_error(22)),
            index => Ok(index),
        };
        assert_eq!(listed(three).unwrap(), [0, 1, 2]);
        assert!(listed(|_| Err::<(), _>(io::Error::from_raw_os_error(19))).is_err());
    }
}
