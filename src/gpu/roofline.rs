//! How fast a pass could be on a stated GPU: it has to move some bytes and make some operations, and no
//! GPU does either faster than its data sheet says (Williams, Waterman, Patterson 2009).

use std::iter::Sum;
use std::ops::Add;
use std::time::Duration;

/// What a pass did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Work {
    pub invocations: u64,
    pub float_operations: u64,
    /// On integers, truth values and bits.
    pub other_operations: u64,
    /// Bytes of sectors of 32 bytes that are read, each counted once however often it was asked for: what a
    /// cache that holds everything would have to fetch.
    pub bytes_read: u64,
    /// The same of those written.
    pub bytes_written: u64,
    /// Bytes that invocations asked for.
    pub bytes_loaded: u64,
    pub bytes_stored: u64,
    /// On storage buffers.
    pub atomics: u64,
}

impl Work {
    pub fn operations(&self) -> u64 {
        self.float_operations + self.other_operations
    }

    /// That must move at least.
    pub fn bytes(&self) -> u64 {
        self.bytes_read + self.bytes_written
    }

    /// Operations a byte.
    pub fn intensity(&self) -> f64 {
        self.operations() as f64 / self.bytes().max(1) as f64
    }

    /// How often a byte that is fetched once is asked for: what caches must serve.
    pub fn reuse(&self) -> f64 {
        self.bytes_loaded as f64 / self.bytes_read.max(1) as f64
    }
}

impl Add for Work {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            invocations: self.invocations + other.invocations,
            float_operations: self.float_operations + other.float_operations,
            other_operations: self.other_operations + other.other_operations,
            bytes_read: self.bytes_read + other.bytes_read,
            bytes_written: self.bytes_written + other.bytes_written,
            bytes_loaded: self.bytes_loaded + other.bytes_loaded,
            bytes_stored: self.bytes_stored + other.bytes_stored,
            atomics: self.atomics + other.atomics,
        }
    }
}

impl Sum for Work {
    fn sum<I: Iterator<Item = Self>>(all: I) -> Self {
        all.fold(Self::default(), Add::add)
    }
}

/// What decides on a pass's floor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoundBy {
    Bytes,
    Operations,
}

/// A GPU's peak rates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StatedGpu {
    pub name: &'static str,
    pub bytes_per_s: f64,
    /// In f32, a fused multiplication and addition as two. No GPU here is faster with integers.
    pub operations_per_s: f64,
    pub source: &'static str,
}

/// GPUs with published figures.
pub const STATED: [StatedGpu; 2] = [
    StatedGpu {
        name: "GeForce RTX 3060",
        bytes_per_s: 360e9,
        // 3584 cores, 1.777 GHz boost, 2 a cycle
        operations_per_s: 12.74e12,
        source: "NVIDIA's product page: 3584 cores, 1.78 GHz boost; GDDR6, 192 bits, 15 Gb/s",
    },
    StatedGpu {
        name: "Apple M1, 8 GPU cores",
        bytes_per_s: 68.25e9,
        operations_per_s: 2.6e12,
        source: "Apple's press release of November 2020: 2.6 TFLOPS; LPDDR4X-4266, 128 bits",
    },
];

impl StatedGpu {
    /// No run of a pass takes less.
    pub fn floor(&self, work: &Work) -> Duration {
        Duration::from_secs_f64(self.bytes_s(work).max(self.operations_s(work)))
    }

    pub fn bound_by(&self, work: &Work) -> BoundBy {
        match self.operations_s(work) > self.bytes_s(work) {
            true => BoundBy::Operations,
            false => BoundBy::Bytes,
        }
    }

    fn bytes_s(&self, work: &Work) -> f64 {
        work.bytes() as f64 / self.bytes_per_s
    }

    fn operations_s(&self, work: &Work) -> f64 {
        work.operations() as f64 / self.operations_per_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GPU: StatedGpu =
        StatedGpu { name: "made", bytes_per_s: 10.0, operations_per_s: 100.0, source: "" };

    #[test]
    fn the_slower_of_both_decides() {
        let copies =
            Work { bytes_read: 30, bytes_written: 20, float_operations: 40, ..Work::default() };
        assert_eq!(GPU.floor(&copies), Duration::from_secs(5));
        assert_eq!(GPU.bound_by(&copies), BoundBy::Bytes);
        let computes = Work { float_operations: 500, other_operations: 200, ..copies };
        assert_eq!(GPU.floor(&computes), Duration::from_secs(7));
        assert_eq!(GPU.bound_by(&computes), BoundBy::Operations);
        assert_eq!(computes.intensity(), 14.0);
        let both: Work = [copies, computes].into_iter().sum();
        assert_eq!((both.bytes(), both.operations()), (100, 740));
    }

    #[test]
    fn stated_rates_follow_from_the_figures_of_their_sources() {
        assert!((STATED[0].operations_per_s / (3584.0 * 1.777e9 * 2.0) - 1.0).abs() < 1e-3);
        assert_eq!(STATED[0].bytes_per_s, 192.0 / 8.0 * 15e9);
        // 4266.67 M transfers/s on 16 bytes
        assert!((STATED[1].bytes_per_s / (4266.67e6 * 16.0) - 1.0).abs() < 1e-3);
    }
}
