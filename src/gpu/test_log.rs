//! What wgpu and drivers warn of fails tests.

use log::{Level, LevelFilter, Log, Metadata, Record};
use std::sync::{Mutex, Once};

/// Warnings that came where a panic is swallowed: Vulkan calls back through C.
static WARNINGS: Mutex<Vec<String>> = Mutex::new(Vec::new());

struct FailOnWarnings;

impl Log for FailOnWarnings {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        let of_wgpu = ["wgpu", "naga"].iter().any(|name| metadata.target().starts_with(name));
        of_wgpu && metadata.level() <= Level::Warn
    }

    fn log(&self, record: &Record<'_>) {
        if self.enabled(record.metadata()) && !std::thread::panicking() {
            let text = format!("{}: {}", record.target(), record.args());
            WARNINGS.lock().unwrap_or_else(|held| held.into_inner()).push(text.clone());
            panic!("{text}");
        }
    }

    fn flush(&self) {}
}

/// From here on, a warning fails the test that provokes it, or the next one that asks for a device.
pub fn fail_on_warnings() {
    static START: Once = Once::new();
    START.call_once(|| {
        log::set_logger(&FailOnWarnings).expect("unit tests have no other logger");
        log::set_max_level(LevelFilter::Warn);
    });
    let warnings = std::mem::take(&mut *WARNINGS.lock().unwrap_or_else(|held| held.into_inner()));
    assert!(warnings.is_empty(), "{warnings:?}");
}
