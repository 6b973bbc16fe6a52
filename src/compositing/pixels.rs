//! From full-resolution shading to display pixels.

use super::encode::{SrgbEncoder, soften};
use super::grid::{Lamp, Layout, VirtualShading};
use super::planes::{LANES, Planes};
use super::stage::ComposeInput;
use super::{CompositingParams, Compositor};
use crate::geometry::Origin;
use crate::image::Image;
use glam::Vec3;

/// Virtual objects take direct light away and never add any: where R' exceeds R, that is ringing of the
/// spherical harmonics or noise. What they add is the bounce.
pub const MAX_RATIO: f32 = 1.0;

/// Everything that the pixels of one frame are made from.
pub struct Composer<'a> {
    pub input: &'a ComposeInput<'a>,
    pub params: &'a CompositingParams,
    pub lamp: &'a Lamp,
    pub layout: Layout,
    pub shading: &'a Planes,
    pub virtual_shading: VirtualShading,
    /// Scales R to the tone mapper's key.
    pub exposure: f32,
    pub encoder: &'static SrgbEncoder,
    pub decoder: &'static [f32; 256],
}

/// What the scene with virtual objects does to a real pixel.
#[derive(Clone, Copy, Debug, Default)]
struct Change {
    gain: [f32; 3],
    bounce: [f32; 3],
    /// R, which albedo is told from.
    real: [f32; 3],
}

/// Shading of one row: R, R' and the bounce for each colour channel.
#[derive(Clone, Copy)]
struct Rows<'a> {
    origin: &'a [Origin],
    coverage: &'a [f32],
    real: [&'a [f32]; 3],
    merged: [&'a [f32]; 3],
    bounce: Option<[&'a [f32]; 3]>,
}

impl<'a> Rows<'a> {
    fn new(composer: &Composer<'a>, y: usize) -> Self {
        let (layout, shading) = (composer.layout, composer.shading);
        Self {
            origin: composer.input.merged.origin.row(y),
            coverage: composer.input.layer.coverage.row(y),
            real: [0, 1, 2].map(|c| shading.row(layout.real(c), y)),
            merged: [0, 1, 2].map(|c| shading.row(layout.merged(c), y)),
            bounce: layout.bounce.then(|| [0, 1, 2].map(|c| shading.row(layout.bounce(c), y))),
        }
    }

    #[inline(always)]
    fn bounce(&self, c: usize, x: usize) -> f32 {
        self.bounce.map_or(0.0, |rows| rows[c][x])
    }

    /// Nothing virtual covers or influences these pixels.
    #[inline(always)]
    fn quiet(&self, x: std::ops::Range<usize>, channels: usize) -> bool {
        let mut loud = false;
        for origin in &self.origin[x.clone()] {
            loud |= *origin == Origin::Virtual;
        }
        for &coverage in &self.coverage[x.clone()] {
            loud |= coverage > 0.0;
        }
        for c in 0..channels {
            let pairs = self.real[c][x.clone()].iter().zip(&self.merged[c][x.clone()]);
            for (real, merged) in pairs {
                loud |= real != merged;
            }
        }
        if let Some(rows) = &self.bounce {
            for row in rows {
                for &bounce in &row[x.clone()] {
                    loud |= bounce != 0.0;
                }
            }
        }
        !loud
    }
}

impl Composer<'_> {
    /// Linear light of the virtual pixels of a row; others are left as they are.
    pub fn virtual_row(&self, y: usize, out: &mut [[f32; 3]]) {
        let rows = Rows::new(self, y);
        let albedo = self.input.layer.albedo.row(y);
        for x in 0..out.len() {
            if rows.origin[x] == Origin::Virtual {
                out[x] = soften(self.virtual_radiance(&rows, x, y, albedo[x]));
            }
        }
    }

    /// albedo (R' / mean albedo + R_i): the light is known times the mean albedo.
    fn virtual_radiance(&self, rows: &Rows, x: usize, y: usize, albedo: [f32; 3]) -> [f32; 3] {
        let merged = self.shading_of(rows, x, y);
        let mut out = [0.0; 3];
        for c in 0..3 {
            let light = merged[c] / self.input.mean_albedo + rows.bounce(c, x);
            out[c] = (albedo[c] * light).clamp(0.0, f32::MAX);
        }
        out
    }

    /// R' of a pixel, virtual or real.
    pub fn merged_shading(&self, x: usize, y: usize) -> [f32; 3] {
        self.shading_of(&Rows::new(self, y), x, y)
    }

    #[inline(always)]
    fn shading_of(&self, rows: &Rows, x: usize, y: usize) -> [f32; 3] {
        let mut out = [rows.merged[0][x], rows.merged[1][x], rows.merged[2][x]];
        let visibility = self.virtual_shading == VirtualShading::Visibility;
        if visibility && rows.origin[x] == Origin::Virtual {
            let n = &self.input.merged.normals;
            let normal = Vec3::new(n.x.row(y)[x], n.y.row(y)[x], n.z.row(y)[x]);
            let unoccluded = self.lamp.unoccluded(normal);
            for c in 0..3 {
                out[c] = self.lamp.shading(out[c], unoccluded[c.min(self.layout.channels - 1)]);
            }
        }
        out
    }

    /// Display pixels of a row. `virtual_light` holds what [`Self::virtual_row`] wrote.
    pub fn row(&self, y: usize, virtual_light: &Image<[f32; 3]>, out: &mut [[u8; 3]]) {
        out.copy_from_slice(self.input.frame.color_srgb.row(y));
        let rows = Rows::new(self, y);
        for start in (0..out.len()).step_by(LANES) {
            let block = start..(start + LANES).min(out.len());
            if rows.quiet(block.clone(), self.layout.channels) {
                continue;
            }
            for x in block {
                let single = x..x + 1;
                if !rows.quiet(single, self.layout.channels) {
                    out[x] = self.pixel(&rows, x, y, virtual_light, out[x]);
                }
            }
        }
    }

    /// A pixel that virtual objects cover or influence.
    #[inline(always)]
    fn pixel(
        &self,
        rows: &Rows,
        x: usize,
        y: usize,
        virtual_light: &Image<[f32; 3]>,
        camera: [u8; 3],
    ) -> [u8; 3] {
        let decode = |code: u8| self.decoder[usize::from(code)];
        let linear = [decode(camera[0]), decode(camera[1]), decode(camera[2])];
        let covered = self.covered(rows, x);
        let light = if covered > 0.0 { self.virtual_light_at(x, y, virtual_light) } else { None };
        // An edge pixel without a virtual neighbour shows nothing virtual.
        let covered = if light.is_some() { covered } else { 0.0 };
        let light = light.unwrap_or_default();
        let real = if covered < 1.0 { self.real_light(rows, x, y, linear) } else { linear };
        let mut out = [0; 3];
        for c in 0..3 {
            out[c] = self.encoder.encode(real[c] + covered * (light[c] - real[c]));
        }
        out
    }

    /// Share of the pixel that virtual objects cover.
    #[inline(always)]
    fn covered(&self, rows: &Rows, x: usize) -> f32 {
        if self.params.antialias {
            rows.coverage[x].clamp(0.0, 1.0)
        } else if rows.origin[x] == Origin::Virtual {
            1.0
        } else {
            0.0
        }
    }

    /// The virtual light of a virtual pixel, or the mean of its virtual neighbours.
    fn virtual_light_at(&self, x: usize, y: usize, light: &Image<[f32; 3]>) -> Option<[f32; 3]> {
        if self.input.merged.origin.row(y)[x] == Origin::Virtual {
            return Some(light.row(y)[x]);
        }
        let mut sum = [0.0; 3];
        let mut count = 0.0;
        self.neighbours(x, y, |x, y| {
            if self.input.merged.origin.row(y)[x] == Origin::Virtual {
                for (sum, value) in sum.iter_mut().zip(light.row(y)[x]) {
                    *sum += value;
                }
                count += 1.0;
            }
        });
        (count > 0.0).then(|| sum.map(|v| v / count))
    }

    /// The camera's light as virtual objects change it. Behind a virtual edge pixel, the change is
    /// the mean of those of the real pixels beside it.
    fn real_light(&self, rows: &Rows, x: usize, y: usize, camera: [f32; 3]) -> [f32; 3] {
        if rows.origin[x] != Origin::Virtual {
            return self.apply(self.change(rows, x), camera);
        }
        let mut sum = Change::default();
        let mut count = 0.0;
        self.neighbours(x, y, |x, y| {
            let rows = Rows::new(self, y);
            if rows.origin[x] != Origin::Virtual {
                let change = self.change(&rows, x);
                for c in 0..3 {
                    sum.gain[c] += change.gain[c];
                    sum.bounce[c] += change.bounce[c];
                    sum.real[c] += change.real[c];
                }
                count += 1.0;
            }
        });
        if count == 0.0 {
            return camera;
        }
        let mean = Change {
            gain: sum.gain.map(|v| v / count),
            bounce: sum.bounce.map(|v| v / count),
            real: sum.real.map(|v| v / count),
        };
        self.apply(mean, camera)
    }

    #[inline(always)]
    fn change(&self, rows: &Rows, x: usize) -> Change {
        let mut change = Change::default();
        for c in 0..3 {
            // Bicubic weights may undershoot the floor that the grid keeps.
            let real = rows.real[c][x].max(self.lamp.floor);
            let merged = rows.merged[c][x].max(self.lamp.floor);
            change.real[c] = real;
            change.bounce[c] = rows.bounce(c, x);
            change.gain[c] = match self.params.compositor {
                Compositor::Ratio => (merged / real).min(MAX_RATIO),
                Compositor::Difference => (1.0 + self.tone(merged) - self.tone(real)).max(0.0),
            };
        }
        change
    }

    /// Reinhard's x / (1 + x) with the exposure of R for both terms, so that R' = R is no change.
    fn tone(&self, shading: f32) -> f32 {
        let scaled = shading * self.exposure;
        scaled / (1.0 + scaled)
    }

    /// gain I + A R_i, with the pixel's albedo A from I = A R / mean albedo.
    #[inline(always)]
    fn apply(&self, change: Change, camera: [f32; 3]) -> [f32; 3] {
        let mut out = [0.0; 3];
        for c in 0..3 {
            let albedo = (self.input.mean_albedo * camera[c] / change.real[c]).clamp(0.0, 1.0);
            out[c] = camera[c] * change.gain[c] + albedo * change.bounce[c];
        }
        out
    }

    /// The up to eight pixels around.
    fn neighbours(&self, x: usize, y: usize, mut visit: impl FnMut(usize, usize)) {
        let size = self.input.merged.size();
        for row in y.saturating_sub(1)..(y + 2).min(size.height) {
            for column in x.saturating_sub(1)..(x + 2).min(size.width) {
                if (column, row) != (x, y) {
                    visit(column, row);
                }
            }
        }
    }
}
