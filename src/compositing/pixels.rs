//! From full-resolution shading to display pixels.

use super::encode::{SRGB, soften};
use super::grid::{Lamp, Layout, VirtualShading};
use super::planes::Planes;
use super::stage::ComposeInput;
use super::{CompositingParams, Compositor};
use crate::geometry::Origin;
use crate::image::Image;
use crate::math::color::LINEAR_FROM_SRGB8;

/// R'/R above this is noise on the dark side.
const MAX_RATIO: f32 = 8.0;

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
}

/// What the scene with virtual objects does to a real pixel: linear value = gain * I + added.
#[derive(Clone, Copy, Debug, Default)]
struct Change {
    gain: [f32; 3],
    /// Bounce, and the shading R that albedo is told from.
    bounce: [f32; 3],
    real: [f32; 3],
}

impl Composer<'_> {
    /// Linear light of the virtual pixels of a row; others are left as they are.
    pub fn virtual_row(&self, y: usize, out: &mut [[f32; 3]]) {
        let origin = self.input.merged.origin.row(y);
        let albedo = self.input.layer.albedo.row(y);
        for x in 0..out.len() {
            if origin[x] == Origin::Virtual {
                out[x] = soften(self.virtual_radiance(x, y, albedo[x]));
            }
        }
    }

    /// albedo (R' / mean albedo + R_i): the light is known times the mean albedo.
    fn virtual_radiance(&self, x: usize, y: usize, albedo: [f32; 3]) -> [f32; 3] {
        let merged = self.merged_shading(x, y);
        std::array::from_fn(|c| {
            let light = merged[c] / self.input.mean_albedo + self.bounce(c, x, y);
            (albedo[c] * light).clamp(0.0, f32::MAX)
        })
    }

    /// R' of a pixel, virtual or real.
    pub fn merged_shading(&self, x: usize, y: usize) -> [f32; 3] {
        let value = |c| self.shading.at(self.layout.merged(c), x, y);
        let visibility = self.virtual_shading == VirtualShading::Visibility
            && self.input.merged.origin.row(y)[x] == Origin::Virtual;
        if visibility {
            let unoccluded = self.lamp.unoccluded(self.input.merged.normals.at(x, y));
            std::array::from_fn(|c| {
                self.lamp.shading(value(c), unoccluded[c.min(self.layout.channels - 1)])
            })
        } else {
            std::array::from_fn(value)
        }
    }

    fn bounce(&self, c: usize, x: usize, y: usize) -> f32 {
        if self.layout.bounce { self.shading.at(self.layout.bounce(c), x, y) } else { 0.0 }
    }

    /// Display pixels of a row. `virtual_light` holds what [`Self::virtual_row`] wrote.
    pub fn row(&self, y: usize, virtual_light: &Image<[f32; 3]>, out: &mut [[u8; 3]]) {
        out.copy_from_slice(self.input.frame.color_srgb.row(y));
        for x in 0..out.len() {
            let covered = self.covered(x, y);
            if covered <= 0.0 && self.unchanged(x, y) {
                continue;
            }
            let camera = out[x].map(|code| LINEAR_FROM_SRGB8[usize::from(code)]);
            let real = if covered < 1.0 { self.real_light(x, y, camera) } else { camera };
            let mixed = match self.virtual_light_at(x, y, virtual_light) {
                Some(light) if covered > 0.0 => {
                    std::array::from_fn(|c| real[c] + covered * (light[c] - real[c]))
                }
                _ if covered > 0.0 && self.unchanged(x, y) => continue,
                _ => real,
            };
            out[x] = mixed.map(|v: f32| SRGB.encode(v));
        }
    }

    /// Share of the pixel that virtual objects cover.
    fn covered(&self, x: usize, y: usize) -> f32 {
        if self.params.antialias {
            self.input.layer.coverage.row(y)[x].clamp(0.0, 1.0)
        } else if self.input.merged.origin.row(y)[x] == Origin::Virtual {
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
                let value = light.row(y)[x];
                sum = std::array::from_fn(|c| sum[c] + value[c]);
                count += 1.0;
            }
        });
        (count > 0.0).then(|| sum.map(|v| v / count))
    }

    /// The camera's light as virtual objects change it. Behind a virtual edge pixel, the change is
    /// that of the real pixels beside it.
    fn real_light(&self, x: usize, y: usize, camera: [f32; 3]) -> [f32; 3] {
        if self.input.merged.origin.row(y)[x] != Origin::Virtual {
            return self.apply(self.change(x, y), camera);
        }
        let mut sum = Change::default();
        let mut count = 0.0;
        self.neighbours(x, y, |x, y| {
            if self.input.merged.origin.row(y)[x] != Origin::Virtual {
                let change = self.change(x, y);
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

    fn change(&self, x: usize, y: usize) -> Change {
        // Bicubic weights may undershoot the floor that the grid keeps.
        let at = |plane| self.shading.at(plane, x, y).max(self.lamp.floor);
        let real: [f32; 3] = std::array::from_fn(|c| at(self.layout.real(c)));
        let merged: [f32; 3] = std::array::from_fn(|c| at(self.layout.merged(c)));
        let gain = std::array::from_fn(|c| match self.params.compositor {
            Compositor::Ratio => (merged[c] / real[c]).clamp(0.0, MAX_RATIO),
            Compositor::Difference => (1.0 + self.tone(merged[c]) - self.tone(real[c])).max(0.0),
        });
        Change { gain, bounce: std::array::from_fn(|c| self.bounce(c, x, y)), real }
    }

    /// Reinhard's x / (1 + x) with the exposure of R for both terms, so that R' = R is no change.
    fn tone(&self, shading: f32) -> f32 {
        let scaled = shading * self.exposure;
        scaled / (1.0 + scaled)
    }

    /// gain I + A R_i, with the pixel's albedo A from I = A R / mean albedo.
    fn apply(&self, change: Change, camera: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|c| {
            let albedo = self.input.mean_albedo * camera[c] / change.real[c];
            camera[c] * change.gain[c] + albedo.clamp(0.0, 1.0) * change.bounce[c]
        })
    }

    #[inline(always)]
    fn unchanged(&self, x: usize, y: usize) -> bool {
        self.input.merged.origin.row(y)[x] != Origin::Virtual
            && (0..self.layout.channels).all(|c| {
                self.shading.at(self.layout.real(c), x, y)
                    == self.shading.at(self.layout.merged(c), x, y)
            })
            && (!self.layout.bounce || (0..3).all(|c| self.bounce(c, x, y) == 0.0))
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
