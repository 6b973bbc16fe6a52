//! What goes to and fro between host and device: every byte, submission and wait is counted here.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Counted since the device was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Bytes.
    pub uploaded: u64,
    pub read_back: u64,
    pub submissions: u64,
    /// Times that the host waited for the device.
    pub waits: u64,
}

impl Traffic {
    /// Both together.
    pub fn and(self, other: Self) -> Self {
        Self {
            uploaded: self.uploaded + other.uploaded,
            read_back: self.read_back + other.read_back,
            submissions: self.submissions + other.submissions,
            waits: self.waits + other.waits,
        }
    }

    /// What was counted after `earlier`.
    pub fn since(self, earlier: Self) -> Self {
        Self {
            uploaded: self.uploaded - earlier.uploaded,
            read_back: self.read_back - earlier.read_back,
            submissions: self.submissions - earlier.submissions,
            waits: self.waits - earlier.waits,
        }
    }
}

#[derive(Default)]
pub(super) struct TrafficCounter {
    uploaded: AtomicU64,
    read_back: AtomicU64,
    submissions: AtomicU64,
    waits: AtomicU64,
}

impl TrafficCounter {
    pub fn upload(&self, bytes: usize) {
        self.uploaded.fetch_add(bytes as u64, Relaxed);
    }

    pub fn read_back(&self, bytes: usize) {
        self.read_back.fetch_add(bytes as u64, Relaxed);
    }

    pub fn submission(&self) {
        self.submissions.fetch_add(1, Relaxed);
    }

    pub fn wait(&self) {
        self.waits.fetch_add(1, Relaxed);
    }

    pub fn total(&self) -> Traffic {
        Traffic {
            uploaded: self.uploaded.load(Relaxed),
            read_back: self.read_back.load(Relaxed),
            submissions: self.submissions.load(Relaxed),
            waits: self.waits.load(Relaxed),
        }
    }
}
