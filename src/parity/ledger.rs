//! What was found of each stage, over all frames that were compared.

use super::tolerances::{Limit, Tolerance};
use crate::gpu::parity::Difference;

/// Differences by tolerance.
#[derive(Debug)]
pub struct Ledger {
    software: bool,
    entries: Vec<Entry>,
}

#[derive(Debug)]
struct Entry {
    tolerance: &'static Tolerance,
    found: Found,
}

/// Of all values that were compared.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Found {
    pub values: usize,
    /// Infinite where just one side is a number.
    #[serde(serialize_with = "super::report::finite_or_text")]
    pub largest: f64,
    /// Where that is.
    pub frame: usize,
    /// Values that differ by more than the tolerance.
    pub beyond: usize,
}

impl Found {
    pub fn share_beyond(&self) -> f64 {
        self.beyond as f64 / self.values as f64
    }

    pub fn is_within(&self, limit: Limit) -> bool {
        self.share_beyond() <= limit.share
    }
}

impl Ledger {
    /// For a device that computes in software, or another.
    pub fn new(software: bool) -> Self {
        Self { software, entries: Vec::new() }
    }

    /// Compares value by value; nothing where there is none.
    ///
    /// # Panics
    /// If the lists differ in length.
    pub fn compare(
        &mut self,
        tolerance: &'static Tolerance,
        frame: usize,
        cpu: &[f32],
        gpu: &[f32],
    ) {
        assert_eq!(cpu.len(), gpu.len(), "{} {}", tolerance.stage, tolerance.quantity);
        if cpu.is_empty() {
            return;
        }
        let Difference { values, largest, beyond, .. } =
            Difference::of(cpu, gpu, self.limit(tolerance).largest);
        let newest = Found { values, largest, beyond, frame };
        match self.entries.iter_mut().find(|e| std::ptr::eq(e.tolerance, tolerance)) {
            Some(Entry { found, .. }) => {
                found.values += values;
                found.beyond += beyond;
                if largest > found.largest {
                    (found.largest, found.frame) = (largest, frame);
                }
            }
            None => self.entries.push(Entry { tolerance, found: newest }),
        }
    }

    pub fn limit(&self, tolerance: &Tolerance) -> Limit {
        tolerance.limit(self.software)
    }

    /// None where nothing was compared.
    pub fn found(&self, tolerance: &'static Tolerance) -> Option<Found> {
        self.entries.iter().find(|e| std::ptr::eq(e.tolerance, tolerance)).map(|e| e.found)
    }
}
