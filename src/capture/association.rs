//! Which depth picture belongs to which colour picture.

/// Pairs `(colour, depth)` of indices, increasing in both.
///
/// Both lists must be strictly increasing. Among all one-to-one pairings that keep the order of time
/// and use only differences below `max_difference`, this is the one with the largest sum of
/// `max_difference - |difference|`: nearest partners where there is a choice, and no frame is left
/// alone because its neighbour took the partner that both like best.
///
/// Only differences inside the tolerance are visited, so the work is the number of such pairs; `None`
/// where that is beyond all reason.
pub fn associate(
    colors: &[f64],
    depths: &[f64],
    max_difference: f64,
) -> Option<Vec<(usize, usize)>> {
    const MAX_CANDIDATES: usize = 50_000_000;
    let windows: Vec<_> = colors.iter().map(|&t| window(depths, t, max_difference)).collect();
    if windows.iter().map(|w| w.len()).sum::<usize>() > MAX_CANDIDATES {
        return None;
    }

    // best[j]: largest sum with the colours so far and the depths before j. Sums rise with j, and are
    // constant behind the last window, so only the window has to be visited.
    let mut best = vec![0.0f64; depths.len() + 1];
    let mut reached = 0;
    let mut steps: Vec<Vec<Step>> = Vec::with_capacity(colors.len());
    for (&time, window) in colors.iter().zip(&windows) {
        let constant = best[reached];
        best[reached..=window.end.max(reached)].fill(constant);
        reached = reached.max(window.end);
        let mut diagonal = best[window.start];
        let mut row = Vec::with_capacity(window.len());
        for j in window.clone() {
            let paired = diagonal + max_difference - (time - depths[j]).abs();
            let without_color = best[j + 1];
            diagonal = without_color;
            let (value, step) = [(without_color, Step::SkipColor), (best[j], Step::SkipDepth)]
                .into_iter()
                .fold((paired, Step::Pair), |a, b| if b.0 > a.0 { b } else { a });
            best[j + 1] = value;
            row.push(step);
        }
        steps.push(row);
    }

    let mut pairs = Vec::new();
    let (mut i, mut end) = (colors.len(), depths.len());
    while i > 0 {
        let window = &windows[i - 1];
        end = end.min(window.end).max(window.start.min(end));
        if end <= window.start {
            i -= 1;
            continue;
        }
        match steps[i - 1][end - 1 - window.start] {
            Step::Pair => {
                (i, end) = (i - 1, end - 1);
                pairs.push((i, end));
            }
            Step::SkipColor => i -= 1,
            Step::SkipDepth => end -= 1,
        }
    }
    pairs.reverse();
    Some(pairs)
}

#[derive(Clone, Copy)]
enum Step {
    Pair,
    SkipColor,
    SkipDepth,
}

fn window(depths: &[f64], time: f64, max_difference: f64) -> std::ops::Range<usize> {
    let start = depths.partition_point(|&d| time - d >= max_difference);
    start..depths.partition_point(|&d| d - time < max_difference).max(start)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Rng;

    /// The best sum over all ordered pairings, by plain recursion.
    fn exhaustive(colors: &[f64], depths: &[f64], tolerance: f64) -> f64 {
        let (Some((&c, colors_left)), Some((&d, depths_left))) =
            (colors.split_first(), depths.split_first())
        else {
            return 0.0;
        };
        let gain = tolerance - (c - d).abs();
        let paired =
            if gain > 0.0 { gain + exhaustive(colors_left, depths_left, tolerance) } else { 0.0 };
        paired.max(exhaustive(colors_left, depths, tolerance)).max(exhaustive(
            colors,
            depths_left,
            tolerance,
        ))
    }

    #[test]
    fn no_pairing_is_better() {
        let mut rng = Rng::new(&[11]);
        for _ in 0..300 {
            let mut times = |n: u32| {
                let mut t: Vec<f64> =
                    (0..rng.next_u32() % n).map(|_| f64::from(rng.uniform())).collect();
                t.sort_by(f64::total_cmp);
                t.dedup();
                t
            };
            let (colors, depths) = (times(8), times(8));
            let tolerance = 0.15;
            let pairs = associate(&colors, &depths, tolerance).unwrap();
            assert!(pairs.windows(2).all(|w| w[0].0 < w[1].0 && w[0].1 < w[1].1), "{pairs:?}");
            let gains = pairs.iter().map(|&(i, j)| tolerance - (colors[i] - depths[j]).abs());
            assert!(gains.clone().all(|g| g > 0.0));
            // sums of at most 7 numbers below 1, added in another order
            let (found, best) = (gains.sum::<f64>(), exhaustive(&colors, &depths, tolerance));
            assert!((found - best).abs() < 1e-12, "{found} {best} {colors:?} {depths:?}");
        }
    }

    #[test]
    fn half_an_interval_apart_still_pairs_every_frame() {
        // Mutual nearest neighbours would drop frames here: each colour lies near the middle of two
        // depths, a millisecond to either side.
        let colors: Vec<f64> = (0..100).map(|i| f64::from(i) / 30.0).collect();
        let depths: Vec<f64> =
            colors.iter().enumerate().map(|(i, t)| t + 0.0162 + [1e-3, -1e-3][i % 2]).collect();
        let pairs = associate(&colors, &depths, 0.02).unwrap();
        assert_eq!(pairs, (0..100).map(|i| (i, i)).collect::<Vec<_>>());
    }

    #[test]
    fn absurd_numbers_of_candidates_are_refused() {
        let times: Vec<f64> = (0..20_000).map(f64::from).collect();
        assert!(associate(&times, &times, 1e6).is_none());
        assert_eq!(associate(&[], &times, 1.0).unwrap(), []);
    }
}
