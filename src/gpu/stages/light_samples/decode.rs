//! From the words that come back to samples.

use crate::lighting::{Counts, PickedPoint, PickedSamples, most_samples};
use crate::math::{View, sh};
use glam::{Vec2, Vec3};

/// Words before the samples, as in `light_samples/candidates.wgsl`: pixels that are used, have no surface,
/// are grazing, dark, saturated; samples.
pub const HEADER: usize = 8;
/// Words of a sample besides its transfer: pixel, depth, linear RGB, normal, luminance then.
const POINT_WORDS: usize = 7;

/// Words of a sample; two coefficients a word.
pub fn sample_words(bands: usize) -> usize {
    POINT_WORDS + sh::coefficients(bands).div_ceil(2)
}

/// `words` are those of a frame that was taken from `view`.
pub fn decode(words: &[u32], view: View, bands: usize) -> PickedSamples {
    let count = |k: usize| words[k] as usize;
    let [used, no_surface, grazing, dark, saturated, picked] = [0, 1, 2, 3, 4, 5].map(count);
    let samples = words[HEADER..].chunks_exact(sample_words(bands));
    let mut samples: Vec<&[u32]> = samples.take(picked.min(most_samples(bands))).collect();
    samples.sort_unstable_by_key(|words| words[0]);
    let n = sh::coefficients(bands);
    let world_from_view = view.world_from_view_f32();
    let width = view.size().width;
    let mut out = PickedSamples {
        view,
        counts: Counts { used, no_surface, grazing, dark, saturated },
        bands,
        points: Vec::with_capacity(samples.len()),
        transfer: Vec::with_capacity(samples.len() * n),
    };
    for words in samples {
        let (point, transfer) = words.split_at(POINT_WORDS);
        let number = |k: usize| f32::from_bits(point[k]);
        let pixel = point[0] as usize;
        let pixel = Vec2::new((pixel % width) as f32, (pixel / width) as f32);
        out.points.push(PickedPoint {
            position: world_from_view.transform_point3(view.unproject(pixel, number(1))),
            rgb: [2, 3, 4].map(number),
            normal: unpacked_normal(point[5]),
            then: number(6),
        });
        out.transfer.extend(transfer.iter().flat_map(|&pair| unpacked(pair)).take(n));
    }
    out
}

/// Two values in [-1, 1], as WGSL's `pack2x16snorm` packs them.
fn unpacked(pair: u32) -> [f32; 2] {
    [pair as i16, (pair >> 16) as i16].map(|v| (f32::from(v) / 32767.0).max(-1.0))
}

/// From an octahedron, whose lower half is folded outwards.
fn unpacked_normal(pair: u32) -> Vec3 {
    let [x, y] = unpacked(pair);
    let z = 1.0 - x.abs() - y.abs();
    let fold = (-z).max(0.0);
    Vec3::new(x - fold.copysign(x), y - fold.copysign(y), z).normalize_or_zero()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_on_the_octahedron() {
        assert_eq!(unpacked_normal(0), Vec3::Z);
        assert_eq!(unpacked_normal(0x7fff), Vec3::X);
        assert_eq!(unpacked_normal(0x8001_0000), -Vec3::Y);
        assert!((unpacked_normal(0x7fff_7fff) - -Vec3::Z).length() < 1e-6);
    }
}
