//! The Pareto front of time and error.

use super::{TradePoint, Tradeoff};
use serde::{Deserialize, Serialize};

/// Which error is traded against time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ErrorKind {
    /// [`TradePoint::composite_error`]
    Composite,
    /// [`TradePoint::transfer_error`]
    Transfer,
    /// [`TradePoint::light_relative_l2`]
    Light,
}

impl ErrorKind {
    /// What users see comes first.
    pub const ALL: [Self; 3] = [Self::Composite, Self::Transfer, Self::Light];

    pub fn name(self) -> &'static str {
        match self {
            Self::Composite => "composite",
            Self::Transfer => "transfer",
            Self::Light => "light",
        }
    }

    pub fn of(self, point: &TradePoint) -> Option<f64> {
        match self {
            Self::Composite => point.composite_error,
            Self::Transfer => point.transfer_error,
            Self::Light => point.light_relative_l2,
        }
    }

    /// The first that any point has.
    pub fn first_of(points: &[TradePoint]) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| points.iter().any(|p| kind.of(p).is_some()))
    }
}

/// Which points (time, error) no other point is as good in both as, and better in one. Points that
/// are equal in both stand or fall together; one that is not finite is not on the front and
/// excludes nobody.
pub fn pareto_front(points: &[(f64, f64)]) -> Vec<bool> {
    // -0 is 0, and total_cmp would tell them apart
    let points: Vec<(f64, f64)> = points.iter().map(|&(t, e)| (t + 0.0, e + 0.0)).collect();
    let finite = |&i: &usize| points[i].0.is_finite() && points[i].1.is_finite();
    let mut order: Vec<usize> = (0..points.len()).filter(finite).collect();
    let by_time_then_error = |&a: &usize, &b: &usize| {
        let ((time_a, error_a), (time_b, error_b)) = (points[a], points[b]);
        time_a.total_cmp(&time_b).then(error_a.total_cmp(&error_b))
    };
    order.sort_by(by_time_then_error);
    let mut front = vec![false; points.len()];
    let mut last: Option<usize> = None;
    for i in order {
        if last.is_none_or(|last| points[i].1 < points[last].1 || points[i] == points[last]) {
            front[i] = true;
            last = Some(i);
        }
    }
    front
}

impl Tradeoff {
    /// Marks the points that are on the front of `kind`, and no others.
    pub fn mark_front(&mut self, kind: ErrorKind) {
        let plane: Vec<(f64, f64)> =
            self.points.iter().map(|p| (p.update_ms, kind.of(p).unwrap_or(f64::NAN))).collect();
        for (point, on_front) in self.points.iter_mut().zip(pareto_front(&plane)) {
            point.on_front = on_front;
        }
    }

    /// The front, fastest first.
    pub fn front(&self) -> Vec<&TradePoint> {
        let mut front: Vec<_> = self.points.iter().filter(|p| p.on_front).collect();
        front.sort_by(|a, b| a.update_ms.total_cmp(&b.update_ms));
        front
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn ties_missing_and_infinite_values() {
        let nan = f64::NAN;
        let points = [
            (1.0, 9.0),
            (2.0, 5.0),
            (2.0, 5.0), // equal to the one before: both
            (2.0, 6.0), // same time, less accurate
            (3.0, 5.0), // same error, slower
            (4.0, 1.0),
            (5.0, nan), // not measured
            (nan, 0.0),
            (0.5, f64::INFINITY), // diverged
            (6.0, 2.0),
        ];
        let expected = [true, true, true, false, false, true, false, false, false, false];
        assert_eq!(pareto_front(&points), expected);
        assert!(pareto_front(&[]).is_empty());
        assert_eq!(pareto_front(&[(0.0, 0.0), (-0.0, 0.0)]), [true, true]);
    }

    fn brute_force(points: &[(f64, f64)]) -> Vec<bool> {
        let beats = |a: &(f64, f64), b: &(f64, f64)| {
            a.0 <= b.0
                && a.1 <= b.1
                && (a.0 < b.0 || a.1 < b.1)
                && a.0.is_finite()
                && a.1.is_finite()
        };
        let on_front = |p: &(f64, f64)| {
            p.0.is_finite() && p.1.is_finite() && !points.iter().any(|q| beats(q, p))
        };
        points.iter().map(on_front).collect()
    }

    /// Few values, so that ties are common.
    fn coordinate() -> impl Strategy<Value = f64> {
        prop_oneof![
            8 => (0..6).prop_map(f64::from),
            1 => Just(f64::NAN),
            1 => Just(f64::INFINITY),
            1 => Just(f64::NEG_INFINITY),
            1 => Just(-0.0),
            2 => -1.0..7.0f64,
        ]
    }

    proptest! {
        #[test]
        fn the_front_is_that_of_all_pairs(
            points in prop::collection::vec((coordinate(), coordinate()), 0..40)
        ) {
            prop_assert_eq!(pareto_front(&points), brute_force(&points));
        }

        #[test]
        fn there_is_a_front_where_there_is_a_point(
            points in prop::collection::vec((0.0..1e3f64, 0.0..1e3f64), 1..40)
        ) {
            prop_assert!(pareto_front(&points).contains(&true));
        }
    }
}
