//! Base-colour textures: sRGB texels in a pyramid, read as linear light.

use crate::math::color::{LINEAR_FROM_SRGB8, srgb8_from_linear};
use glam::Vec2;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wrap {
    #[default]
    Repeat,
    MirroredRepeat,
    ClampToEdge,
}

/// A picture and its halvings down to one texel. u goes right, v goes *down* from the first row.
#[derive(Clone, Debug)]
pub struct Texture {
    levels: Vec<Level>,
    wrap: [Wrap; 2],
}

#[derive(Clone, Debug)]
struct Level {
    width: usize,
    height: usize,
    /// 8-bit sRGB and linear alpha.
    texels: Vec<[u8; 4]>,
}

impl Texture {
    /// Builds the pyramid of an sRGB picture; `None` where `texels` is empty or does not fit the size.
    pub fn new(width: usize, height: usize, texels: Vec<[u8; 4]>, wrap: [Wrap; 2]) -> Option<Self> {
        if texels.is_empty() || width.checked_mul(height) != Some(texels.len()) {
            return None;
        }
        let mut levels = vec![Level { width, height, texels }];
        while let Some(next) = levels.last().and_then(Level::halved) {
            levels.push(next);
        }
        Some(Self { levels, wrap })
    }

    /// Linear RGB and alpha around `uv`. `du` and `dv` are the steps of `uv` to the next pixel in x
    /// and y: the level is chosen so that the longer one is about a texel (trilinear filter).
    pub fn sample(&self, uv: Vec2, du: Vec2, dv: Vec2) -> [f32; 4] {
        let base = &self.levels[0];
        let texels = Vec2::new(base.width as f32, base.height as f32);
        let footprint = (du * texels).length_squared().max((dv * texels).length_squared());
        let top = (self.levels.len() - 1) as f32;
        // max first: a NaN footprint reads the finest level
        let lod = (0.5 * footprint.log2()).max(0.0).min(top);
        let fine = lod as usize;
        let t = lod - fine as f32;
        let a = self.levels[fine].bilinear(uv, self.wrap);
        if t < 1.0 / 256.0 {
            return a; // less than one step of an 8-bit texel
        }
        let b = self.levels[fine + 1].bilinear(uv, self.wrap);
        std::array::from_fn(|c| a[c] + t * (b[c] - a[c]))
    }
}

impl Level {
    /// Means of 2x2 texels in linear light; the last row or column of an odd size is repeated.
    fn halved(&self) -> Option<Self> {
        if self.texels.len() == 1 {
            return None;
        }
        let linear = &*LINEAR_FROM_SRGB8;
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mut texels = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                let (x1, y1) = ((2 * x + 1).min(self.width - 1), (2 * y + 1).min(self.height - 1));
                let block = [(2 * x, 2 * y), (x1, 2 * y), (2 * x, y1), (x1, y1)]
                    .map(|(x, y)| self.texels[y * self.width + x]);
                let mean =
                    |c: usize| 0.25 * block.iter().map(|t| linear[usize::from(t[c])]).sum::<f32>();
                let alpha = block.iter().map(|t| u32::from(t[3])).sum::<u32>();
                let rgb = [0, 1, 2].map(|c| srgb8_from_linear(mean(c)));
                texels.push([rgb[0], rgb[1], rgb[2], ((alpha + 2) / 4) as u8]);
            }
        }
        Some(Self { width, height, texels })
    }

    fn bilinear(&self, uv: Vec2, wrap: [Wrap; 2]) -> [f32; 4] {
        let (x0, x1, tx) = taps(uv.x, self.width, wrap[0]);
        let (y0, y1, ty) = taps(uv.y, self.height, wrap[1]);
        let (row0, row1) = (y0 * self.width, y1 * self.width);
        let corners = [row0 + x0, row0 + x1, row1 + x0, row1 + x1].map(|i| self.texels[i]);
        let weights = [(1.0 - tx) * (1.0 - ty), tx * (1.0 - ty), (1.0 - tx) * ty, tx * ty];
        let linear = &*LINEAR_FROM_SRGB8;
        let mut out = [0.0; 4];
        for (texel, weight) in corners.iter().zip(weights) {
            for c in 0..3 {
                out[c] += weight * linear[usize::from(texel[c])];
            }
            out[3] += weight * f32::from(texel[3]) * (1.0 / 255.0);
        }
        out
    }
}

/// The two texels around a coordinate and the weight of the second. Texel centres are at (i + 1/2) / n.
fn taps(coordinate: f32, n: usize, wrap: Wrap) -> (usize, usize, f32) {
    // One period first, so that far coordinates keep their precision in the cast; NaN becomes 0.
    let periodic = match wrap {
        Wrap::Repeat => coordinate - coordinate.floor(),
        Wrap::MirroredRepeat => coordinate - 2.0 * (0.5 * coordinate).floor(),
        Wrap::ClampToEdge => coordinate.clamp(0.0, 1.0),
    };
    let x = periodic * n as f32 - 0.5;
    let first = x.floor();
    let t = if x.is_finite() { x - first } else { 0.0 };
    let first = first as i64;
    (wrapped(first, n, wrap), wrapped(first + 1, n, wrap), t)
}

fn wrapped(i: i64, n: usize, wrap: Wrap) -> usize {
    let n = n as i64;
    let index = match wrap {
        Wrap::Repeat => i.rem_euclid(n),
        Wrap::MirroredRepeat => {
            let i = i.rem_euclid(2 * n);
            i.min(2 * n - 1 - i)
        }
        Wrap::ClampToEdge => i.clamp(0, n - 1),
    };
    index as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    const BLACK: [u8; 4] = [0, 0, 0, 255];
    const WHITE: [u8; 4] = [255, 255, 255, 255];

    fn red(texture: &Texture, u: f32, v: f32) -> f32 {
        texture.sample(Vec2::new(u, v), Vec2::ZERO, Vec2::ZERO)[0]
    }

    #[test]
    fn wrap_modes_outside_the_picture() {
        let make = |wrap| Texture::new(4, 1, vec![BLACK, BLACK, WHITE, WHITE], [wrap; 2]).unwrap();
        let (repeat, mirror, clamp) =
            (make(Wrap::Repeat), make(Wrap::MirroredRepeat), make(Wrap::ClampToEdge));
        // u = 1.125 and -0.125 are texel centres one step outside
        assert_eq!([red(&repeat, 1.125, 0.5), red(&repeat, -0.125, 0.5)], [0.0, 1.0]);
        assert_eq!([red(&mirror, 1.125, 0.5), red(&mirror, -0.125, 0.5)], [1.0, 0.0]);
        assert_eq!([red(&clamp, 1.125, 0.5), red(&clamp, -0.125, 0.5)], [1.0, 0.0]);
        assert_eq!(red(&repeat, 0.5, 0.5), 0.5, "half-way between black and white, linear light");
        assert_eq!(red(&repeat, 0.0, 0.5), 0.5, "across the seam");
        assert_eq!(red(&clamp, 0.0, 0.5), 0.0);
        for wrap in [Wrap::Repeat, Wrap::MirroredRepeat, Wrap::ClampToEdge] {
            for bad in [f32::NAN, f32::INFINITY, -1e30, 1e30] {
                assert!(red(&make(wrap), bad, bad).is_finite());
            }
        }
    }

    #[test]
    fn a_wide_footprint_reads_the_mean_in_linear_light() {
        let checker: Vec<_> =
            (0..64).map(|i| if (i + i / 8) % 2 == 0 { BLACK } else { WHITE }).collect();
        let texture = Texture::new(8, 8, checker, [Wrap::Repeat; 2]).unwrap();
        let wide = Vec2::new(1.0, 0.0);
        let value = texture.sample(Vec2::new(0.3, 0.7), wide, wide.perp())[0];
        // 8-bit sRGB steps near one half are 0.0078 of linear light apart
        assert!((value - 0.5).abs() < 0.004, "{value}");
        assert!(Texture::new(3, 3, vec![BLACK; 8], [Wrap::Repeat; 2]).is_none());
        assert!(Texture::new(0, 3, vec![], [Wrap::Repeat; 2]).is_none());
        assert_eq!(
            Texture::new(67, 43, vec![WHITE; 67 * 43], Default::default()).unwrap().levels.len(),
            8
        );
    }
}
