//! Bilateral filter of the depth picture (Newcombe et al. 2011, Eq. 2).

use super::padded::PaddedDepth;
use super::{LANES, TrackingParams};
use rayon::prelude::*;

#[derive(Clone, Debug)]
pub(crate) struct Bilateral {
    pub radius: usize,
    /// Spatial weights, `2 radius + 1` squared, row-major.
    pub spatial: Vec<f32>,
    /// `1 / (2 sigma_m^2 * 8)`, see [`filter_row_body`].
    pub range_scale: f32,
}

impl Bilateral {
    pub fn new(params: &TrackingParams) -> Self {
        let radius = params.filter_radius;
        let two_sigma_sq = 2.0 * params.filter_sigma_px.max(1e-3).powi(2);
        let offset = |i: usize| i as f32 - radius as f32;
        let side = 2 * radius + 1;
        let spatial = (0..side * side)
            .map(|i| (-(offset(i / side).powi(2) + offset(i % side).powi(2)) / two_sigma_sq).exp())
            .collect();
        let range_scale = 1.0 / (16.0 * params.filter_sigma_m.max(1e-6).powi(2));
        Self { radius, spatial, range_scale }
    }

    /// Margin that the input of [`Self::apply`] needs.
    pub fn margin(&self) -> usize {
        self.radius
    }

    /// Writes the filtered `depth` to `out` of the same size.
    pub(super) fn apply(&self, depth: &PaddedDepth, out: &mut PaddedDepth) {
        out.par_rows_mut().for_each(|(y, row)| filter_row(row, y, depth, self));
    }
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn filter_row(out: &mut [f32], y: usize, depth: &PaddedDepth, filter: &Bilateral) {
    filter_row_body(out, y, depth, filter);
}

/// The range weight exp(-t) is taken as max(0, 1 - t/8)^8: within 0.035 of it, no call of `exp`, and
/// exactly zero beyond four standard deviations, so that surfaces further apart never mix.
#[inline(always)]
fn filter_row_body(out: &mut [f32], y: usize, depth: &PaddedDepth, filter: &Bilateral) {
    let side = 2 * filter.radius + 1;
    let centre_row = depth.row(y);
    for (chunk, out) in out.chunks_exact_mut(LANES).enumerate() {
        let x0 = chunk * LANES;
        let mut centre = [0f32; LANES];
        centre.copy_from_slice(&centre_row[x0..x0 + LANES]);
        if centre.iter().all(|&c| c == 0.0) {
            out.fill(0.0);
            continue;
        }
        let mut offset = [0f32; LANES];
        let mut weight = [0f32; LANES];
        for line in 0..side {
            let taps = &depth.row_with_margin(y, line)[x0..x0 + LANES + 2 * filter.radius];
            let spatial = &filter.spatial[line * side..(line + 1) * side];
            for (window, &spatial) in taps.windows(LANES).zip(spatial) {
                for i in 0..LANES {
                    let difference = window[i] - centre[i];
                    let t = (1.0 - difference * difference * filter.range_scale).max(0.0);
                    let t2 = t * t;
                    let t4 = t2 * t2;
                    let w = if window[i] > 0.0 { spatial * (t4 * t4) } else { 0.0 };
                    offset[i] += w * difference;
                    weight[i] += w;
                }
            }
        }
        for i in 0..LANES {
            // The centre's own weight is 1 where there is depth.
            out[i] = if centre[i] > 0.0 { centre[i] + offset[i] / weight[i] } else { 0.0 };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Size;

    fn padded(
        size: Size,
        margin: usize,
        depth: impl Fn(usize, usize) -> f32 + Sync,
    ) -> PaddedDepth {
        let mut out = PaddedDepth::new(size, margin);
        out.par_rows_mut().for_each(|(y, row)| {
            for x in 0..size.width {
                row[x] = depth(x, y);
            }
        });
        out
    }

    /// The filter as printed, in f64 with `exp`.
    fn reference(
        params: &TrackingParams,
        size: Size,
        x: usize,
        y: usize,
        d: impl Fn(usize, usize) -> f32,
    ) -> f64 {
        let r = params.filter_radius as isize;
        let centre = f64::from(d(x, y));
        let (mut sum, mut weight) = (0.0, 0.0);
        for dy in -r..=r {
            for dx in -r..=r {
                let (u, v) = (x as isize + dx, y as isize + dy);
                if u < 0 || v < 0 || u >= size.width as isize || v >= size.height as isize {
                    continue;
                }
                let tap = f64::from(d(u as usize, v as usize));
                if tap == 0.0 {
                    continue;
                }
                let space = (dx * dx + dy * dy) as f64 / f64::from(params.filter_sigma_px).powi(2);
                let range = ((tap - centre) / f64::from(params.filter_sigma_m)).powi(2);
                let w = (-0.5 * (space + range)).exp();
                sum += w * tap;
                weight += w;
            }
        }
        sum / weight
    }

    #[test]
    fn agrees_with_the_printed_filter_and_keeps_edges_and_holes() {
        let params = TrackingParams::default();
        let size = Size::new(67, 43);
        let depth = |x: usize, y: usize| match (x, y) {
            (20..23, 10..14) | (66, _) => 0.0,
            // a step of 1 m, texture of a few millimetres
            _ => {
                let step = if x + y > 60 { 2.5 } else { 1.5 };
                step + 0.004 * ((x * 7 + y * 13) % 5) as f32
            }
        };
        let filter = Bilateral::new(&params);
        let mut out = PaddedDepth::new(size, 1);
        filter.apply(&padded(size, filter.margin(), depth), &mut out);
        for y in 0..size.height {
            for x in 0..size.width {
                let got = out.row(y)[x];
                if depth(x, y) == 0.0 {
                    assert_eq!(got, 0.0);
                } else {
                    let want = reference(&params, size, x, y, depth);
                    // weights within 3.5 %, of taps at most 16 mm apart
                    assert!((f64::from(got) - want).abs() < 4e-4, "({x},{y}): {got} for {want}");
                }
            }
            assert!(out.row(y)[size.width..].iter().all(|&d| d == 0.0), "padding stays missing");
        }
    }

    #[test]
    fn radius_zero_copies() {
        let params = TrackingParams { filter_radius: 0, ..Default::default() };
        let size = Size::new(17, 3);
        let depth = |x: usize, y: usize| (x + y) as f32 * 0.3;
        let mut out = PaddedDepth::new(size, 1);
        Bilateral::new(&params).apply(&padded(size, 0, depth), &mut out);
        for (x, y) in [(0, 0), (16, 2), (5, 1)] {
            assert_eq!(out.row(y)[x], depth(x, y));
        }
    }
}
