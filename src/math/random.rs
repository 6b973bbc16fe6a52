//! Integer-hash randomness: the same numbers for any number of threads and any order of work.

/// PCG-style output hash of one word (Jarzynski and Olano, "Hash Functions for GPU Rendering", 2020).
pub fn hash(v: u32) -> u32 {
    let state = v.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

/// Uniform in [0, 1) from a hash word: 24 bits, so never 1.0.
pub fn unit_f32(word: u32) -> f32 {
    (word >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// A small stream of random numbers, seeded by any words (frame, pixel, sample...).
#[derive(Clone, Debug)]
pub struct Rng {
    state: u32,
}

impl Rng {
    pub fn new(words: &[u32]) -> Self {
        Self { state: words.iter().fold(0x9e37_79b9, |s, &w| hash(s ^ w)) }
    }

    pub fn next_u32(&mut self) -> u32 {
        self.state = self.state.wrapping_add(0x9e37_79b9);
        hash(self.state)
    }

    /// Uniform in [0, 1).
    pub fn uniform(&mut self) -> f32 {
        unit_f32(self.next_u32())
    }

    /// Standard normal (Box-Muller).
    pub fn normal(&mut self) -> f32 {
        let u = 1.0 - self.uniform();
        let v = self.uniform();
        (-2.0 * u.ln()).sqrt() * (std::f32::consts::TAU * v).cos()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_those_of_the_distributions() {
        let mut rng = Rng::new(&[7]);
        let n = 100_000;
        let (mut mean, mut second, mut gauss) = (0.0f64, 0.0f64, 0.0f64);
        for _ in 0..n {
            let u = f64::from(rng.uniform());
            assert!((0.0..1.0).contains(&u));
            mean += u;
            second += u * u;
            gauss += f64::from(rng.normal()).powi(2);
        }
        let n = f64::from(n);
        // five standard errors: sqrt(1/12/n), sqrt(4/45/n), sqrt(2/n)
        assert!((mean / n - 0.5).abs() < 5.0 * (1.0 / 12.0 / n).sqrt());
        assert!((second / n - 1.0 / 3.0).abs() < 5.0 * (4.0 / 45.0 / n).sqrt());
        assert!((gauss / n - 1.0).abs() < 5.0 * (2.0 / n).sqrt());
    }
}
