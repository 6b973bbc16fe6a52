//! Summaries that plots draw.

use crate::math::median;
use glam::DVec3;

/// Five numbers of a box plot (Tukey): whiskers end at the outermost values within 1.5 times the
/// box's height of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct BoxSummary {
    pub count: usize,
    pub min: f64,
    pub low_whisker: f64,
    pub lower_quartile: f64,
    pub median: f64,
    pub upper_quartile: f64,
    pub high_whisker: f64,
    pub max: f64,
}

impl BoxSummary {
    /// Of the finite values; `None` where there is none.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let mut values: Vec<f64> = values.into_iter().filter(|v| v.is_finite()).collect();
        values.sort_by(f64::total_cmp);
        let (&min, &max) = (values.first()?, values.last()?);
        let [lower_quartile, median, upper_quartile] = [0.25, 0.5, 0.75].map(|p| at(&values, p));
        let reach = 1.5 * (upper_quartile - lower_quartile);
        let inside = |v: &&f64| **v >= lower_quartile - reach && **v <= upper_quartile + reach;
        Some(Self {
            count: values.len(),
            min,
            low_whisker: *values.iter().find(inside).unwrap_or(&min),
            lower_quartile,
            median,
            upper_quartile,
            high_whisker: *values.iter().rfind(inside).unwrap_or(&max),
            max,
        })
    }
}

/// Quantile of sorted values, between the two nearest ones by their distance.
fn at(sorted: &[f64], share: f64) -> f64 {
    let position = share * (sorted.len() - 1) as f64;
    let (below, part) = (position.floor() as usize, position.fract());
    let above = (below + 1).min(sorted.len() - 1);
    sorted[below] + part * (sorted[above] - sorted[below])
}

/// The median of each axis, brought back to unit length. `None` for no direction, and where they
/// cancel out.
pub(super) fn median_direction(directions: impl IntoIterator<Item = [f64; 3]>) -> Option<[f64; 3]> {
    let directions: Vec<[f64; 3]> = directions.into_iter().collect();
    let axis = |k: usize| median(directions.iter().map(|d| d[k]));
    DVec3::new(axis(0)?, axis(1)?, axis(2)?).try_normalize().map(|d| d.to_array())
}

/// Mean of the finite values.
pub(super) fn mean(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let finite = values.into_iter().filter(|v| v.is_finite());
    let (sum, count) = finite.fold((0.0, 0usize), |(sum, n), v| (sum + v, n + 1));
    (count > 0).then(|| sum / count as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_are_tukeys() {
        let values = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 100.0, f64::NAN];
        let b = BoxSummary::of(values).unwrap();
        assert_eq!((b.count, b.min, b.max), (9, 1.0, 100.0));
        assert_eq!((b.lower_quartile, b.median, b.upper_quartile), (3.0, 5.0, 7.0));
        // 7 + 1.5 (7 - 3) = 13: the outermost value within is 8
        assert_eq!((b.low_whisker, b.high_whisker), (1.0, 8.0));
        assert_eq!(BoxSummary::of([1.0, 2.0]).unwrap().lower_quartile, 1.25);
        let one = BoxSummary::of([4.0]).unwrap();
        assert_eq!((one.low_whisker, one.median, one.high_whisker), (4.0, 4.0, 4.0));
        assert_eq!(BoxSummary::of([f64::NAN]), None);
    }

    #[test]
    fn directions_have_a_median_unless_they_cancel() {
        let outlier = [[0.0, 0.0, 1.0], [0.0, 0.6, 0.8], [0.0, -0.6, 0.8], [1.0, 0.0, 0.0]];
        let d = median_direction(outlier).unwrap();
        assert!((d[2] - 1.0).abs() < 1e-12, "{d:?}");
        assert_eq!(median_direction([]), None);
        assert_eq!(median_direction([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]), None);
        assert_eq!(median_direction([[f64::NAN; 3]]), None);
    }

    #[test]
    fn means_pass_over_what_is_no_number() {
        assert_eq!(mean([1.0, f64::NAN, 3.0]), Some(2.0));
        assert_eq!(mean([]), None);
    }
}
