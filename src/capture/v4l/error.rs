//! What the kernel's errors mean, and what to do.

use crate::capture::live::DeviceError;
use std::io;
use std::path::Path;

/// Numbers of errors, the same on every Linux that cameras are on.
mod errno {
    pub const EPERM: i32 = 1;
    pub const ENOENT: i32 = 2;
    pub const EIO: i32 = 5;
    pub const ENXIO: i32 = 6;
    pub const EACCES: i32 = 13;
    pub const EBUSY: i32 = 16;
    pub const ENODEV: i32 = 19;
    pub const ENOTTY: i32 = 25;
    pub const ENOSPC: i32 = 28;
}

/// `doing` is what the call was for. What may be better at the next attempt is never
/// [`DeviceError::Unsupported`].
pub fn explain(path: &Path, doing: &str, error: &io::Error) -> DeviceError {
    let path = path.display();
    match error.raw_os_error() {
        Some(errno::ENOENT) => DeviceError::Absent(format!(
            "{path} is not there: is the camera plugged in, and is its driver loaded (uvcvideo for most)?"
        )),
        Some(errno::ENODEV | errno::ENXIO) => {
            DeviceError::Lost(format!("{path} was unplugged ({doing}: {error})"))
        }
        Some(errno::EIO) => {
            DeviceError::Lost(format!("{path} has stopped or was unplugged ({doing}: {error})"))
        }
        Some(errno::EBUSY) => DeviceError::Busy(format!(
            "{path} is used by another program: close it (`fuser -v {path}` names it)"
        )),
        Some(errno::EACCES | errno::EPERM) => DeviceError::Busy(format!(
            "{path} may not be opened by this user: join the group video (`sudo usermod -aG video $USER`, \
             then log in again)"
        )),
        Some(errno::ENOTTY) => DeviceError::Unsupported(format!("{path} is no V4L2 device")),
        Some(errno::ENOSPC) => DeviceError::Busy(format!(
            "{path}: its bus has no room left for such pictures: take a smaller --size or --fps, or another \
             USB port"
        )),
        _ => DeviceError::Lost(format!("{path}: {doing}: {error}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_error_says_what_to_do() {
        let path = Path::new("/dev/video7");
        let of = |number| explain(path, "starting", &io::Error::from_raw_os_error(number));
        for (number, said) in [
            (errno::ENOENT, "plugged in"),
            (errno::ENODEV, "was unplugged"),
            (errno::EIO, "stopped"),
            (errno::EBUSY, "fuser -v /dev/video7"),
            (errno::EACCES, "group video"),
            (errno::EPERM, "group video"),
            (errno::ENOTTY, "no V4L2 device"),
            (errno::ENOSPC, "--size"),
            (22, "starting"),
        ] {
            let (error, text) = (of(number), of(number).to_string());
            assert!(text.contains(said) && text.contains("/dev/video7"), "{text}");
            let kind = match number {
                errno::ENOENT => matches!(error, DeviceError::Absent(_)),
                errno::EBUSY | errno::EACCES | errno::EPERM | errno::ENOSPC => {
                    matches!(error, DeviceError::Busy(_))
                }
                errno::ENOTTY => matches!(error, DeviceError::Unsupported(_)),
                _ => matches!(error, DeviceError::Lost(_)),
            };
            assert!(kind, "{error:?}");
        }
    }
}
