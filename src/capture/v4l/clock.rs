//! When a picture was taken.

#![allow(unsafe_code, reason = "calls of the kernel")]

use std::ffi::{c_int, c_long};
use std::time::{Duration, Instant};
use v4l::v4l_sys as sys;

/// Drivers that calculate times from the rate may be ahead: vivid by up to 1.4 periods, which this is of 5
/// pictures a second.
const AHEAD: Duration = Duration::from_millis(280);

unsafe extern "C" {
    fn clock_gettime(clock: c_int, time: *mut sys::timespec) -> c_int;
}

/// The same on every Linux. It is also the clock behind [`Instant`], which does not show its numbers.
const CLOCK_MONOTONIC: c_int = 1;

fn monotonic_now() -> Option<Duration> {
    let mut time = sys::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: the output is valid.
    let status = unsafe { clock_gettime(CLOCK_MONOTONIC, &mut time) };
    duration(time.tv_sec, time.tv_nsec).filter(|_| status == 0)
}

/// `None` where either is negative.
fn duration(seconds: c_long, nanoseconds: c_long) -> Option<Duration> {
    let nanoseconds = u64::try_from(nanoseconds).ok()?;
    Duration::from_secs(seconds.try_into().ok()?).checked_add(Duration::from_nanos(nanoseconds))
}

/// Whether a driver's times are of the clock that has no jumps.
pub fn is_monotonic(flags: u32) -> bool {
    flags & sys::V4L2_BUF_FLAG_TIMESTAMP_MASK == sys::V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC
}

/// Whether its times are of the start of the exposure; else of the last byte.
pub fn is_of_exposure(flags: u32) -> bool {
    flags & sys::V4L2_BUF_FLAG_TSTAMP_SRC_MASK == sys::V4L2_BUF_FLAG_TSTAMP_SRC_SOE
}

/// When a picture was taken by a driver's word. `None` where it does not say, or says what cannot be: in the
/// future, or before the camera was `started`.
pub fn taken(timestamp: sys::timeval, flags: u32, started: Instant) -> Option<Instant> {
    let now = Instant::now();
    taken_by(now, monotonic_now()?, timestamp, flags).filter(|taken| *taken >= started)
}

fn taken_by(
    now: Instant,
    monotonic_now: Duration,
    timestamp: sys::timeval,
    flags: u32,
) -> Option<Instant> {
    if !is_monotonic(flags) {
        return None;
    }
    let taken = duration(timestamp.tv_sec, timestamp.tv_usec.checked_mul(1000)?)?;
    match monotonic_now.checked_sub(taken) {
        Some(age) => now.checked_sub(age),
        None => {
            Some(taken - monotonic_now).filter(|a| *a <= AHEAD).and_then(|a| now.checked_add(a))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MONOTONIC: u32 = sys::V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;

    #[test]
    fn the_system_has_the_clock_and_it_goes_as_instants_do() {
        let (before, a) = (Instant::now(), monotonic_now().unwrap());
        std::thread::sleep(Duration::from_millis(20));
        let (b, after) = (monotonic_now().unwrap(), Instant::now());
        assert!(b - a >= Duration::from_millis(20) && b - a <= after - before);
    }

    #[test]
    fn times_become_instants_only_where_they_can_be_true() {
        let (now, monotonic) = (Instant::now(), Duration::from_millis(1_000_250));
        let taken = |tv_sec, tv_usec, flags| {
            taken_by(now, monotonic, sys::timeval { tv_sec, tv_usec }, flags)
        };
        let [before, after] = [50, 30].map(Duration::from_millis);
        assert_eq!(taken(1000, 200_000, MONOTONIC), Some(now - before));
        assert_eq!(taken(1000, 250_000, MONOTONIC), Some(now));
        assert_eq!(taken(1000, 280_000, MONOTONIC), Some(now + after));
        assert_eq!(taken(1000, 531_000, MONOTONIC), None, "in the future");
        assert_eq!(taken(-1, 0, MONOTONIC), None);
        assert_eq!(taken(1000, c_long::MAX, MONOTONIC), None);
        assert_eq!(taken(1000, 200_000, sys::V4L2_BUF_FLAG_TIMESTAMP_UNKNOWN), None);
        assert_eq!(taken(1000, 200_000, sys::V4L2_BUF_FLAG_TIMESTAMP_COPY), None);
    }

    #[test]
    fn no_picture_was_taken_before_the_camera_was_started() {
        let started = Instant::now();
        let ago = |by: Duration| {
            let time = monotonic_now().unwrap() - by;
            let (seconds, micros) = (time.as_secs() as c_long, time.subsec_micros().into());
            taken(sys::timeval { tv_sec: seconds, tv_usec: micros }, MONOTONIC, started)
        };
        assert_eq!(ago(Duration::from_secs(2)), None);
        std::thread::sleep(Duration::from_millis(5));
        // Microseconds are cut off.
        assert!(ago(Duration::ZERO).is_some_and(|taken| taken > started));
    }

    #[test]
    fn what_times_are_of_is_read_among_other_flags() {
        let others = sys::V4L2_BUF_FLAG_ERROR | 1;
        assert!(is_monotonic(MONOTONIC | others) && !is_monotonic(others));
        assert!(is_of_exposure(sys::V4L2_BUF_FLAG_TSTAMP_SRC_SOE | others));
        assert!(!is_of_exposure(MONOTONIC | others));
    }
}
