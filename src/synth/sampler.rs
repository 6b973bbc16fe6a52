//! Well-spread sample points: Owen-scrambled Sobol pairs, shuffled apart for every use on a path
//! (Burley, "Practical Hash-based Owen Scrambling", 2020).

use crate::math::random::{Rng, hash, unit_f32};
use glam::Vec2;

/// Sample `index` of one pixel of one frame.
#[derive(Clone, Debug)]
pub struct Sampler {
    seed: u32,
    index: u32,
    dimension: u32,
    rng: Rng,
}

impl Sampler {
    /// `words` name the pixel (seed, frame, x, y).
    pub fn new(words: &[u32], index: u32) -> Self {
        let seed = words.iter().fold(0x51ed_270b, |s, &w| hash(s ^ w));
        Self { seed, index, dimension: 0, rng: Rng::new(&[seed, index]) }
    }

    /// The next pair in [0, 1)^2: over a pixel's samples, every pair is a (0, 2)-sequence.
    pub fn pair(&mut self) -> Vec2 {
        self.dimension += 1;
        let seed = hash(self.seed ^ self.dimension.wrapping_mul(0x9e37_79b9));
        let index = owen_scramble(self.index, seed);
        let x = owen_scramble(index.reverse_bits(), hash(seed ^ 1));
        let y = owen_scramble(sobol_second(index), hash(seed ^ 2));
        Vec2::new(unit_f32(x), unit_f32(y))
    }

    /// An independent number in [0, 1).
    pub fn single(&mut self) -> f32 {
        self.rng.uniform()
    }
}

/// Second dimension of the Sobol sequence: the index times Pascal's triangle modulo 2, whose
/// factors are five masked shifts.
fn sobol_second(index: u32) -> u32 {
    let mut x = index.reverse_bits();
    x ^= x << 16;
    x ^= (x & 0x00ff_00ff) << 8;
    x ^= (x & 0x0f0f_0f0f) << 4;
    x ^= (x & 0x3333_3333) << 2;
    x ^ ((x & 0x5555_5555) << 1)
}

fn owen_scramble(x: u32, seed: u32) -> u32 {
    let mut x = x.reverse_bits().wrapping_add(seed);
    x ^= x.wrapping_mul(0x6c50_b47c);
    x ^= x.wrapping_mul(0xb82f_1e52);
    x ^= x.wrapping_mul(0xc7af_e638);
    x ^= x.wrapping_mul(0x8d22_f6e6);
    x.reverse_bits()
}

/// Sine and cosine of `turns` * 2 pi for turns in [0, 1]. A polynomial, because the sine of system
/// libraries differs between processors in the last place, and pictures must not.
pub fn sin_cos_turns(turns: f32) -> (f32, f32) {
    let quarter = (turns * 4.0 + 0.5).floor();
    let x = (turns * 4.0 - quarter) * std::f32::consts::FRAC_PI_2;
    let s = x * x;
    let sin = x * (1.0 - s / 6.0 * (1.0 - s / 20.0 * (1.0 - s / 42.0)));
    let cos = 1.0 - s / 2.0 * (1.0 - s / 12.0 * (1.0 - s / 30.0 * (1.0 - s / 56.0)));
    match quarter as u32 % 4 {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sixteen_samples_are_stratified_in_every_elementary_interval() {
        for pixel in 0..20 {
            let mut samplers: Vec<Sampler> = (0..16).map(|i| Sampler::new(&[pixel], i)).collect();
            for _dimension in 0..5 {
                let points: Vec<Vec2> = samplers.iter_mut().map(Sampler::pair).collect();
                for (columns, rows) in [(1, 16), (2, 8), (4, 4), (8, 2), (16, 1)] {
                    let mut cells = [0; 16];
                    for p in &points {
                        let (x, y) =
                            ((p.x * columns as f32) as usize, (p.y * rows as f32) as usize);
                        cells[y * columns + x] += 1;
                    }
                    assert_eq!(cells, [1; 16], "{columns} x {rows}");
                }
            }
        }
    }

    #[test]
    fn second_dimension_begins_as_published() {
        let first: Vec<f32> = (0..8).map(|i| unit_f32(sobol_second(i))).collect();
        assert_eq!(first, [0.0, 0.5, 0.75, 0.25, 0.625, 0.125, 0.375, 0.875]);
    }

    #[test]
    fn polynomial_matches_the_library() {
        for i in 0..=1000 {
            let turns = i as f32 / 1000.0;
            let (sin, cos) = sin_cos_turns(turns);
            let angle = f64::from(turns) * std::f64::consts::TAU;
            // truncated Taylor terms below 4e-7 at 45 degrees, plus rounding
            assert!((f64::from(sin) - angle.sin()).abs() < 1e-6, "{turns}");
            assert!((f64::from(cos) - angle.cos()).abs() < 1e-6, "{turns}");
        }
    }
}
