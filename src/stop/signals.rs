//! Signals that interrupt a process. A general library for this tells neither which signal it was nor leaves
//! those alone that were to be ignored (`nohup`, jobs in the background of scripts).

#![allow(unsafe_code, reason = "calls of the C library")]

use std::ffi::{c_int, c_void};
use std::io::Read;
use std::os::fd::{AsRawFd, IntoRawFd};
use std::sync::atomic::{AtomicI32, Ordering::SeqCst};

type Handler = usize;
const DEFAULT: Handler = 0;
const IGNORE: Handler = 1;

const HANG_UP: c_int = 1;
const INTERRUPT: c_int = 2;
const TERMINATE: c_int = 15;
/// A file grew beyond the limit of the process.
const FILE_SIZE: c_int = 25;

// Of the C library that the standard library is linked to.
unsafe extern "C" {
    fn signal(number: c_int, handler: Handler) -> Handler;
    fn raise(number: c_int) -> c_int;
    fn write(file: c_int, bytes: *const c_void, count: usize) -> isize;
}

/// The first signal that came, and where a byte wakes who waits for it.
static FIRST: AtomicI32 = AtomicI32::new(0);
static WAKE: AtomicI32 = AtomicI32::new(-1);

/// Runs `end` at the first Ctrl-C, termination or hang-up, on a thread of its own; the second ends the process. To
/// be called once.
pub fn catch(end: impl FnOnce() + Send + 'static) -> std::io::Result<()> {
    let (mut wait, wake) = std::io::pipe()?;
    let ignored = ignored();
    WAKE.store(wake.as_raw_fd(), SeqCst);
    std::thread::Builder::new().name("interrupt".into()).spawn(move || {
        if wait.read_exact(&mut [0]).is_ok() {
            end();
        }
    })?;
    let _open_for_good = wake.into_raw_fd();
    for number in [HANG_UP, INTERRUPT, TERMINATE] {
        if ignored & (1 << (number - 1)) == 0 {
            // SAFETY: `note` calls only what may be called in a handler.
            unsafe { signal(number, note as *const () as Handler) };
        }
    }
    Ok(())
}

extern "C" fn note(number: c_int) {
    if FIRST.compare_exchange(0, number, SeqCst, SeqCst).is_err() {
        // SAFETY: both may be called in a handler. The signal is blocked in its own: the program ends when
        // this returns.
        unsafe {
            signal(number, DEFAULT);
            raise(number);
        }
        return;
    }
    // SAFETY: may be called in a handler; the pipe stays open, and the byte is a constant.
    unsafe { write(WAKE.load(SeqCst), b"!".as_ptr().cast(), 1) };
}

/// A bit for each signal that this process was started to ignore.
fn ignored() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|hex| u64::from_str_radix(hex.trim(), 16).ok()).unwrap_or(0)
}

/// As a shell gives it for a program that a signal has ended.
pub fn exit_code() -> u8 {
    128 + match FIRST.load(SeqCst) {
        0 => INTERRUPT as u8,
        number => number as u8,
    }
}

/// Ends the program by the signal that interrupted it: a shell then ends the script, too, which it would not for an
/// exit code. Returns where the signal has no effect, as for the first process of a container.
pub fn die() {
    let number = FIRST.load(SeqCst);
    if number != 0 {
        // SAFETY: everything is written, and nothing of this process is needed any more.
        unsafe {
            signal(number, DEFAULT);
            raise(number);
        }
    }
}

/// A limit of file sizes is an error of the write that meets it, not the program's end.
pub fn limits_are_errors() {
    // SAFETY: no handler of ours is replaced.
    unsafe { signal(FILE_SIZE, IGNORE) };
}
