//! The three passes without any cleverness.

use crate::capture::RgbdFrame;
use crate::geometry::DynGeoParams;
use crate::image::{Image, Size};

/// Eq. 1-5 read off the page: all values of the window in f64, sorted.
pub struct Oracle<'a> {
    pub frame: &'a RgbdFrame,
    pub model: &'a Image<f32>,
    pub params: &'a DynGeoParams,
}

impl Oracle<'_> {
    fn neighbours(
        &self,
        depth: &Image<f32>,
        (x, y): (usize, usize),
        (window, taps): (usize, usize),
        guided: bool,
    ) -> Vec<(usize, usize)> {
        let reach = (window / 2) as f64;
        let taps = taps.min(2 * (window / 2) + 1);
        let spread =
            |i: usize| (-reach + 2.0 * reach * i as f64 / (taps - 1) as f64).round() as i64;
        let mut found = Vec::new();
        for j in 0..taps {
            for i in 0..taps {
                let (u, v) = (x as i64 + spread(i), y as i64 + spread(j));
                let inside = (0..depth.width() as i64).contains(&u)
                    && (0..depth.height() as i64).contains(&v);
                if !inside {
                    continue;
                }
                let q = (u as usize, v as usize);
                let step = f64::from(self.frame.intensity[q] - self.frame.intensity[(x, y)]).abs();
                let similar = step < f64::from(self.params.intensity_threshold);
                if depth[q] > 0.0 && (similar || !guided) {
                    found.push(q);
                }
            }
        }
        found
    }

    fn median(depth: &Image<f32>, at: &[(usize, usize)]) -> f32 {
        let mut values: Vec<f64> = at.iter().map(|&q| f64::from(depth[q])).collect();
        values.sort_by(f64::total_cmp);
        if values.is_empty() { 0.0 } else { values[(values.len() - 1) / 2] as f32 }
    }

    fn close(&self, q: (usize, usize)) -> bool {
        let (sensor, model) = (f64::from(self.frame.depth_m[q]), f64::from(self.model[q]));
        model > 0.0 && (sensor - model).abs() <= f64::from(self.params.depth_threshold_m)
    }

    fn merged(&self, p: (usize, usize)) -> f32 {
        let (sensor, model) = (self.frame.depth_m[p], self.model[p]);
        if sensor > 0.0 {
            return if self.close(p) { model } else { sensor };
        }
        let window = (self.params.merge_window, self.params.taps);
        let similar = self.neighbours(&self.frame.depth_m, p, window, true);
        let close = similar.iter().filter(|&&q| self.close(q)).count();
        let majority = close as f64 >= similar.len() as f64 / 2.0;
        if model > 0.0 && majority { model } else { Self::median(&self.frame.depth_m, &similar) }
    }

    pub fn image(size: Size, pixel: impl Fn((usize, usize)) -> f32) -> Image<f32> {
        let all = (0..size.height).flat_map(|y| (0..size.width).map(move |x| (x, y)));
        Image::from_vec(size, all.map(pixel).collect())
    }

    /// D', D'', D'''.
    pub fn passes(&self) -> [Image<f32>; 3] {
        let size = self.model.size();
        let p = self.params;
        let merged = Self::image(size, |q| self.merged(q));
        let smoothed = Self::image(size, |q| {
            let at = self.neighbours(&merged, q, (p.smooth_window, p.taps), true);
            Self::median(&merged, &at)
        });
        let denoised = Self::image(size, |q| {
            let at = self.neighbours(&smoothed, q, (p.denoise_window, 99), false);
            Self::median(&smoothed, &at)
        });
        [merged, smoothed, denoised]
    }
}
