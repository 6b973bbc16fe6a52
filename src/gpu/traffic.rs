//! Bytes between host and device.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Bytes moved since the device was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    pub uploaded: u64,
    pub read_back: u64,
}

impl Traffic {
    /// What was moved after `earlier`.
    pub fn since(self, earlier: Self) -> Self {
        Self {
            uploaded: self.uploaded - earlier.uploaded,
            read_back: self.read_back - earlier.read_back,
        }
    }
}

#[derive(Default)]
pub(super) struct TrafficCounter {
    uploaded: AtomicU64,
    read_back: AtomicU64,
}

impl TrafficCounter {
    pub fn upload(&self, bytes: usize) {
        self.uploaded.fetch_add(bytes as u64, Relaxed);
    }

    pub fn read_back(&self, bytes: usize) {
        self.read_back.fetch_add(bytes as u64, Relaxed);
    }

    pub fn total(&self) -> Traffic {
        Traffic { uploaded: self.uploaded.load(Relaxed), read_back: self.read_back.load(Relaxed) }
    }
}
