//! DynGeo: fuses the newest depth with the model in image space (Gruber et al. 2015, Sec. 4,
//! Eq. 1-5), so that a moving hand shows at once while static surfaces keep the model's quality.
//!
//! What the equations leave open, and what is done:
//! - Sensor depth without model depth is taken as it is. With neither, and no neighbour to take a
//!   median of, depth stays missing.
//! - A difference of exactly lambda_D counts as close, in Eq. 2 as in Eq. 3. Eq. 1 is strict, as
//!   printed, so lambda_I must be positive.
//! - Where the majority of Eq. 3 asks for a model depth that is missing, the median is taken.
//!   Where Omega_I is empty, 0 >= 0 holds, and the model's depth is taken.
//! - Omega_k is the pixels of the window *that have depth* in the picture being filtered, inside
//!   the image. Windows of an even size are centred (see [`Window::new`]): k = 2 is 3x3.
//! - The median of an even count is the lower one.
//!
//! Normals of the result are the model's where its depth is within lambda_D of the result, which
//! is Eq. 3's own test for "the same surface"; elsewhere they come from the filtered depth.

use super::median::{Guide, LANES, Lanes, Window, is_depth, load};
use super::{DynGeoParams, GBuffer, normals};
use crate::capture::RgbdFrame;
use crate::image::Image;
use rayon::prelude::*;

#[cfg(test)]
mod tests;

/// Rows that share one sorting buffer, and are worked on by one thread.
const BAND: usize = 8;

/// The DynGeo stage, with the memory it keeps from frame to frame.
#[derive(Clone, Debug)]
pub struct DynGeo {
    params: DynGeoParams,
    merge: Window,
    smooth: Window,
    denoise: Window,
    merged: Image<f32>,
    smoothed: Image<f32>,
    scratch: Vec<Lanes>,
}

impl DynGeo {
    pub fn new(params: &DynGeoParams) -> Self {
        Self {
            merge: Window::new(params.merge_window, params.taps),
            smooth: Window::new(params.smooth_window, params.taps),
            denoise: Window::new(params.denoise_window, usize::MAX),
            params: params.clone(),
            merged: Image::default(),
            smoothed: Image::default(),
            scratch: Vec::new(),
        }
    }

    /// Writes the filtered geometry buffer G_r of `frame` to `out`: depth D''' in metres, world
    /// normals, origin [`Model`](super::Origin::Model) or [`Sensor`](super::Origin::Sensor).
    ///
    /// `model` is ray-cast from the volume into the camera of `frame`. A sensor pixel may end
    /// without a normal (0) where no neighbour lies on its surface. With all passes off, `out` is the
    /// model itself.
    ///
    /// # Panics
    /// If frame and model differ in size.
    pub fn run(&mut self, frame: &RgbdFrame, model: &GBuffer, out: &mut GBuffer) {
        let size = model.size();
        assert_eq!(frame.depth_m.size(), size, "sensor depth against model");
        assert_eq!(frame.intensity.size(), size, "intensity against model");
        if !(self.params.merge || self.params.smooth || self.params.denoise) {
            return out.copy_from(model);
        }
        out.set_view(model.view);

        let guide = Guide { image: &frame.intensity, threshold: self.params.intensity_threshold };
        let mut depth = &model.depth_m;
        if self.params.merge {
            self.merged.reshape(size, 0.0);
            let merge = Merge {
                sensor: &frame.depth_m,
                model: &model.depth_m,
                guide,
                window: &self.merge,
                close_m: self.params.depth_threshold_m,
            };
            for_each_row(&mut self.merged, &mut self.scratch, &self.merge, |y, row, values| {
                merge_row(&merge, y, row, values);
            });
            depth = &self.merged;
        }
        if self.params.smooth {
            self.smoothed.reshape(size, 0.0);
            for_each_row(&mut self.smoothed, &mut self.scratch, &self.smooth, |y, row, values| {
                median_row(depth, Some(guide), &self.smooth, y, row, values);
            });
            depth = &self.smoothed;
        }
        if self.params.denoise {
            for_each_row(&mut out.depth_m, &mut self.scratch, &self.denoise, |y, row, values| {
                median_row(depth, None, &self.denoise, y, row, values);
            });
        } else {
            copy_depth(&mut out.depth_m, depth);
        }
        normals::assign(out, model, self.params.depth_threshold_m);
    }

    /// D' of the last frame, in metres; `None` where that pass is off or nothing ran yet.
    pub fn merged(&self) -> Option<&Image<f32>> {
        (self.merged.size().pixels() > 0).then_some(&self.merged)
    }

    /// D'' of the last frame, in metres; `None` where that pass is off or nothing ran yet.
    pub fn smoothed(&self) -> Option<&Image<f32>> {
        (self.smoothed.size().pixels() > 0).then_some(&self.smoothed)
    }
}

/// Runs `work(y, row, values)` on every row, with memory for one value a tap of `window`.
fn for_each_row(
    out: &mut Image<f32>,
    scratch: &mut Vec<Lanes>,
    window: &Window,
    work: impl Fn(usize, &mut [f32], &mut [Lanes]) + Sync,
) {
    let (width, bands) = (out.width().max(1), out.height().div_ceil(BAND));
    let needed = bands * window.len();
    if scratch.len() < needed {
        scratch.resize(needed, [0.0; LANES]);
    }
    out.as_mut_slice()
        .par_chunks_mut(width * BAND)
        .zip(scratch.par_chunks_mut(window.len()))
        .enumerate()
        .for_each(|(band, (rows, values))| {
            for (i, row) in rows.chunks_mut(width).enumerate() {
                work(band * BAND + i, row, values);
            }
        });
}

struct Merge<'a> {
    sensor: &'a Image<f32>,
    model: &'a Image<f32>,
    guide: Guide<'a>,
    window: &'a Window,
    close_m: f32,
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn merge_row(merge: &Merge<'_>, y: usize, out: &mut [f32], values: &mut [Lanes]) {
    for (chunk, out) in out.chunks_mut(LANES).enumerate() {
        let merged = merge_lanes(merge, (chunk * LANES) as isize, y, values);
        out.copy_from_slice(&merged[..out.len()]);
    }
}

/// Eq. 3 for the 16 pixels from (x, y) on.
#[inline(always)]
fn merge_lanes(merge: &Merge<'_>, x: isize, y: usize, values: &mut [Lanes]) -> Lanes {
    let sensor = load(merge.sensor.row(y), x);
    let model = load(merge.model.row(y), x);
    let mut out = [0.0; LANES];
    let mut missing = false;
    for i in 0..LANES {
        let close = is_depth(model[i]) & ((sensor[i] - model[i]).abs() <= merge.close_m);
        out[i] = if close { model[i] } else { sensor[i] };
        missing |= !is_depth(sensor[i]);
    }
    if !missing {
        return out;
    }

    // Fill holes: the model where the majority of the support agrees with it, else the median.
    let y = y as isize;
    let count = merge.window.gather(merge.sensor, Some(merge.guide), x, y, values);
    let close = merge.window.count_close(values, merge.model, merge.close_m, x, y);
    let median = merge.window.lower_median(values, &count);
    for i in 0..LANES {
        let by_model = is_depth(model[i]) & (2 * close[i] >= count[i]);
        let filled = if by_model { model[i] } else { median[i] };
        out[i] = if is_depth(sensor[i]) { out[i] } else { filled };
    }
    out
}

/// Eq. 4 with a guide, Eq. 5 without.
#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn median_row(
    depth: &Image<f32>,
    guide: Option<Guide<'_>>,
    window: &Window,
    y: usize,
    out: &mut [f32],
    values: &mut [Lanes],
) {
    for (chunk, out) in out.chunks_mut(LANES).enumerate() {
        let count = window.gather(depth, guide, (chunk * LANES) as isize, y as isize, values);
        let median = window.lower_median(values, &count);
        out.copy_from_slice(&median[..out.len()]);
    }
}

fn copy_depth(out: &mut Image<f32>, depth: &Image<f32>) {
    out.par_rows_mut().for_each(|(y, row)| {
        for (out, &depth) in row.iter_mut().zip(depth.row(y)) {
            *out = if is_depth(depth) { depth } else { 0.0 };
        }
    });
}
