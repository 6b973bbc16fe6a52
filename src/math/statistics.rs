//! Medians and quantiles of what was measured.

/// Sorted; values that are not finite are left out, as measurements that failed.
fn sorted(values: impl IntoIterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.into_iter().filter(|v| v.is_finite()).collect();
    values.sort_unstable_by(f64::total_cmp);
    values
}

/// Median of the finite values: the mean of the two in the middle for an even count.
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let values = sorted(values);
    let n = values.len();
    (n > 0).then(|| 0.5 * (values[(n - 1) / 2] + values[n / 2]))
}

/// Quantile of the finite values by nearest rank: the smallest value that `share` of them do not exceed.
/// It is always one of the values. A share outside [0, 1] is the nearer end.
pub fn quantile(values: impl IntoIterator<Item = f64>, share: f64) -> Option<f64> {
    let values = sorted(values);
    values.get(rank(share, values.len()) - 1).copied()
}

/// Nearest rank of a share of `count` values, from 1 on.
pub(super) fn rank(share: f64, count: usize) -> usize {
    // The product of a decimal share may lie a rounding above the whole number that it stands for.
    let rank = (share * count as f64 * (1.0 - 4.0 * f64::EPSILON)).ceil() as usize;
    rank.clamp(1, count.max(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    const BROKEN: [f64; 3] = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];

    #[test]
    fn quantiles_are_by_nearest_rank() {
        let values = || (1..=20).rev().map(f64::from);
        let of = |share| quantile(values(), share);
        assert_eq!((of(0.5), of(0.95), of(1.0)), (Some(10.0), Some(19.0), Some(20.0)));
        assert_eq!((of(0.05), of(0.0501), of(0.951)), (Some(1.0), Some(2.0), Some(20.0)));
        assert_eq!((of(0.0), of(-1.0), of(2.0)), (Some(1.0), Some(1.0), Some(20.0)));
    }

    #[test]
    fn percentages_of_whole_counts_do_not_slip_a_rank() {
        // In f64, 0.07 * 100 is more than 7.
        for (percent, n) in (1..=100u32).flat_map(|p| [20, 100, 1000, 100_000].map(|n| (p, n))) {
            let rank = (percent * n).div_ceil(100);
            let values = (1..=n).map(f64::from);
            let share = f64::from(percent) / 100.0;
            assert_eq!(quantile(values, share), Some(f64::from(rank)), "{percent} % of {n}");
        }
    }

    #[test]
    fn one_value_is_all_quantiles_and_none_has_none() {
        assert!([0.0, 0.5, 1.0].iter().all(|&share| quantile([3.0], share) == Some(3.0)));
        assert_eq!((quantile([], 0.5), median([])), (None, None));
        assert_eq!((quantile(BROKEN, 0.5), median(BROKEN)), (None, None));
    }

    #[test]
    fn what_is_not_finite_does_not_count() {
        let values = || BROKEN.into_iter().chain([3.0, 1.0]);
        assert_eq!((quantile(values(), 0.5), quantile(values(), 1.0)), (Some(1.0), Some(3.0)));
        assert_eq!(median(values()), Some(2.0));
    }
}
