//! Medians over small windows with missing values, for 16 neighbouring pixels at a time.
//!
//! A fixed sorting network needs no branches, so 16 pixels are sorted at once. A value that does not
//! count enters as +inf and ends up behind all others; the rank is then chosen pixel by pixel from the
//! number of values that count. The memory for the values is the caller's.

use crate::image::Image;

pub(super) const LANES: usize = 16;
pub(super) type Lanes = [f32; LANES];

/// Zero, negative, infinite and NaN depth is missing.
#[inline(always)]
pub(super) fn is_depth(depth_m: f32) -> bool {
    // not `< INFINITY`: LLVM makes that a test of bit classes, one lane at a time
    (depth_m > 0.0) & (depth_m <= f32::MAX)
}

/// 16 values of a row from column `x` on; 0.0 where the row does not reach, by way of `rim`.
///
/// A reference, not a copy: values that come from one of two places element by element would not
/// be vectorised.
#[inline(always)]
pub(super) fn lanes<'a>(row: &'a [f32], x: isize, rim: &'a mut Lanes) -> &'a Lanes {
    if x >= 0
        && let Some(inside) = row.get(x as usize..).and_then(<[f32]>::first_chunk)
    {
        return inside;
    }
    load_at_rim(row, x, rim);
    rim
}

#[cold]
#[inline(never)]
fn load_at_rim(row: &[f32], x: isize, out: &mut Lanes) {
    for (i, out) in out.iter_mut().enumerate() {
        let column = usize::try_from(x + i as isize).ok();
        *out = column.and_then(|x| row.get(x)).copied().unwrap_or(0.0);
    }
}

/// A copy of the same.
#[inline(always)]
pub(super) fn load(row: &[f32], x: isize) -> Lanes {
    let mut rim = [0.0; LANES];
    *lanes(row, x, &mut rim)
}

#[inline(always)]
pub(super) fn row_at(image: &Image<f32>, y: isize) -> Option<&[f32]> {
    usize::try_from(y).ok().filter(|&y| y < image.height()).map(|y| image.row(y))
}

/// The pixels that a filter looks at, relative to its own, and how to sort as many values.
#[derive(Clone, Debug)]
pub(super) struct Window {
    taps: Vec<(isize, isize)>,
    /// Compare-exchanges (a, b), a < b: afterwards values\[a\] <= values\[b\].
    exchanges: Vec<(usize, usize)>,
}

impl Window {
    /// A window of `window` pixels reaches `window / 2` pixels to each side, so that it is centred
    /// on its pixel: 2 is 3x3, as is 3. It is sampled at `taps` x `taps` pixels at most, spread
    /// evenly with the window's rim included: 5 taps of a window of 20 stand at -10, -5, 0, 5, 10.
    pub fn new(window: usize, taps: usize) -> Self {
        let taps: Vec<_> = taps_of(window, taps).collect();
        let exchanges = lower_half_network(taps.len());
        Self { taps, exchanges }
    }

    pub fn len(&self) -> usize {
        self.taps.len()
    }

    /// Writes the depths seen by the 16 pixels from (x, y) on to `values`, one row a tap: +inf where
    /// depth is missing or, with a guide, where the guide differs from the pixel's own by the
    /// threshold or more (Eq. 1). Returns how many count.
    #[inline(always)]
    pub fn gather(
        &self,
        depth: &Image<f32>,
        guide: Option<Guide<'_>>,
        x: isize,
        y: isize,
        values: &mut [Lanes],
    ) -> [i32; LANES] {
        let mut count = [0; LANES];
        let (mut rim, mut guide_rim) = ([0.0; LANES], [0.0; LANES]);
        let mut own_rim = [0.0; LANES];
        let own = match guide.and_then(|g| row_at(g.image, y)) {
            Some(row) => lanes(row, x, &mut own_rim),
            None => &[0.0; LANES],
        };
        for (values, &(dx, dy)) in values.iter_mut().zip(&self.taps) {
            *values = [f32::INFINITY; LANES];
            let Some(row) = row_at(depth, y + dy) else { continue };
            let mut kept = *lanes(row, x + dx, &mut rim);
            for i in 0..LANES {
                // NaN and negative values fail, +inf passes as the +inf that does not count
                kept[i] = if kept[i] > 0.0 { kept[i] } else { f32::INFINITY };
            }
            if let Some(guide) = guide
                && let Some(row) = row_at(guide.image, y + dy)
            {
                let other = lanes(row, x + dx, &mut guide_rim);
                for i in 0..LANES {
                    let step = (other[i] - own[i]).abs();
                    kept[i] = if step < guide.threshold { kept[i] } else { f32::INFINITY };
                }
            }
            for i in 0..LANES {
                count[i] += i32::from(kept[i] < f32::INFINITY);
            }
            *values = kept;
        }
        count
    }

    /// Among gathered `values`, how many are within `tolerance` of `other` at the same pixel (Eq. 2).
    #[inline(always)]
    pub fn count_close(
        &self,
        values: &[Lanes],
        other: &Image<f32>,
        tolerance: f32,
        x: isize,
        y: isize,
    ) -> [i32; LANES] {
        let mut count = [0; LANES];
        let mut rim = [0.0; LANES];
        for (values, &(dx, dy)) in values.iter().zip(&self.taps) {
            let Some(row) = row_at(other, y + dy) else { continue };
            let other = lanes(row, x + dx, &mut rim);
            for i in 0..LANES {
                // holds for no value that does not count: |inf - x| is inf or NaN
                let close = (other[i] > 0.0) & ((values[i] - other[i]).abs() <= tolerance);
                count[i] += i32::from(close);
            }
        }
        count
    }

    /// The lower median of the first `count` of the gathered values in order of size, that is the
    /// one of rank (count - 1) / 2: always a depth that was measured, never a mean across an edge.
    /// 0.0 where `count` is 0.
    #[inline(always)]
    pub fn lower_median(&self, values: &mut [Lanes], count: &[i32; LANES]) -> Lanes {
        for &(a, b) in &self.exchanges {
            let (va, vb) = (values[a], values[b]);
            let (mut low, mut high) = (va, vb);
            for i in 0..LANES {
                low[i] = if va[i] < vb[i] { va[i] } else { vb[i] };
                high[i] = if va[i] > vb[i] { va[i] } else { vb[i] };
            }
            (values[a], values[b]) = (low, high);
        }
        let mut median = [0.0; LANES];
        for (rank, &values) in values[..self.len().div_ceil(2)].iter().enumerate() {
            for i in 0..LANES {
                let chosen = (count[i] - 1) >> 1 == rank as i32;
                median[i] = if chosen { values[i] } else { median[i] };
            }
        }
        median
    }
}

/// A picture whose edges a filter does not cross.
#[derive(Clone, Copy, Debug)]
pub(super) struct Guide<'a> {
    pub image: &'a Image<f32>,
    pub threshold: f32,
}

/// The same pixels (x, y) for another device.
#[cfg(feature = "gpu")]
pub(crate) fn window_taps(window: usize, taps: usize) -> Vec<[i32; 2]> {
    taps_of(window, taps).map(|(dx, dy)| [dx as i32, dy as i32]).collect()
}

fn taps_of(window: usize, taps: usize) -> impl Iterator<Item = (isize, isize)> {
    let offsets = offsets(window, taps);
    let across = offsets.clone();
    offsets.into_iter().flat_map(move |dy| across.clone().into_iter().map(move |dx| (dx, dy)))
}

fn offsets(window: usize, taps: usize) -> Vec<isize> {
    let reach = window / 2;
    let taps = taps.clamp(1, 2 * reach + 1);
    if taps == 1 {
        return vec![0];
    }
    let spacing = (2 * reach) as f64 / (taps - 1) as f64;
    (0..taps).map(|i| (i as f64 * spacing - reach as f64).round() as isize).collect()
}

/// Batcher's merge exchange (Knuth, TAOCP vol. 3, algorithm 5.2.2M), without the exchanges that the
/// lower half of the sorted values does not depend on.
fn lower_half_network(n: usize) -> Vec<(usize, usize)> {
    let mut exchanges = Vec::new();
    let largest = n.next_power_of_two() / 2;
    let mut p = largest;
    while p > 0 {
        let (mut q, mut r, mut d) = (largest, 0, p);
        loop {
            let pairs = (0..n.saturating_sub(d)).filter(|i| i & p == r).map(|i| (i, i + d));
            exchanges.extend(pairs);
            if q == p {
                break;
            }
            (d, q, r) = (q - p, q / 2, p);
        }
        p /= 2;
    }
    let mut needed: Vec<bool> = (0..n).map(|rank| rank < n.div_ceil(2)).collect();
    let mut kept: Vec<_> = exchanges
        .into_iter()
        .rev()
        .filter(|&(a, b)| {
            let keep = needed[a] | needed[b];
            (needed[a], needed[b]) = (keep, keep);
            keep
        })
        .collect();
    kept.reverse();
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Rng;

    #[test]
    fn windows_are_centred_and_spread_to_their_rim() {
        assert_eq!(offsets(20, 5), [-10, -5, 0, 5, 10]);
        assert_eq!(offsets(8, 5), [-4, -2, 0, 2, 4]);
        assert_eq!(offsets(2, 3), [-1, 0, 1]);
        assert_eq!(offsets(3, 9), [-1, 0, 1]);
        assert_eq!(offsets(7, 4), [-3, -1, 1, 3]);
        assert_eq!(offsets(1, 5), [0]);
        assert_eq!(offsets(0, 0), [0]);
    }

    /// A network that sorts every sequence of zeros and ones sorts everything (Knuth's 0-1
    /// principle). The pruned one must place the lower half.
    #[test]
    fn network_places_the_lower_half_of_every_zero_one_sequence() {
        for n in 1..=16usize {
            let network = lower_half_network(n);
            for bits in 0..1u32 << n {
                let mut values: Vec<u32> = (0..n).map(|i| bits >> i & 1).collect();
                for &(a, b) in &network {
                    (values[a], values[b]) = (values[a].min(values[b]), values[a].max(values[b]));
                }
                let zeros = n - bits.count_ones() as usize;
                for (rank, &value) in values[..n.div_ceil(2)].iter().enumerate() {
                    assert_eq!(
                        value,
                        u32::from(rank >= zeros),
                        "{n} values, {bits:b}, rank {rank}"
                    );
                }
            }
        }
    }

    #[test]
    fn median_of_any_count_equals_that_of_sorting() {
        let mut rng = Rng::new(&[3]);
        for (window, taps) in [(20, 5), (2, 3), (4, 5), (12, 13), (1, 1)] {
            let window = Window::new(window, taps);
            let n = window.len();
            for count in 0..=n {
                let mut values: Vec<Lanes> =
                    (0..n).map(|_| std::array::from_fn(|_| rng.uniform() + 0.5)).collect();
                // each lane loses other values
                for lane in 0..LANES {
                    for lost in 0..n - count {
                        values[(lost * 7 + lane) % n][lane] = f32::INFINITY;
                    }
                }
                let counts = std::array::from_fn(|lane| {
                    values.iter().filter(|v| v[lane].is_finite()).count() as i32
                });
                let expected: Lanes = std::array::from_fn(|lane| {
                    let mut sorted: Vec<f32> = values.iter().map(|v| v[lane]).collect();
                    sorted.sort_by(f32::total_cmp);
                    if counts[lane] == 0 { 0.0 } else { sorted[(counts[lane] as usize - 1) / 2] }
                });
                assert_eq!(window.lower_median(&mut values, &counts), expected);
            }
        }
    }

    #[test]
    fn loading_past_the_rim_gives_zeros() {
        let row = [1.0, 2.0, 3.0];
        let mut expected = [0.0; LANES];
        expected[2..5].copy_from_slice(&row);
        assert_eq!(load(&row, -2), expected);
        assert_eq!(load(&row, 3), [0.0; LANES]);
        assert_eq!(load(&row, -40), [0.0; LANES]);
        assert_eq!(load(&[], 0), [0.0; LANES]);
    }
}
