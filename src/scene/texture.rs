//! Base-colour textures: sRGB texels in a pyramid, read as linear light.

use crate::math::color::{LINEAR_FROM_SRGB8, srgb8_from_linear};
use glam::{Vec2, Vec4};

/// Along the longer axis of a pixel's footprint; more slanted views blur across the shorter one.
pub const MAX_TAPS: usize = 8;

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

    /// Width, height and texels (8-bit sRGB and linear alpha) of each level, the finest first.
    #[cfg(feature = "gpu")]
    pub(crate) fn levels(&self) -> impl Iterator<Item = (usize, usize, &[[u8; 4]])> + Clone {
        self.levels.iter().map(|level| (level.width, level.height, &level.texels[..]))
    }

    /// Along u and v.
    #[cfg(feature = "gpu")]
    pub(crate) fn wrap(&self) -> [Wrap; 2] {
        self.wrap
    }

    /// Linear RGB and alpha around `uv`, the mean over what a pixel shows. `du` and `dv` are the steps
    /// of `uv` to the next pixel in x and y.
    pub fn sample(&self, uv: Vec2, du: Vec2, dv: Vec2) -> [f32; 4] {
        let base = &self.levels[0];
        let texels = Vec2::new(base.width as f32, base.height as f32);
        let Some(footprint) = Footprint::new(du * texels, dv * texels) else {
            return self.levels[self.levels.len() - 1].bilinear(uv, self.wrap);
        };
        let taps = footprint.taps as f32;
        let step = footprint.long_axis / (texels * taps);
        let first = uv - step * (0.5 * (taps - 1.0));
        let mean = |level: &Level| {
            let mut sum = Vec4::ZERO;
            for tap in 0..footprint.taps {
                sum += Vec4::from(level.bilinear(first + step * tap as f32, self.wrap));
            }
            sum / taps
        };
        let lod = footprint.tap_width.log2().min((self.levels.len() - 1) as f32);
        let fine = lod as usize;
        let t = lod - fine as f32;
        let a = mean(&self.levels[fine]);
        if t < 1.0 / 256.0 {
            return a.to_array(); // less than one step of an 8-bit texel
        }
        a.lerp(mean(&self.levels[fine + 1]), t).to_array()
    }
}

/// What a pixel shows of a texture: the ellipse that a disc as wide as the pixel comes from, covered by
/// a row of round taps along its long axis (Heckbert 1989, section 3.5; McCormack et al. 1999). A filter
/// that is round itself and as wide as the long axis would blur the texture along the short one.
struct Footprint {
    /// Of the ellipse's full length, texels.
    long_axis: Vec2,
    taps: usize,
    /// At least one texel; as wide as the ellipse, unless it is longer than [`MAX_TAPS`] widths.
    tap_width: f32,
}

impl Footprint {
    /// From the steps in texels to the next pixel in x and y. `None` where they are not finite: seen
    /// edge-on.
    fn new(du: Vec2, dv: Vec2) -> Option<Self> {
        // The axes are the singular vectors of the matrix [du dv]; neither column need be near one.
        let (xx, yy) = (du.x * du.x + dv.x * dv.x, du.y * du.y + dv.y * dv.y);
        let xy = du.x * du.y + dv.x * dv.y;
        let (middle, half) = (0.5 * (xx + yy), 0.5 * (xx - yy));
        let spread = half.hypot(xy);
        let length = (middle + spread).sqrt();
        if !length.is_finite() {
            return None;
        }
        let width = if length > 0.0 { du.perp_dot(dv).abs() / length } else { 0.0 };
        // Of two parallel forms the one whose sum does not cancel; a circle has no long axis.
        let direction =
            if half >= 0.0 { Vec2::new(half + spread, xy) } else { Vec2::new(xy, spread - half) };
        let tap_width = width.max(length / MAX_TAPS as f32).max(1.0);
        // Taps overlap by half, so a quarter of a width more between them leaves no gap.
        let taps = (length / tap_width - 0.25).ceil().clamp(1.0, MAX_TAPS as f32) as usize;
        Some(Self { long_axis: direction.normalize_or_zero() * length, taps, tap_width })
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

/// `i` is at most one texel outside of the period that [`taps`] has reduced the coordinate to.
fn wrapped(i: i64, n: usize, wrap: Wrap) -> usize {
    let n = n as i64;
    let fold = |period: i64| match i {
        i if i < 0 => i + period,
        i if i >= period => i - period,
        i => i,
    };
    let index = match wrap {
        Wrap::Repeat => fold(n),
        Wrap::MirroredRepeat => fold(2 * n).min(2 * n - 1 - fold(2 * n)),
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

    #[test]
    fn footprints_follow_the_singular_vectors() {
        // A circle and its texture stretched 12 by 2, then turned in the texture and on the screen.
        for (texture_turn, screen_turn) in [(0.0, 0.0), (0.0, 0.785), (0.4, 0.0), (2.1, -1.3)] {
            let turn = Vec2::from_angle(texture_turn);
            let step = |angle: f32| {
                let p = Vec2::from_angle(angle + screen_turn);
                turn.rotate(Vec2::new(12.0 * p.x, 2.0 * p.y))
            };
            let footprint = Footprint::new(step(0.0), step(std::f32::consts::FRAC_PI_2)).unwrap();
            assert!((footprint.long_axis.perp_dot(turn)).abs() < 1e-4, "{}", footprint.long_axis);
            assert!((footprint.long_axis.length() - 12.0).abs() < 1e-4);
            assert!((footprint.tap_width - 2.0).abs() < 1e-4 && footprint.taps == 6);
        }
        let round = |r: f32| Footprint::new(Vec2::X * r, Vec2::Y * r).unwrap();
        assert_eq!([0.0, 0.3, 1.0, 5.0].map(|r| round(r).taps), [1; 4]);
        assert_eq!([0.0, 0.3, 1.0, 5.0].map(|r| round(r).tap_width), [1.0, 1.0, 1.0, 5.0]);
        let line = Footprint::new(Vec2::X * 80.0, Vec2::X * 60.0).unwrap();
        assert_eq!((line.taps, line.tap_width), (8, 12.5));
        for bad in [f32::NAN, f32::INFINITY, 1e30] {
            assert!(Footprint::new(Vec2::splat(bad), Vec2::Y).is_none());
        }
    }
}
