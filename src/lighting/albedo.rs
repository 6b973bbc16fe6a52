//! Albedo by classes of colour. What reflects the same colour is taken to be one material with one
//! albedo; the mean over all samples is 1, since light is known times the mean albedo only.

use super::bank::{Bank, LANES};

/// Steps of chromaticity r / (r + g + b), g / (r + g + b).
const STEP: f32 = 0.05;
const STEPS: usize = 21;

/// A class is believed to have the mean albedo with the weight of this many samples.
const PRIOR_SAMPLES: f64 = 2.0;

/// No material reflects less or more than this times the mean.
const LEAST: f64 = 0.05;
const MOST: f64 = 20.0;

/// Index of the class of a colour.
pub fn chroma_class(rgb: [f32; 3]) -> u16 {
    let sum: f32 = rgb.iter().map(|v| v.max(0.0)).sum();
    let step = |v: f32| if sum > 0.0 { (v.max(0.0) / sum / STEP).round() as usize } else { 0 };
    (step(rgb[0]).min(STEPS - 1) * STEPS + step(rgb[1]).min(STEPS - 1)) as u16
}

/// Albedo of every class relative to the mean.
#[derive(Clone, Debug)]
pub struct Albedos {
    relative: Vec<f32>,
}

impl Default for Albedos {
    fn default() -> Self {
        Self { relative: vec![1.0; STEPS * STEPS] }
    }
}

impl Albedos {
    pub fn of(&self, class: &[u16; LANES]) -> [f32; LANES] {
        class.map(|c| self.relative[usize::from(c)])
    }

    /// The albedos that fit best where unit albedo would show `predicted` (a row a packet, in the order of
    /// the bank).
    pub fn fit(&mut self, bank: &Bank, predicted: &[[f32; LANES]]) {
        #[derive(Clone, Copy, Default)]
        struct Class {
            seen: f64,
            predicted: f64,
            samples: f64,
            present: f64,
        }
        let mut classes = vec![Class::default(); self.relative.len()];
        for (packet, predicted) in bank.batches().flat_map(|b| &b.packets).zip(predicted) {
            for i in 0..LANES {
                let class = &mut classes[usize::from(packet.class[i])];
                let (w, p) = (f64::from(packet.weight[i]), f64::from(predicted[i]));
                class.seen += w * p * f64::from(packet.luminance[i]);
                class.predicted += w * p * p;
                class.samples += f64::from(packet.robust[i] * packet.present[i]);
                class.present += f64::from(packet.present[i]);
            }
        }
        let (mut sum, mut present) = (0.0, 0.0);
        for (relative, class) in self.relative.iter_mut().zip(&classes) {
            let best = if class.predicted > 0.0 { class.seen / class.predicted } else { 1.0 };
            let trust = class.samples / (class.samples + PRIOR_SAMPLES);
            *relative = best.clamp(LEAST, MOST).powf(trust) as f32;
            sum += class.present * f64::from(*relative);
            present += class.present;
        }
        if sum > 0.0 {
            let scale = (present / sum) as f32;
            self.relative.iter_mut().for_each(|a| *a *= scale);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::bank::{Batch, Sample};
    use super::*;
    use glam::Vec3;

    #[test]
    fn classes_follow_the_colour_and_not_the_brightness() {
        assert_eq!(chroma_class([0.2, 0.1, 0.1]), chroma_class([0.8, 0.4, 0.4]));
        assert_ne!(chroma_class([0.2, 0.1, 0.1]), chroma_class([0.1, 0.2, 0.1]));
        for odd in [[0.0; 3], [-1.0, 0.0, 0.0], [f32::MAX; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] {
            assert!(usize::from(chroma_class(odd)) < STEPS * STEPS, "{odd:?}");
        }
    }

    #[test]
    fn albedos_of_two_materials() {
        let (red, green) = ([0.6, 0.2, 0.2], [0.06, 0.3, 0.06]);
        let mut batch = Batch::default();
        batch.clear();
        for k in 0..400 {
            let rgb = if k % 2 == 0 { red } else { green };
            let (transfer, normal) = (&[0.28][..], Vec3::Z);
            batch.push(&Sample { transfer, position: Vec3::ZERO, normal, rgb });
        }
        batch.take_indirect_light(0.0);
        let predicted = vec![[0.5; LANES]; batch.packets.len()];
        let mut bank = Bank::default();
        bank.push(batch, 1, 0.9);
        bank.weigh(false);
        let mut albedos = Albedos::default();
        albedos.fit(&bank, &predicted);
        let class = |rgb| [chroma_class(rgb); LANES];
        let (a, b) = (albedos.of(&class(red))[0], albedos.of(&class(green))[0]);
        assert!((0.5 * (a + b) - 1.0).abs() < 1e-5, "the mean over samples is 1");
        let ratio = crate::math::color::luminance(red) / crate::math::color::luminance(green);
        // 200 samples against a prior of 2 draw each by about 1 % of its logarithm
        assert!((a / b / ratio - 1.0).abs() < 0.02, "{} {ratio}", a / b);
    }
}
