//! Axes: the range that values need, and round numbers to mark on it.

use super::markup::number;

/// A range of values, linear or logarithmic, with marks.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Axis {
    lo: f64,
    hi: f64,
    log: bool,
    pub ticks: Vec<Tick>,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Tick {
    pub value: f64,
    pub label: String,
}

/// Values beyond are drawn at the rim: their differences would overflow.
const LARGEST: f64 = 1e300;

impl Axis {
    /// From 0 to a round number that no finite value exceeds; negative values extend it downwards.
    pub fn from_zero(values: impl IntoIterator<Item = f64>, about: usize) -> Self {
        let (lo, hi) = range(values).unwrap_or((0.0, 1.0));
        let (lo, hi) = (lo.min(0.0), hi.max(0.0));
        let hi = if lo == hi { 1.0 } else { hi };
        let step = nice_step((hi - lo) / about.max(1) as f64);
        Self::linear((lo / step).floor() as i64, (hi / step).ceil() as i64, step)
    }

    fn linear(first: i64, last: i64, step: f64) -> Self {
        let digits = (-step.log10().floor()).clamp(0.0, 12.0) as usize;
        let ticks = (first..=last).map(|i| {
            let value = i as f64 * step;
            let label = if step >= 1e6 { format!("{value:.0e}") } else { number(value, digits) };
            Tick { value, label }
        });
        Self { lo: first as f64 * step, hi: last as f64 * step, log: false, ticks: ticks.collect() }
    }

    /// Around the positive finite values, with a margin, marks at 1, 2 and 5 times powers of ten.
    pub fn logarithmic(values: impl IntoIterator<Item = f64>) -> Self {
        let (lo, hi) = range(values.into_iter().filter(|&v| v > 0.0)).unwrap_or((1.0, 10.0));
        let (lo, hi) = (lo.max(1.0 / LARGEST) / 1.25, hi * 1.25);
        let (first, last) = (lo.log10().floor() as i32, hi.log10().ceil() as i32);
        let factors: &[f64] = if last - first > 4 { &[1.0] } else { &[1.0, 2.0, 5.0] };
        let every = ((last - first) / 10 + 1) as usize;
        let marks = (first..=last)
            .step_by(every)
            .flat_map(|e| factors.iter().map(move |f| (f * 10f64.powi(e), e)))
            .filter(|(v, _)| (lo..=hi).contains(v))
            .map(|(value, exponent)| Tick {
                value,
                label: match exponent {
                    -3..=5 => number(value, (-exponent).max(0) as usize),
                    _ => format!("{value:.0e}"),
                },
            });
        Self { lo, hi, log: true, ticks: marks.collect() }
    }

    /// Where a value lies, 0 at the lower end and 1 at the upper; values beyond stay at the rim, and
    /// what is no number lies at 0.
    pub fn share(&self, value: f64) -> f64 {
        let share = if self.log {
            (value / self.lo).ln() / (self.hi / self.lo).ln()
        } else {
            (value - self.lo) / (self.hi - self.lo)
        };
        if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) }
    }
}

fn range(values: impl IntoIterator<Item = f64>) -> Option<(f64, f64)> {
    let finite = values.into_iter().filter(|v| v.is_finite()).map(|v| v.clamp(-LARGEST, LARGEST));
    finite.fold(None, |range, v| match range {
        None => Some((v, v)),
        Some((lo, hi)) => Some((lo.min(v), hi.max(v))),
    })
}

/// The smallest of 1, 2 and 5 times a power of ten that is no smaller.
fn nice_step(raw: f64) -> f64 {
    let raw = raw.max(1.0 / LARGEST);
    let power = 10f64.powi(raw.log10().floor() as i32);
    // a hair of tolerance: 0.3 / 3 is not quite 0.1
    let factor = [1.0, 2.0, 5.0].into_iter().find(|f| f * power >= raw * (1.0 - 1e-9));
    factor.unwrap_or(10.0) * power
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(axis: &Axis) -> Vec<&str> {
        axis.ticks.iter().map(|t| t.label.as_str()).collect()
    }

    #[test]
    fn linear_ticks_are_round_and_cover_the_values() {
        assert_eq!(labels(&Axis::from_zero([3.0, 47.0], 5)), ["0", "10", "20", "30", "40", "50"]);
        assert_eq!(labels(&Axis::from_zero([0.3], 3)), ["0.0", "0.1", "0.2", "0.3"]);
        assert_eq!(
            labels(&Axis::from_zero([-1.5, 2.0], 4)),
            ["\u{2212}2", "\u{2212}1", "0", "1", "2"]
        );
        for hi in [1e-9, 0.07, 1.0, 9.99, 123_456.0, 1e12] {
            let axis = Axis::from_zero([hi], 5);
            assert!((4..=7).contains(&axis.ticks.len()), "{hi}: {:?}", labels(&axis));
            let top = axis.ticks.last().unwrap().value;
            assert!(hi <= top * (1.0 + 1e-9) && top <= 2.0 * hi, "{hi}: {top}");
        }
    }

    #[test]
    fn nothing_one_value_and_no_numbers_still_give_an_axis() {
        for values in [vec![], vec![f64::NAN], vec![f64::INFINITY], vec![0.0], vec![-0.0, 0.0]] {
            let axis = Axis::from_zero(values.clone(), 5);
            assert_eq!((axis.share(0.0), axis.share(1.0)), (0.0, 1.0), "{values:?}");
            let log = Axis::logarithmic(values);
            assert!(log.share(2.0) > 0.0 && log.share(2.0) < 1.0);
        }
        let extreme = Axis::from_zero([f64::MAX, f64::MIN], 5);
        assert!(extreme.share(0.0) > 0.3 && extreme.share(0.0) < 0.7);
        assert_eq!(extreme.share(f64::NAN), 0.0);
        let tiny = Axis::from_zero([f64::MIN_POSITIVE], 5);
        assert!(tiny.ticks.iter().all(|t| t.value.is_finite()) && tiny.ticks.len() < 20);
    }

    #[test]
    fn logarithmic_ticks() {
        assert_eq!(labels(&Axis::logarithmic([12.0, 180.0])), ["10", "20", "50", "100", "200"]);
        let axis = Axis::logarithmic([0.01, 1e5]);
        assert_eq!(labels(&axis).first().copied(), Some("0.01"));
        assert_eq!(labels(&axis).last().copied(), Some("100000"));
        let one = Axis::logarithmic([33.0]);
        assert!((one.share(33.0) - 0.5).abs() < 1e-12, "one point lies in the middle");
        let wide = Axis::logarithmic([1e-200, 1e200]);
        assert!(wide.ticks.len() < 20, "{:?}", labels(&wide));
        // the same factor is the same distance
        let step = |a: f64, b: f64| axis.share(b) - axis.share(a);
        assert!((step(1.0, 10.0) - step(100.0, 1000.0)).abs() < 1e-12);
        assert_eq!(axis.share(-1.0), 0.0);
        assert_eq!(axis.share(0.0), 0.0);
    }
}
