//! Filters that are a row times a column. Beyond its border a picture goes on as its last pixel.

use crate::image::Image;

/// Weights at -radius to radius, for a correlation.
pub struct Kernel(Vec<f32>);

impl Kernel {
    /// Weights that sum to 1, and what they summed to before.
    pub fn normalised(radius: usize, weight: impl Fn(f64) -> f64) -> (Self, f64) {
        let weights = sampled(radius, weight);
        let sum: f64 = weights.iter().sum();
        (Self(weights.iter().map(|w| (w / sum) as f32).collect()), sum)
    }

    /// Positive weights that sum to 1, and negative ones that sum to -1.
    pub fn balanced(radius: usize, weight: impl Fn(f64) -> f64) -> Self {
        let weights = sampled(radius, weight);
        let total = |sign: f64| weights.iter().map(|w| (w * sign).max(0.0)).sum::<f64>();
        let (positive, negative) = (total(1.0), total(-1.0));
        let scaled = |&w: &f64| (w / if w > 0.0 { positive } else { negative }) as f32;
        Self(weights.iter().map(scaled).collect())
    }

    fn radius(&self) -> usize {
        self.0.len() / 2
    }
}

fn sampled(radius: usize, weight: impl Fn(f64) -> f64) -> Vec<f64> {
    (0..=2 * radius).map(|i| weight(i as f64 - radius as f64)).collect()
}

/// `row` along x, then `column` along y.
pub fn filter(image: &Image<f32>, row: &Kernel, column: &Kernel) -> Image<f32> {
    use rayon::prelude::*;
    let mut across = Image::new(image.size(), 0.0);
    across.par_rows_mut().for_each_init(Vec::new, |padded: &mut Vec<f32>, (y, out)| {
        let (values, radius) = (image.row(y), row.radius());
        let (first, last) = (values[0], values[values.len() - 1]);
        padded.clear();
        padded.resize(radius, first);
        padded.extend_from_slice(values);
        padded.resize(values.len() + 2 * radius, last);
        for (i, weight) in row.0.iter().enumerate() {
            out.iter_mut().zip(&padded[i..]).for_each(|(o, v)| *o += weight * v);
        }
    });
    let mut out = Image::new(image.size(), 0.0);
    let (radius, bottom) = (column.radius() as isize, image.height() as isize - 1);
    out.par_rows_mut().for_each(|(y, out)| {
        for (i, weight) in column.0.iter().enumerate() {
            let from = (y as isize + i as isize - radius).clamp(0, bottom);
            out.iter_mut().zip(across.row(from as usize)).for_each(|(o, v)| *o += weight * v);
        }
    });
    out
}
