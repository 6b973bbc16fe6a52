//! Samples of the newest frames, with forgetting: what the light is fitted to.

use super::albedo::chroma_class;
use crate::math::color::luminance;
use crate::math::fibonacci_sphere;
use glam::Vec3;
use std::collections::VecDeque;
use std::f32::consts::PI;

pub const LANES: usize = 16;

/// Frames that are remembered at most; with a memory of 0.9 the oldest then counts less than a fifth.
const MAX_FRAMES: usize = 16;

/// Bins of normals, a Fibonacci sphere: about 30 degrees wide.
const NORMAL_BINS: usize = 60;

/// What is left of a pixel, at least, when light from hidden directions is taken away.
const LEAST_DIRECT_SHARE: f32 = 0.3;

/// Sixteen samples. Lanes without one have `present` = 0.
#[derive(Clone, Debug)]
pub struct Packet {
    /// World axes.
    pub position: [[f32; LANES]; 3],
    /// Direct light: what was seen, less what hidden directions are taken to bring.
    pub rgb: [[f32; LANES]; 3],
    pub luminance: [f32; LANES],
    /// Luminance as it was seen.
    pub seen: [f32; LANES],
    pub class: [u16; LANES],
    pub normal_bin: [u8; LANES],
    pub present: [f32; LANES],
    /// Robust weight, 1 where the model explains the sample.
    pub robust: [f32; LANES],
    /// Frame, normal and robust weight together.
    pub weight: [f32; LANES],
}

impl Packet {
    const EMPTY: Self = Self {
        position: [[0.0; LANES]; 3],
        rgb: [[0.0; LANES]; 3],
        luminance: [0.0; LANES],
        seen: [0.0; LANES],
        class: [0; LANES],
        normal_bin: [0; LANES],
        present: [0.0; LANES],
        robust: [0.0; LANES],
        weight: [0.0; LANES],
    };
}

/// One surface point with its transfer and what the camera saw.
#[derive(Clone, Copy, Debug)]
pub struct Sample<'a> {
    pub transfer: &'a [f32],
    pub position: Vec3,
    pub normal: Vec3,
    pub rgb: [f32; 3],
}

/// Samples of one frame.
#[derive(Clone, Debug, Default)]
pub struct Batch {
    pub packets: Vec<Packet>,
    /// n rows a packet, n = coefficients of the transfer.
    pub transfer: Vec<[f32; LANES]>,
    pub count: usize,
    /// Share that forgetting has left.
    pub share: f32,
}

impl Batch {
    pub fn clear(&mut self) {
        self.packets.clear();
        self.transfer.clear();
        (self.count, self.share) = (0, 1.0);
    }

    pub fn push(&mut self, sample: &Sample) {
        let n = sample.transfer.len();
        let lane = self.count % LANES;
        if lane == 0 {
            self.packets.push(Packet::EMPTY);
            self.transfer.resize(self.transfer.len() + n, [0.0; LANES]);
        }
        self.count += 1;
        let first = self.transfer.len() - n;
        for (row, &t) in self.transfer[first..].iter_mut().zip(sample.transfer) {
            row[lane] = t;
        }
        let packet = self.packets.last_mut().expect("pushed above");
        for axis in 0..3 {
            packet.position[axis][lane] = sample.position[axis];
            packet.rgb[axis][lane] = sample.rgb[axis];
        }
        packet.seen[lane] = luminance(sample.rgb);
        packet.class[lane] = chroma_class(sample.rgb);
        packet.normal_bin[lane] = normal_bin(sample.normal);
        (packet.present[lane], packet.robust[lane]) = (1.0, 1.0);
    }

    /// Takes light from hidden directions away: they show surfaces of mean radiance, of which a
    /// surface reflects the share `hidden_radiance`. Fills in the luminance.
    pub fn take_indirect_light(&mut self, hidden_radiance: f32) {
        let n = self.transfer.len() / self.packets.len().max(1);
        let mut mean = [0.0f64; 3];
        for (mean, channel) in mean.iter_mut().zip(0..3) {
            let sum: f32 = self.packets.iter().map(|p| p.rgb[channel].iter().sum::<f32>()).sum();
            *mean = f64::from(sum) / self.count.max(1) as f64;
        }
        let unoccluded = 0.5 / PI.sqrt();
        for (packet, transfer) in self.packets.iter_mut().zip(self.transfer.chunks(n.max(1))) {
            for i in 0..LANES {
                let hidden = (1.0 - transfer[0][i] / unoccluded).clamp(0.0, 1.0);
                for (channel, mean) in packet.rgb.iter_mut().zip(mean) {
                    let indirect = hidden_radiance * hidden * mean as f32;
                    channel[i] = (channel[i] - indirect).max(LEAST_DIRECT_SHARE * channel[i]);
                }
                let rgb = [0, 1, 2].map(|c| packet.rgb[c][i]);
                packet.luminance[i] = luminance(rgb);
            }
        }
    }
}

/// Batches of the newest frames, the newest last.
#[derive(Clone, Debug, Default)]
pub struct Bank {
    batches: VecDeque<Batch>,
    /// Coefficients of a transfer.
    n: usize,
    /// Emptied batches, for their memory.
    spare: Vec<Batch>,
    bins: Vec<f32>,
}

impl Bank {
    pub fn coefficients(&self) -> usize {
        self.n
    }

    pub fn batches(&self) -> impl DoubleEndedIterator<Item = &Batch> + Clone {
        self.batches.iter()
    }

    pub fn batches_mut(&mut self) -> impl Iterator<Item = &mut Batch> {
        self.batches.iter_mut()
    }

    pub fn newest(&self) -> Option<&Batch> {
        self.batches.back()
    }

    /// An empty batch to fill.
    pub fn blank(&mut self) -> Batch {
        let mut batch = self.spare.pop().unwrap_or_default();
        batch.clear();
        batch
    }

    pub fn clear(&mut self) {
        self.spare.extend(self.batches.drain(..));
    }

    /// Adds a frame; those before keep the share `memory` of theirs.
    pub fn push(&mut self, batch: Batch, coefficients: usize, memory: f32) {
        if coefficients != self.n || memory <= 0.0 {
            self.clear();
        }
        self.n = coefficients;
        self.batches.iter_mut().for_each(|b| b.share *= memory);
        if self.batches.len() == MAX_FRAMES {
            self.spare.extend(self.batches.pop_front());
        }
        self.batches.push_back(batch);
    }

    /// Brings `weight` up to date. With `balance`, directions of surface that fill the picture count
    /// less than their number, and those that few pixels show count more: by the square root, so that a
    /// bin of three pixels does not decide either.
    pub fn weigh(&mut self, balance: bool) {
        self.bins.clear();
        self.bins.resize(NORMAL_BINS, 0.0);
        for batch in &self.batches {
            for packet in &batch.packets {
                for i in 0..LANES {
                    self.bins[usize::from(packet.normal_bin[i])] += batch.share * packet.present[i];
                }
            }
        }
        let total: f32 = self.bins.iter().sum();
        let weighted: f32 = self.bins.iter().map(|count| count.sqrt()).sum();
        let normal_weight = |bin: u8| match balance {
            true => total / (weighted * self.bins[usize::from(bin)].sqrt()),
            false => 1.0,
        };
        for batch in &mut self.batches {
            for packet in &mut batch.packets {
                for i in 0..LANES {
                    packet.weight[i] = if packet.present[i] > 0.0 {
                        batch.share * packet.robust[i] * normal_weight(packet.normal_bin[i])
                    } else {
                        0.0
                    };
                }
            }
        }
    }

    /// Weighted mean of the positions, and the root of their mean squared distance from it.
    pub fn centre_and_extent_m(&self) -> (Vec3, f32) {
        let (mut sum, mut squares, mut weight) = ([0.0f64; 3], 0.0f64, 0.0f64);
        for packet in self.batches.iter().flat_map(|b| &b.packets) {
            for i in 0..LANES {
                let w = f64::from(packet.weight[i]);
                weight += w;
                for (sum, axis) in sum.iter_mut().zip(&packet.position) {
                    *sum += w * f64::from(axis[i]);
                    squares += w * f64::from(axis[i]).powi(2);
                }
            }
        }
        let weight = weight.max(f64::MIN_POSITIVE);
        let centre = sum.map(|s| s / weight);
        let variance = squares / weight - centre.iter().map(|c| c * c).sum::<f64>();
        (Vec3::from(centre.map(|c| c as f32)), variance.max(0.0).sqrt() as f32)
    }
}

fn normal_bin(normal: Vec3) -> u8 {
    use std::sync::LazyLock;
    static BINS: LazyLock<Vec<Vec3>> = LazyLock::new(|| fibonacci_sphere(NORMAL_BINS));
    let best = BINS.iter().enumerate().max_by(|a, b| a.1.dot(normal).total_cmp(&b.1.dot(normal)));
    best.map_or(0, |(k, _)| k as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn batch(count: usize, normal: impl Fn(usize) -> Vec3) -> Batch {
        let mut batch = Batch::default();
        batch.clear();
        for k in 0..count {
            batch.push(&Sample {
                transfer: &[0.28, 0.1, 0.0, 0.0],
                position: Vec3::new(k as f32, 0.0, 0.0),
                normal: normal(k),
                rgb: [0.5, 0.25, 0.125],
            });
        }
        batch.take_indirect_light(0.5);
        batch
    }

    #[test]
    fn forgetting_and_its_end() {
        let mut bank = Bank::default();
        for _ in 0..40 {
            bank.push(batch(20, |_| Vec3::Z), 4, 0.5);
        }
        assert_eq!(bank.batches().count(), MAX_FRAMES);
        let shares: Vec<f32> = bank.batches().map(|b| b.share).rev().take(3).collect();
        assert_eq!(shares, [1.0, 0.5, 0.25]);
        bank.push(batch(20, |_| Vec3::Z), 4, 0.0);
        assert_eq!(bank.batches().count(), 1, "without memory there is the present alone");
        bank.push(batch(20, |_| Vec3::Z), 9, 0.9);
        assert_eq!(bank.batches().count(), 1, "other coefficients start anew");
    }

    #[test]
    fn rare_normals_count_more_and_the_mean_weight_is_one() {
        let mut bank = Bank::default();
        // 100 face +z, 25 face +x
        bank.push(batch(125, |k| if k < 100 { Vec3::Z } else { Vec3::X }), 4, 0.9);
        bank.weigh(true);
        let weights: Vec<f32> =
            bank.newest().unwrap().packets.iter().flat_map(|p| p.weight).collect();
        assert!((weights[110] / weights[0] - 2.0).abs() < 1e-5);
        assert!((weights.iter().sum::<f32>() - 125.0).abs() < 1e-3);
        assert_eq!(weights[125..], [0.0; 3], "lanes without a sample");
        let (centre, extent) = bank.centre_and_extent_m();
        assert!(centre.x > 62.0 && extent > 30.0, "rare ones have the larger k");
    }

    #[test]
    fn light_from_hidden_directions_is_taken_once_and_never_all() {
        let open = batch(3, |_| Vec3::Z).packets[0].rgb[0][0];
        assert!((open - 0.5).abs() < 0.005, "an open surface keeps its light: {open}");
        let mut closed = Batch::default();
        closed.clear();
        closed.push(&Sample {
            transfer: &[0.0; 4],
            position: Vec3::ZERO,
            normal: Vec3::Z,
            rgb: [0.5; 3],
        });
        closed.take_indirect_light(0.5);
        assert!((closed.packets[0].luminance[0] - 0.25).abs() < 1e-6);
        closed.take_indirect_light(100.0);
        assert!(closed.packets[0].luminance[0] > 0.0);
    }
}
