//! Which pixels tell something about the light.

use super::LightParams;
use super::bank::{Batch, Sample};
use crate::capture::RgbdFrame;
use crate::geometry::{GBuffer, Origin};
use crate::math::color::luminance;
use crate::transfer::TransferMap;
use glam::{Affine3A, Vec2, Vec3};
use rayon::prelude::*;

const ROWS_PER_STRIP: usize = 8;

/// The two-dimensional golden ratio (the real root of x^3 = x + 1) to the power of -1 and -2, in steps of 2^-32:
/// ranks of neighbours are far from each other, and any range of ranks is spread evenly over the picture.
pub const RANK_STEPS: [u32; 2] = [3_242_174_889, 2_447_445_414];

fn rank([column, row]: [u32; 2]) -> u32 {
    let [x, y] = RANK_STEPS;
    column.wrapping_mul(x).wrapping_add(row.wrapping_mul(y))
}

/// Samples that are taken of a frame, about: far more than the light has unknowns, yet with 600 the first
/// frames of one light in 24 had it on the wrong side of the room. With more bands as many as 64 KiB hold, packed.
pub fn samples_per_frame(bands: usize) -> usize {
    match bands {
        ..=4 => 1000,
        5 => 768,
        _ => 610,
    }
}

/// An even spread keeps the number within a few of [`samples_per_frame`]. Usable pixels in the very pattern of the
/// ranks could bring more: what is beyond this is left out.
pub fn most_samples(bands: usize) -> usize {
    samples_per_frame(bands) + samples_per_frame(bands) / 25
}

/// The highest rank of a sample where so many points are usable.
fn last_rank(usable: usize, bands: usize) -> u32 {
    let wanted = samples_per_frame(bands);
    match usable <= wanted {
        true => u32::MAX,
        // the quotient is below 2^32, since more than the divisor is usable
        false => (((wanted as u64) << 32) / usable as u64) as u32,
    }
}

/// Pixels by what became of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    pub used: usize,
    pub no_surface: usize,
    pub grazing: usize,
    pub dark: usize,
    pub saturated: usize,
}

/// One frame as the estimator sees it. `frame` and `surface` have one size, and `transfer` belongs to
/// `surface`.
#[derive(Clone, Copy)]
pub struct Seen<'a> {
    pub frame: &'a RgbdFrame,
    pub surface: &'a GBuffer,
    pub transfer: &'a TransferMap,
}

/// Grid points that can be used, in strips of rows.
#[derive(Clone, Debug, Default)]
pub struct Samples {
    strips: Vec<Strip>,
    /// Grid points from one that is looked at to the next.
    every: usize,
}

#[derive(Clone, Debug, Default)]
struct Strip {
    points: Vec<[u32; 2]>,
    counts: Counts,
}

impl Samples {
    /// Looks at every `stride`-th pixel.
    pub fn find(&mut self, seen: &Seen, params: &LightParams) -> Counts {
        let size = seen.surface.size();
        assert_eq!(seen.frame.color.size(), size, "colour and surface of one frame");
        assert_eq!(seen.frame.color_srgb.size(), size, "colour and surface of one frame");
        let grid = seen.transfer.grid;
        let every = params.stride.div_ceil(seen.transfer.step.max(1)).max(1);
        self.every = every;
        let rows = grid.height.div_ceil(every);
        self.strips.resize_with(rows.div_ceil(ROWS_PER_STRIP), Strip::default);
        let judge = Judge::new(seen, params);
        self.strips.par_iter_mut().enumerate().for_each(|(s, strip)| {
            strip.points.clear();
            strip.counts = Counts::default();
            for row in s * ROWS_PER_STRIP..((s + 1) * ROWS_PER_STRIP).min(rows) {
                for i in (0..grid.width).step_by(every) {
                    if judge.accepts(i, row * every, &mut strip.counts) {
                        strip.points.push([i as u32, (row * every) as u32]);
                    }
                }
            }
        });
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

    /// Puts about [`samples_per_frame`] of the points found into `out`, in the order of the picture.
    ///
    /// Each point has a rank of its own, so that a pixel more or less that is usable changes a sample and not
    /// all those after it, and where nothing moves the light does not either.
    pub fn pick(&self, seen: &Seen, hidden_radiance: f32, out: &mut Batch) {
        let all: usize = self.strips.iter().map(|s| s.points.len()).sum();
        let bands = seen.transfer.bands;
        let last = last_rank(all, bands);
        let every = self.every as u32;
        let world_from_view = seen.surface.view.world_from_view_f32();
        let points = self.strips.iter().flat_map(|s| &s.points);
        let picked = points.filter(|[i, j]| rank([i / every, j / every]) <= last);
        for &[i, j] in picked.take(most_samples(bands)) {
            let (i, j) = (i as usize, j as usize);
            let (x, y) = seen.transfer.pixel(i, j, seen.surface.size());
            let depth = seen.surface.depth_m[(x, y)];
            let point = seen.surface.view.unproject(Vec2::new(x as f32, y as f32), depth);
            out.push(&Sample {
                transfer: seen.transfer.at(i, j),
                position: world_from_view.transform_point3(point),
                normal: seen.surface.normals.at(x, y),
                rgb: seen.frame.color[(x, y)],
            });
        }
        out.take_indirect_light(hidden_radiance);
    }
}

struct Judge<'a> {
    seen: &'a Seen<'a>,
    brightest: f32,
    darkest: f32,
    min_cosine: f32,
    model_only: bool,
    world_from_view: Affine3A,
}

impl<'a> Judge<'a> {
    fn new(seen: &'a Seen<'a>, params: &LightParams) -> Self {
        Self {
            seen,
            brightest: params.max_encoded * 255.0,
            darkest: params.min_encoded * 255.0,
            min_cosine: params.min_cosine,
            model_only: params.model_only,
            world_from_view: seen.surface.view.world_from_view_f32(),
        }
    }

    /// Whether a grid point tells something; counts it either way.
    fn accepts(&self, i: usize, j: usize, counts: &mut Counts) -> bool {
        let Seen { frame, surface, transfer } = self.seen;
        let (x, y) = transfer.pixel(i, j, surface.size());
        if !self.has_surface(x, y, transfer.at(i, j)) {
            counts.no_surface += 1;
            return false;
        }
        let [r, g, b] = frame.color_srgb[(x, y)];
        let brightest = f32::from(r.max(g).max(b));
        let seen = luminance(frame.color[(x, y)]);
        if brightest > self.brightest {
            counts.saturated += 1;
        } else if brightest < self.darkest || !seen.is_finite() {
            counts.dark += 1;
        } else if self.cosine_to_eye(x, y) < self.min_cosine {
            counts.grazing += 1;
        } else {
            counts.used += 1;
            return true;
        }
        false
    }

    fn has_surface(&self, x: usize, y: usize, row: &[f32]) -> bool {
        let surface = self.seen.surface;
        let depth = surface.depth_m[(x, y)];
        let real = match surface.origin[(x, y)] {
            Origin::Model => true,
            Origin::Sensor => !self.model_only,
            Origin::None | Origin::Virtual => false,
        };
        let energy: f32 = row.iter().map(|t| t * t).sum();
        real && depth > 0.0 && depth.is_finite() && energy > 0.0 && energy.is_finite()
    }

    /// -1 where there is no normal.
    fn cosine_to_eye(&self, x: usize, y: usize) -> f32 {
        let surface = self.seen.surface;
        let towards_eye: Vec3 = self
            .world_from_view
            .transform_vector3(surface.view.towards_eye(Vec2::new(x as f32, y as f32)));
        let cosine = surface.normals.at(x, y).dot(towards_eye);
        if cosine.is_finite() { cosine } else { -1.0 }
    }
}
