//! Quantiles of any number of measurements in memory that does not grow with them.

use super::{median, quantile};

/// So many values are kept as they are; quantiles are then exact.
const EXACT: usize = 4096;

/// Upper over lower edge of a bin.
pub const BIN_RATIO: f64 = 1.005;

/// Values from here on have bins; smaller ones count as zero.
pub const SMALLEST: f64 = 1e-4;
/// Values from here on share the last bin.
const LARGEST: f64 = 1e7;

/// Of measurements that are not negative. Beyond the first 4096 values, quantiles are the middles of bins,
/// which are wrong by at most half a bin: 0.25 %, or `SMALLEST` where that is more (values below
/// `SMALLEST` have one bin, those beyond 1e7 as well). The largest value is always exact.
#[derive(Clone, Debug, Default)]
pub struct Distribution {
    first: Vec<f64>,
    /// Made when `first` is full; below, and up to each edge.
    bins: Vec<u64>,
    count: usize,
    largest: f64,
}

impl Distribution {
    pub fn new() -> Self {
        Self::default()
    }

    /// Values that are not finite are left out, as measurements that failed.
    pub fn push(&mut self, value: f64) {
        if !value.is_finite() {
            return;
        }
        self.largest = if self.count == 0 { value } else { self.largest.max(value) };
        self.count += 1;
        if self.bins.is_empty() && self.count <= EXACT {
            self.first.push(value);
            return;
        }
        if self.bins.is_empty() {
            self.bins = vec![0; bin_of(LARGEST) + 1];
            for value in std::mem::take(&mut self.first) {
                self.bins[bin_of(value)] += 1;
            }
        }
        self.bins[bin_of(value)] += 1;
    }

    pub fn count(&self) -> usize {
        self.count
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    pub fn largest(&self) -> Option<f64> {
        (self.count > 0).then_some(self.largest)
    }

    /// As [`median`](super::median).
    pub fn median(&self) -> Option<f64> {
        if self.bins.is_empty() {
            return median(self.first.iter().copied());
        }
        Some(0.5 * (self.ranked((self.count - 1) / 2) + self.ranked(self.count / 2)))
    }

    /// As [`quantile`](super::quantile).
    pub fn quantile(&self, share: f64) -> Option<f64> {
        if self.bins.is_empty() {
            return quantile(self.first.iter().copied(), share);
        }
        Some(self.ranked(super::statistics::rank(share, self.count) - 1))
    }

    /// The middle of the bin of the value that so many are not above.
    fn ranked(&self, before: usize) -> f64 {
        let mut passed = 0;
        let holds = |&count: &u64| {
            passed += count;
            passed > before as u64
        };
        let bin = self.bins.iter().position(holds).unwrap_or(self.bins.len());
        // No value of the last bin that has one is above the largest.
        middle(bin).min(self.largest)
    }

    /// Memory that the values take.
    pub fn bytes(&self) -> usize {
        self.first.capacity() * size_of::<f64>() + self.bins.capacity() * size_of::<u64>()
    }
}

fn bin_of(value: f64) -> usize {
    if value < SMALLEST {
        return 0;
    }
    1 + ((value.min(LARGEST) / SMALLEST).ln() / BIN_RATIO.ln()) as usize
}

/// In logarithms, as the bins are.
fn middle(bin: usize) -> f64 {
    if bin == 0 { 0.0 } else { SMALLEST * BIN_RATIO.powf(bin as f64 - 0.5) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Rng;

    /// Half a bin, and the rounding of logarithms.
    const RELATIVE: f64 = 0.0025;

    fn assert_near(of: &Distribution, values: &[f64]) {
        let near = |found: Option<f64>, exact: Option<f64>| {
            let (found, exact) = (found.unwrap(), exact.unwrap());
            let allowed = SMALLEST.max(RELATIVE * exact.abs());
            assert!((found - exact).abs() <= allowed, "{found} for {exact}");
        };
        let all = || values.iter().copied();
        near(of.median(), median(all()));
        for share in [0.0, 0.001, 0.25, 0.95, 0.99, 0.999, 1.0] {
            near(of.quantile(share), quantile(all(), share));
        }
        assert_eq!(of.largest(), all().reduce(f64::max));
        assert_eq!(of.count(), values.len());
    }

    fn of(values: &[f64]) -> Distribution {
        let mut distribution = Distribution::new();
        values.iter().for_each(|&v| distribution.push(v));
        distribution
    }

    #[test]
    fn few_values_are_exact() {
        let mut rng = Rng::new(&[1]);
        let values: Vec<f64> = (0..EXACT).map(|_| f64::from(rng.uniform()) * 40.0).collect();
        let distribution = of(&values);
        assert_eq!(distribution.median(), median(values.iter().copied()));
        for share in [0.0, 0.5, 0.95, 0.99, 1.0] {
            assert_eq!(distribution.quantile(share), quantile(values.iter().copied(), share));
        }
        let none = of(&[f64::NAN, f64::INFINITY]);
        assert_eq!((none.median(), none.quantile(0.5), none.largest()), (None, None, None));
    }

    #[test]
    fn many_values_are_within_half_a_bin() {
        let mut rng = Rng::new(&[2]);
        // Nine decades, two modes, zeros, one value over and over, and what has no bin of its own.
        let decades: Vec<f64> =
            (0..50_000).map(|_| 10f64.powf(9.0 * f64::from(rng.uniform()) - 3.5)).collect();
        let modes: Vec<f64> = (0..50_000)
            .map(|i| if i % 7 == 0 { 250.0 } else { 8.0 + 0.001 * (i % 100) as f64 })
            .collect();
        let zeros: Vec<f64> = (0..9_999).map(|i| if i % 2 == 0 { 0.0 } else { 3.0 }).collect();
        for values in [decades, modes, zeros, vec![33.333; 10_000], vec![1e-7; 10_000]] {
            assert_near(&of(&values), &values);
        }
        let beyond = of(&vec![1e9; 10_000]);
        assert_eq!((beyond.largest(), beyond.count()), (Some(1e9), 10_000));
        assert!(beyond.median().unwrap() >= LARGEST * (1.0 - RELATIVE));
    }

    #[test]
    fn the_first_values_count_when_bins_take_over() {
        let mut values = vec![1.0; EXACT];
        values.extend(vec![2.0; EXACT - 10]);
        assert_near(&of(&values), &values);
    }

    #[test]
    fn memory_does_not_grow_with_the_values() {
        let mut distribution = Distribution::new();
        (0..2 * EXACT).for_each(|i| distribution.push(i as f64));
        let bytes = distribution.bytes();
        assert!(bytes > 0 && bytes < 64 << 10, "{bytes}");
        (0..1_000_000).for_each(|i| distribution.push(0.01 * f64::from(i)));
        assert_eq!((distribution.bytes(), distribution.count()), (bytes, 1_000_000 + 2 * EXACT));
    }
}
