//! Pictures as files' bytes.

use crate::image::Image;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, ImageResult};

/// 16-bit depth steps per metre, as in the TUM benchmark: 0.2 mm, up to 13.1 m.
pub const DEPTH_SCALE: f32 = 5000.0;

/// How colour pictures are stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ColorFormat {
    #[default]
    Png,
    /// Quality 1 to 100.
    Jpeg(u8),
}

impl ColorFormat {
    pub fn extension(self) -> &'static str {
        match self {
            ColorFormat::Png => "png",
            ColorFormat::Jpeg(_) => "jpg",
        }
    }

    /// The picture as a file's bytes.
    pub fn encode(self, picture: &Image<[u8; 3]>) -> ImageResult<Vec<u8>> {
        let (bytes, mut out) = (picture.as_slice().as_flattened(), Vec::new());
        let (width, height) = (picture.width() as u32, picture.height() as u32);
        match self {
            ColorFormat::Png => {
                PngEncoder::new_with_quality(&mut out, CompressionType::Fast, FilterType::Adaptive)
                    .write_image(bytes, width, height, ExtendedColorType::Rgb8)?;
            }
            ColorFormat::Jpeg(quality) => {
                JpegEncoder::new_with_quality(&mut out, quality.clamp(1, 100)).write_image(
                    bytes,
                    width,
                    height,
                    ExtendedColorType::Rgb8,
                )?;
            }
        }
        Ok(out)
    }
}

/// Speed against size of depth pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DepthCompression {
    /// For live recording.
    #[default]
    Fast,
    Small,
}

/// How depth pictures are stored: as 16-bit grey PNG.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthFormat {
    pub steps_per_m: f32,
    pub compression: DepthCompression,
}

impl Default for DepthFormat {
    fn default() -> Self {
        Self { steps_per_m: DEPTH_SCALE, compression: DepthCompression::Fast }
    }
}

/// What 16 bits have changed of depth.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct DepthLoss {
    /// Pixels that are between two steps, and the most that one of them was moved.
    pub rounded: usize,
    pub most_m: f32,
    /// Pixels beyond the largest step: they are missing now.
    pub beyond: usize,
}

impl DepthLoss {
    pub fn is_none(&self) -> bool {
        self.rounded == 0 && self.beyond == 0
    }

    pub(super) fn add(&mut self, other: Self) {
        self.rounded += other.rounded;
        self.most_m = self.most_m.max(other.most_m);
        self.beyond += other.beyond;
    }
}

impl DepthFormat {
    /// Metres to steps; what is missing, broken or beyond 16 bits becomes 0.
    pub fn steps(&self, depth_m: f32) -> u16 {
        let steps = (depth_m * self.steps_per_m).round();
        if steps >= 0.0 && steps <= f32::from(u16::MAX) { steps as u16 } else { 0 }
    }

    /// Against reading the picture back, which divides steps by steps per metre.
    pub fn loss(&self, depth_m: &Image<f32>) -> DepthLoss {
        let mut loss = DepthLoss::default();
        for &depth_m in depth_m.as_slice().iter().filter(|d| d.is_finite() && **d > 0.0) {
            let back_m = f32::from(self.steps(depth_m)) / self.steps_per_m;
            if back_m == depth_m {
                continue;
            }
            if depth_m * self.steps_per_m > f32::from(u16::MAX) {
                loss.beyond += 1;
            } else {
                loss.rounded += 1;
                loss.most_m = loss.most_m.max((back_m - depth_m).abs());
            }
        }
        loss
    }

    /// The picture as a file's bytes.
    pub fn encode(&self, depth_m: &Image<f32>) -> ImageResult<Vec<u8>> {
        let bytes: Vec<u8> =
            depth_m.as_slice().iter().flat_map(|&d| self.steps(d).to_ne_bytes()).collect();
        match self.compression {
            DepthCompression::Fast => {
                grey_png(depth_m, &bytes, CompressionType::Fast, FilterType::Adaptive)
            }
            DepthCompression::Small => {
                // Smooth depth is smallest with filters, noisy depth of few distinct steps without.
                let png = |filter| grey_png(depth_m, &bytes, CompressionType::Best, filter);
                let (filtered, plain) = (png(FilterType::Adaptive)?, png(FilterType::NoFilter)?);
                Ok(if plain.len() < filtered.len() { plain } else { filtered })
            }
        }
    }
}

fn grey_png(
    depth_m: &Image<f32>,
    bytes: &[u8],
    level: CompressionType,
    filter: FilterType,
) -> ImageResult<Vec<u8>> {
    let (width, height) = (depth_m.width() as u32, depth_m.height() as u32);
    let mut out = Vec::new();
    PngEncoder::new_with_quality(&mut out, level, filter).write_image(
        bytes,
        width,
        height,
        ExtendedColorType::L16,
    )?;
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Size;

    #[test]
    fn broken_depth_is_missing() {
        let format = DepthFormat::default();
        assert_eq!(format.steps(1.0), 5000);
        assert_eq!(format.steps(13.107), 65535);
        for broken in [-1.0, 13.2, f32::NAN, f32::INFINITY] {
            assert_eq!(format.steps(broken), 0);
        }
    }

    fn row(depth_m: Vec<f32>) -> Image<f32> {
        Image::from_vec(Size::new(depth_m.len(), 1), depth_m)
    }

    #[test]
    fn millimetres_are_exact_and_what_is_not_is_counted() {
        let format = DepthFormat::default();
        let mm = row((0..=13_107u16).map(|mm| f32::from(mm) / 1000.0).collect());
        assert!(format.loss(&mm).is_none());
        let loss = format.loss(&row(vec![1.0, 1.00007, 13.2, 0.0, f32::NAN, -1.0]));
        assert_eq!((loss.rounded, loss.beyond), (1, 1));
        assert!((loss.most_m - 7e-5).abs() < 1e-6, "{loss:?}");
        let whole_range = row((0..=u16::MAX).map(|mm| f32::from(mm) / 1000.0).collect());
        let mm = DepthFormat { steps_per_m: 1000.0, ..format };
        assert!(mm.loss(&whole_range).is_none());
    }
}
