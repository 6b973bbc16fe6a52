//! Up-sampling as printed (Gruber et al. 2015, Sec. 5.1): bicubic, then Gaussian, blind to edges.
//!
//! The order is bicubic interpolation of the grid first, then a separable Gaussian of the given
//! radius (standard deviation a third of it) over full-resolution pixels. Points without a surface
//! count as the mean of those that have one, so that they darken no neighbour.

use super::grid::{NOTHING, ShadingGrid};
use super::planes::{LANES, Planes, lanes};
use super::upsample::Between;
use crate::image::Size;
use rayon::prelude::*;

/// Scratch of the separable passes.
#[derive(Clone, Debug, Default)]
pub struct BicubicGauss {
    filled: Planes,
    wide: Planes,
    bicubic: Planes,
    blurred: Planes,
    kernel: Vec<f32>,
}

impl BicubicGauss {
    pub fn run(
        &mut self,
        grid: &ShadingGrid,
        image: Size,
        axes: (&[Between], &[Between]),
        radius: usize,
        out: &mut Planes,
    ) {
        gaussian(radius, &mut self.kernel);
        self.fill(grid);
        self.interpolate(image, axes);
        self.blur(image, out);
    }

    fn fill(&mut self, grid: &ShadingGrid) {
        let (size, count) = (grid.size(), grid.planes.count());
        let mut means = [0.0; 9];
        for (p, mean) in means.iter_mut().enumerate().take(count) {
            let (mut sum, mut points) = (0.0, 0usize);
            for j in 0..size.height {
                let row = grid.planes.row(p, j).iter().zip(grid.kind.row(0, j));
                for (&value, _) in row.filter(|(_, kind)| **kind != NOTHING) {
                    sum += f64::from(value);
                    points += 1;
                }
            }
            *mean = if points > 0 { (sum / points as f64) as f32 } else { 1.0 };
        }
        // Where there is no surface at all in both scenes, both must be the same.
        for c in 0..grid.layout.channels {
            means[grid.layout.merged(c)] = means[grid.layout.real(c)];
        }
        self.filled.reshape(size, count);
        self.filled.par_rows_mut().for_each(|(j, row)| {
            for p in 0..count {
                let values = grid.planes.row(p, j).iter().zip(grid.kind.row(0, j));
                let out = row[p * size.width..].iter_mut();
                for (out, (&value, &kind)) in out.zip(values) {
                    *out = if kind == NOTHING { means[p] } else { value };
                }
            }
        });
    }

    fn interpolate(&mut self, image: Size, (columns, rows): (&[Between], &[Between])) {
        let (grid, count) = (self.filled.size(), self.filled.count());
        let filled = &self.filled;
        self.wide.reshape(Size::new(image.width, grid.height), count);
        self.wide.par_rows_mut().for_each(|(j, out)| {
            for p in 0..count {
                let row = filled.row(p, j);
                let out = out[p * image.width..].iter_mut();
                for (out, at) in out.zip(columns) {
                    let weights = catmull_rom(at.share);
                    *out = (0..4).map(|k| weights[k] * row[at.tap(k, grid.width)]).sum();
                }
            }
        });
        let wide = &self.wide;
        self.bicubic.reshape(image, count);
        self.bicubic.par_rows_mut().for_each(|(y, out)| {
            let at = rows[y];
            let weights = catmull_rom(at.share);
            for p in 0..count {
                let taps: [&[f32]; 4] =
                    std::array::from_fn(|k| wide.row(p, at.tap(k, grid.height)));
                let out = &mut out[p * image.width..][..image.width];
                for (x, out) in out.iter_mut().enumerate() {
                    *out = (0..4).map(|k| weights[k] * taps[k][x]).sum();
                }
            }
        });
    }

    fn blur(&mut self, image: Size, out: &mut Planes) {
        let count = self.bicubic.count();
        let (kernel, bicubic) = (&self.kernel, &self.bicubic);
        self.blurred.reshape(image, count);
        self.blurred.par_rows_mut().for_each(|(y, out)| {
            for p in 0..count {
                blur_row(bicubic.row(p, y), kernel, &mut out[p * image.width..][..image.width]);
            }
        });
        let blurred = &self.blurred;
        out.reshape(image, count);
        out.par_rows_mut().for_each(|(y, out)| {
            for p in 0..count {
                let out = &mut out[p * image.width..][..image.width];
                out.fill(0.0);
                for (k, &weight) in kernel.iter().enumerate() {
                    let row = (y + k).saturating_sub(kernel.len() / 2).min(image.height - 1);
                    add_row(blurred.row(p, row), weight, out);
                }
            }
        });
    }
}

impl Between {
    /// Index of tap k of four, the second and third being the two points themselves.
    fn tap(&self, k: usize, length: usize) -> usize {
        (self.first + k).saturating_sub(1).min(length - 1)
    }
}

/// Interpolating cubic weights at `t` between the two middle points.
fn catmull_rom(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [
        0.5 * (-t3 + 2.0 * t2 - t),
        0.5 * (3.0 * t3 - 5.0 * t2 + 2.0),
        0.5 * (-3.0 * t3 + 4.0 * t2 + t),
        0.5 * (t3 - t2),
    ]
}

/// Weights of a Gaussian cut off at three standard deviations.
pub fn gaussian(radius: usize, out: &mut Vec<f32>) {
    let sigma = radius.max(1) as f32 / 3.0;
    out.clear();
    out.extend((0..=2 * radius).map(|k| {
        let x = (k as f32 - radius as f32) / sigma;
        (-0.5 * x * x).exp()
    }));
    let sum: f32 = out.iter().sum();
    out.iter_mut().for_each(|w| *w /= sum);
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn blur_row(row: &[f32], kernel: &[f32], out: &mut [f32]) {
    let radius = (kernel.len() / 2) as isize;
    for (block, out) in out.chunks_mut(LANES).enumerate() {
        let x0 = (block * LANES) as isize - radius;
        let mut sum = [0.0; LANES];
        for (k, &weight) in kernel.iter().enumerate() {
            let values = lanes(row, x0 + k as isize);
            for i in 0..LANES {
                sum[i] += weight * values[i];
            }
        }
        out.copy_from_slice(&sum[..out.len()]);
    }
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn add_row(row: &[f32], weight: f32, out: &mut [f32]) {
    for (out, value) in out.iter_mut().zip(row) {
        *out += weight * value;
    }
}
