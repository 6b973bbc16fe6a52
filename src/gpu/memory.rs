//! How much of a device's memory buffers may take.

use super::GpuError;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Bytes of all buffers of a device. Textures and staging memory are not counted.
pub(super) struct Memory {
    taken: AtomicU64,
    most: AtomicU64,
}

impl Default for Memory {
    fn default() -> Self {
        Self { taken: AtomicU64::new(0), most: AtomicU64::new(u64::MAX) }
    }
}

impl Memory {
    pub fn taken(&self) -> u64 {
        self.taken.load(Relaxed)
    }

    pub fn limit(&self, bytes: u64) {
        self.most.store(bytes, Relaxed);
    }

    /// Room for a buffer, until the result is dropped.
    pub fn take(self: &Arc<Self>, label: &str, bytes: u64) -> Result<Share, GpuError> {
        let most = self.most.load(Relaxed);
        let fits = |taken: u64| taken.checked_add(bytes).filter(|&sum| sum <= most);
        match self.taken.fetch_update(Relaxed, Relaxed, fits) {
            Ok(_) => Ok(Share { memory: self.clone(), bytes }),
            Err(taken) => {
                let [bytes, taken, most] = [bytes, taken, most].map(mib);
                let what = format!("{label} needs {bytes}, and {taken} of {most} are taken");
                Err(GpuError::OutOfMemory { what })
            }
        }
    }
}

/// A buffer's part.
pub(super) struct Share {
    memory: Arc<Memory>,
    bytes: u64,
}

impl Drop for Share {
    fn drop(&mut self) {
        self.memory.taken.fetch_sub(self.bytes, Relaxed);
    }
}

pub(super) fn mib(bytes: u64) -> String {
    format!("{:.1} MiB", bytes as f64 / f64::from(1 << 20))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_dropped_can_be_taken_again() {
        let memory = Arc::new(Memory::default());
        let first = memory.take("first", 3 << 20).expect("there is no limit");
        memory.limit(4 << 20);
        let refused = memory.take("second", 2 << 20).err().expect("5 MiB of 4").to_string();
        assert!(refused.contains("second needs 2.0 MiB, and 3.0 MiB of 4.0 MiB"), "{refused}");
        assert!(memory.take("all", u64::MAX).is_err());
        drop(first);
        let second = memory.take("second", 2 << 20).expect("nothing is taken");
        assert_eq!(memory.taken(), 2 << 20);
        drop(second);
        assert_eq!(memory.taken(), 0);
    }
}
