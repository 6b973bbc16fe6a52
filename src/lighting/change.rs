//! Whether the light has changed: surfaces that were seen before are brighter or darker now.
//!
//! The residual of the fit says little about that. Albedo that no class explains makes it large all the
//! time, and other light moves it by less than another piece of wall does. The same surface in two pictures
//! has the same albedo, whatever that is.

use super::bank::{Batch, LANES};
use super::samples::Seen;
use crate::image::Image;
use crate::math::View;
use crate::math::color::luminance;
use glam::Vec3;
use rayon::prelude::*;

/// Surfaces in both pictures that are needed to compare them.
const LEAST_MATCHES: usize = 64;

/// Share of the surfaces that may change without a change of light: a hand, an object carried through.
const UNTOUCHED: f32 = 0.75;

/// A surface is the same where its depth is that of the picture before, relative.
pub const SAME_DEPTH: f32 = 0.02;

/// Darker than this (linear) a pixel is noise.
const BLACK: f32 = 1e-3;

/// The last picture that the light was found from.
#[derive(Clone, Debug, Default)]
pub struct LastPicture {
    view: Option<View>,
    depth_m: Image<f32>,
    luminance: Image<f32>,
    logs: Vec<f32>,
}

impl LastPicture {
    pub fn forget(&mut self) {
        self.view = None;
    }

    pub fn keep(&mut self, seen: &Seen) {
        self.view = Some(seen.surface.view);
        self.depth_m.clone_from(&seen.surface.depth_m);
        let color = &seen.frame.color;
        self.luminance.reshape(color.size(), 0.0);
        self.luminance.par_rows_mut().for_each(|(y, row)| {
            row.iter_mut().zip(color.row(y)).for_each(|(l, &c)| *l = luminance(c));
        });
    }

    /// Upper quartile of |ln(brightness now / brightness then)| over the surfaces of a batch that the last
    /// picture shows too; none where those are too few to tell.
    pub fn change(&mut self, batch: &Batch) -> Option<f32> {
        let view = self.view?;
        let view_from_world = view.view_from_world_f32();
        self.logs.clear();
        for packet in &batch.packets {
            for i in (0..LANES).filter(|&i| packet.present[i] > 0.0) {
                let point = Vec3::from([0, 1, 2].map(|axis| packet.position[axis][i]));
                let then = self.brightness(&view, view_from_world.transform_point3(point));
                let now = packet.seen[i];
                self.logs.extend(then.and_then(|then| change_of(now, then)));
            }
        }
        upper_quartile(&mut self.logs)
    }

    /// A picture that is kept elsewhere.
    #[cfg(feature = "gpu")]
    pub fn keep_elsewhere(&mut self, view: View) {
        self.view = Some(view);
    }

    /// As [`Self::change`], for the luminance `then` of each sample in a picture that is kept elsewhere, 0 where
    /// that does not show it.
    #[cfg(feature = "gpu")]
    pub fn change_since(&mut self, batch: &Batch, then: impl Iterator<Item = f32>) -> Option<f32> {
        self.view?;
        let now = batch.packets.iter().flat_map(|packet| packet.seen);
        self.logs.clear();
        self.logs.extend(now.zip(then).filter_map(|(now, then)| change_of(now, then)));
        upper_quartile(&mut self.logs)
    }

    fn brightness(&self, view: &View, point: Vec3) -> Option<f32> {
        let pixel = view.project(point)?.round();
        let (width, height) = (self.depth_m.width() as f32, self.depth_m.height() as f32);
        let inside = pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < width && pixel.y < height;
        if !inside {
            return None;
        }
        let at = (pixel.x as usize, pixel.y as usize);
        let same = (self.depth_m[at] - point.z).abs() <= SAME_DEPTH * point.z;
        same.then(|| self.luminance[at])
    }
}

/// |ln(now / then)|, unless one is black.
fn change_of(now: f32, then: f32) -> Option<f32> {
    (then > BLACK && now > BLACK).then(|| (now / then).ln().abs())
}

fn upper_quartile(changes: &mut [f32]) -> Option<f32> {
    if changes.len() < LEAST_MATCHES {
        return None;
    }
    let k = (UNTOUCHED * (changes.len() - 1) as f32) as usize;
    Some(*changes.select_nth_unstable_by(k, f32::total_cmp).1)
}
