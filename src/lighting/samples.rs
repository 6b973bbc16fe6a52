//! The pixels that the light is estimated from: rows of T with the intensity seen there.

use super::normal_equations::{NormalEquations, dot_padded, padded};
use super::{LightChannels, LightParams};
use crate::capture::RgbdFrame;
use crate::geometry::{GBuffer, Origin};
use crate::math::color::luminance;
use crate::transfer::TransferMap;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Sample rows of one unit of parallel work. Fixed, so that sums do not depend on the threads.
const ROWS_PER_STRIP: usize = 8;

/// The median of the residuals is taken from every n-th sample.
const MEDIAN_STRIDE: usize = 8;

/// Why pixels were left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    pub used: usize,
    pub no_surface: usize,
    pub grazing: usize,
    pub dark: usize,
    pub saturated: usize,
}

/// Samples of a few rows of the image.
#[derive(Clone, Debug, Default)]
struct Strip {
    /// `padded(n)` transfer coefficients a sample.
    rows: Vec<f32>,
    /// Linear light, one plane a channel.
    targets: Vec<Vec<f32>>,
    luminance: Vec<f32>,
    residuals: Vec<f32>,
    weights: Vec<f32>,
    sums: NormalEquations,
    counts: Counts,
}

/// Squared residuals and what they are relative to.
#[derive(Clone, Copy, Debug, Default)]
pub struct Residual {
    /// Sum of squared differences between seen and predicted luminance, weighted.
    pub squares: f64,
    /// Sum of squared luminance, with the same weights.
    pub energy: f64,
    pub weight: f64,
}

impl Residual {
    /// Root mean square relative to that of the image; 0 for a black image.
    pub fn relative(&self) -> f64 {
        if self.energy > 0.0 { (self.squares / self.energy).max(0.0).sqrt() } else { 0.0 }
    }
}

/// Samples of one frame; keeps its memory from frame to frame.
#[derive(Clone, Debug, Default)]
pub struct Samples {
    n: usize,
    channels: usize,
    strips: Vec<Strip>,
    median: Vec<f32>,
}

impl Samples {
    /// Collects every usable pixel, with weight 1.
    pub fn gather(
        &mut self,
        frame: &RgbdFrame,
        surface: &GBuffer,
        transfer: &TransferMap,
        params: &LightParams,
    ) -> Counts {
        let size = surface.size();
        assert_eq!(frame.color.size(), size, "colour and surface of one frame");
        assert_eq!(frame.color_srgb.size(), size, "colour and surface of one frame");
        self.n = transfer.bands * transfer.bands;
        self.channels = match params.channels {
            LightChannels::Intensity => 1,
            LightChannels::Rgb => 3,
        };
        let every = params.stride.div_ceil(transfer.step.max(1)).max(1);
        let sample_rows = transfer.grid.height.div_ceil(every);
        self.strips.resize_with(sample_rows.div_ceil(ROWS_PER_STRIP), Strip::default);
        let gather = Gather::new(frame, surface, transfer, params);
        let channels = self.channels;
        self.strips.par_iter_mut().enumerate().for_each(|(s, strip)| {
            strip.clear(channels);
            for row in s * ROWS_PER_STRIP..((s + 1) * ROWS_PER_STRIP).min(sample_rows) {
                for i in (0..transfer.grid.width).step_by(every) {
                    gather.pixel(i, row * every, strip);
                }
            }
            strip.weights.resize(strip.luminance.len(), 1.0);
        });
        self.counts()
    }

    fn counts(&self) -> Counts {
        self.strips.iter().fold(Counts::default(), |a, strip| {
            let b = strip.counts;
            Counts {
                used: a.used + b.used,
                no_surface: a.no_surface + b.no_surface,
                grazing: a.grazing + b.grazing,
                dark: a.dark + b.dark,
                saturated: a.saturated + b.saturated,
            }
        })
    }

    /// Normal equations of the samples with their present weights.
    pub fn accumulate(&mut self, out: &mut NormalEquations) {
        let (n, channels) = (self.n, self.channels);
        self.strips.par_iter_mut().for_each(|s| {
            s.sums.reset(n, channels);
            s.sums.add_rows(&s.rows, &s.targets, &s.weights);
        });
        out.reset(n, channels);
        for strip in &self.strips {
            out.add_scaled(&strip.sums, 1.0);
        }
    }

    /// Residuals of the luminance under a light (`n` coefficients), with the present weights.
    pub fn residual(&mut self, light: &[f32]) -> Residual {
        let mut coefficients = [0.0; 48];
        coefficients[..self.n].copy_from_slice(&light[..self.n]);
        self.strips.par_iter_mut().for_each(|s| match padded(self.n) {
            16 => s.residuals::<16>(&coefficients),
            32 => s.residuals::<32>(&coefficients),
            _ => s.residuals::<48>(&coefficients),
        });
        let mut total = Residual::default();
        for strip in &self.strips {
            for ((&r, &i), &w) in strip.residuals.iter().zip(&strip.luminance).zip(&strip.weights) {
                total.squares += f64::from(w * r * r);
                total.energy += f64::from(w * i * i);
                total.weight += f64::from(w);
            }
        }
        total
    }

    /// Huber weights from the residuals that [`Self::residual`] left: 1 up to `threshold` robust
    /// standard deviations, falling off as 1/|r| beyond.
    pub fn weigh(&mut self, threshold: f32) {
        let limit = threshold * self.robust_deviation();
        self.strips.par_iter_mut().for_each(|s| {
            for (w, r) in s.weights.iter_mut().zip(&s.residuals) {
                *w = if r.abs() > limit { limit / r.abs() } else { 1.0 };
            }
        });
    }

    /// 1.4826 times the median of |r|: the standard deviation, where the errors are normal.
    fn robust_deviation(&mut self) -> f32 {
        self.median.clear();
        for strip in &self.strips {
            self.median.extend(strip.residuals.iter().step_by(MEDIAN_STRIDE).map(|r| r.abs()));
        }
        if self.median.is_empty() {
            return 0.0;
        }
        let middle = self.median.len() / 2;
        1.4826 * *self.median.select_nth_unstable_by(middle, f32::total_cmp).1
    }
}

impl Strip {
    fn clear(&mut self, channels: usize) {
        self.rows.clear();
        self.targets.resize(channels, Vec::new());
        self.targets.iter_mut().for_each(Vec::clear);
        self.luminance.clear();
        self.residuals.clear();
        self.weights.clear();
        self.counts = Counts::default();
    }

    fn residuals<const P: usize>(&mut self, light: &[f32; 48]) {
        let light: [f32; P] = std::array::from_fn(|i| light[i]);
        self.residuals.clear();
        let (rows, _) = self.rows.as_chunks::<P>();
        self.residuals.extend(
            rows.iter().zip(&self.luminance).map(|(row, seen)| seen - dot_padded(row, &light)),
        );
    }
}

/// What decides whether a pixel is usable.
struct Gather<'a> {
    frame: &'a RgbdFrame,
    surface: &'a GBuffer,
    transfer: &'a TransferMap,
    brightest: f32,
    darkest: f32,
    min_cosine: f32,
    model_only: bool,
    row_length: usize,
    world_from_view: glam::Affine3A,
}

impl<'a> Gather<'a> {
    fn new(
        frame: &'a RgbdFrame,
        surface: &'a GBuffer,
        transfer: &'a TransferMap,
        params: &LightParams,
    ) -> Self {
        Self {
            frame,
            surface,
            transfer,
            brightest: params.max_encoded * 255.0,
            darkest: params.min_encoded * 255.0,
            min_cosine: params.min_cosine,
            model_only: params.model_only,
            row_length: padded(transfer.bands * transfer.bands),
            world_from_view: surface.view.world_from_view_f32(),
        }
    }

    fn pixel(&self, i: usize, j: usize, out: &mut Strip) {
        let (x, y) = self.transfer.pixel(i, j, self.surface.size());
        let row = self.transfer.at(i, j);
        if !self.has_surface(x, y, row) {
            out.counts.no_surface += 1;
            return;
        }
        let [r, g, b] = self.frame.color_srgb[(x, y)];
        let brightest = f32::from(r.max(g).max(b));
        let color = self.frame.color[(x, y)];
        let seen = luminance(color);
        if brightest > self.brightest {
            out.counts.saturated += 1;
        } else if brightest < self.darkest || !seen.is_finite() {
            out.counts.dark += 1;
        } else if self.cosine_to_eye(x, y) < self.min_cosine {
            out.counts.grazing += 1;
        } else {
            out.counts.used += 1;
            out.rows.extend_from_slice(row);
            out.rows.resize(out.rows.len() + self.row_length - row.len(), 0.0);
            out.luminance.push(seen);
            match &mut out.targets[..] {
                [white] => white.push(seen),
                planes => planes.iter_mut().zip(color).for_each(|(p, c)| p.push(c)),
            }
        }
    }

    fn has_surface(&self, x: usize, y: usize, row: &[f32]) -> bool {
        let depth = self.surface.depth_m[(x, y)];
        let real = match self.surface.origin[(x, y)] {
            Origin::Model => true,
            Origin::Sensor => !self.model_only,
            Origin::None | Origin::Virtual => false,
        };
        // The sum is finite only where every coefficient is.
        let energy: f32 = row.iter().map(|t| t * t).sum();
        real && depth > 0.0 && depth.is_finite() && energy > 0.0 && energy.is_finite()
    }

    fn cosine_to_eye(&self, x: usize, y: usize) -> f32 {
        let towards_eye: Vec3 = self
            .world_from_view
            .transform_vector3(self.surface.view.towards_eye(Vec2::new(x as f32, y as f32)));
        let cosine = self.surface.normals.at(x, y).dot(towards_eye);
        if cosine.is_finite() { cosine } else { -1.0 }
    }
}
