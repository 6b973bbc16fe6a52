//! How far results of the two backends are from each other.

/// Differences of two lists of numbers.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Difference {
    pub values: usize,
    /// Largest absolute difference; infinite where just one side is a number.
    pub largest: f64,
    /// Where it is.
    pub at: usize,
    /// Values that differ by more than the tolerance.
    pub beyond: usize,
    pub tolerance: f64,
}

impl Difference {
    /// Compares value by value.
    ///
    /// # Panics
    /// If the lists are empty or differ in length: nothing would have been compared.
    pub fn of(cpu: &[f32], gpu: &[f32], tolerance: f64) -> Self {
        assert_eq!(cpu.len(), gpu.len(), "values to compare");
        assert!(!cpu.is_empty(), "nothing to compare");
        let mut found = Self { values: cpu.len(), largest: 0.0, at: 0, beyond: 0, tolerance };
        for (i, (&a, &b)) in cpu.iter().zip(gpu).enumerate() {
            let difference = match (a.is_finite(), b.is_finite()) {
                (true, true) => (f64::from(a) - f64::from(b)).abs(),
                _ => f64::INFINITY,
            };
            found.beyond += usize::from(difference > tolerance);
            if difference > found.largest {
                (found.largest, found.at) = (difference, i);
            }
        }
        found
    }

    /// The share of values beyond the tolerance.
    pub fn share_beyond(&self) -> f64 {
        self.beyond as f64 / self.values as f64
    }

    /// Whether at most this share of values is beyond the tolerance.
    pub fn is_within(&self, share: f64) -> bool {
        self.share_beyond() <= share
    }
}

impl std::fmt::Display for Difference {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { values, largest, at, beyond, tolerance } = self;
        write!(f, "{beyond} of {values} beyond {tolerance:e}, largest {largest:.3e} at {at}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_wrong_value_is_found() {
        let cpu = [0.5; 1000];
        let mut gpu = cpu;
        assert!(Difference::of(&cpu, &gpu, 0.0).is_within(0.0));
        gpu[321] = 0.75;
        let found = Difference::of(&cpu, &gpu, 0.1);
        assert_eq!((found.largest, found.at, found.beyond), (0.25, 321, 1));
        assert!(!found.is_within(0.0) && found.is_within(1e-3));
    }

    #[test]
    fn what_is_no_number_is_never_equal() {
        for (a, b) in [(f32::NAN, f32::NAN), (1.0, f32::NAN), (f32::INFINITY, 1.0)] {
            assert!(!Difference::of(&[a], &[b], f64::MAX).is_within(0.0));
        }
    }

    #[test]
    #[should_panic(expected = "nothing to compare")]
    fn nothing_is_no_agreement() {
        Difference::of(&[], &[], 1.0);
    }
}
