//! PNG pictures.

use super::{OutputError, atomic_write, from_encoder};
use crate::image::{Image, Size};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use rayon::prelude::*;
use std::path::Path;

/// Units a metre of the TUM RGB-D benchmark: 0.2 mm, up to 13.1 m.
pub const DEPTH_UNITS_PER_M: f32 = 5000.0;

/// Writes 8-bit sRGB. Compression is the fast kind: pictures are written while frames wait.
pub fn write_color_png(path: &Path, image: &Image<[u8; 3]>) -> Result<(), OutputError> {
    let bytes = image.as_slice().as_flattened();
    write_png(path, bytes, image.size(), ExtendedColorType::Rgb8)
}

/// Writes depth as 16-bit grey, `units_per_m` units a metre, rounded; missing is 0. Depth beyond
/// 65535 units cannot be told in this format, and is missing too.
pub fn write_depth_png(
    path: &Path,
    depth_m: &Image<f32>,
    units_per_m: f32,
) -> Result<(), OutputError> {
    let units = |&depth: &f32| {
        let units = (depth * units_per_m).round();
        // false for NaN
        if units > 0.0 && units <= f32::from(u16::MAX) { units as u16 } else { 0 }
    };
    let bytes: Vec<u8> =
        depth_m.as_slice().par_iter().flat_map_iter(|d| units(d).to_ne_bytes()).collect();
    write_png(path, &bytes, depth_m.size(), ExtendedColorType::L16)
}

fn write_png(
    path: &Path,
    bytes: &[u8],
    size: Size,
    color: ExtendedColorType,
) -> Result<(), OutputError> {
    let (Ok(width), Ok(height)) = (size.width.try_into(), size.height.try_into()) else {
        return Err(OutputError::content(path, format!("{size} is too large for PNG")));
    };
    if size.pixels() == 0 {
        return Err(OutputError::content(path, format!("PNG has no pictures of {size}")));
    }
    atomic_write(path, |w| {
        PngEncoder::new_with_quality(w, CompressionType::Fast, FilterType::Adaptive)
            .write_image(bytes, width, height, color)
            .map_err(from_encoder)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Rng;

    #[test]
    fn colours_come_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("frames/000001.png");
        let mut rng = Rng::new(&[1]);
        let size = Size::new(67, 43);
        let pixels = (0..size.pixels()).map(|_| std::array::from_fn(|_| rng.next_u32() as u8));
        let image = Image::from_vec(size, pixels.collect());
        write_color_png(&path, &image).unwrap();
        let back = image::open(&path).unwrap();
        assert_eq!(back.color(), image::ColorType::Rgb8);
        assert_eq!((back.width(), back.height()), (67, 43));
        assert_eq!(back.to_rgb8().as_raw(), image.as_slice().as_flattened());
    }

    #[test]
    fn depth_comes_back_within_half_a_unit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("depth.png");
        let depth = [0.0, 0.0001, 1.23456, 13.107, 13.2, f32::NAN, -1.0, f32::INFINITY];
        let image = Image::from_vec(Size::new(8, 1), depth.to_vec());
        write_depth_png(&path, &image, DEPTH_UNITS_PER_M).unwrap();
        let back = image::open(&path).unwrap();
        assert_eq!(back.color(), image::ColorType::L16);
        let expected = [0u16, 1, 6173, 65535, 0, 0, 0, 0];
        assert_eq!(back.to_luma16().as_raw().as_slice(), expected);
    }

    #[test]
    fn empty_pictures_are_refused() {
        let empty = Image::new(Size::new(0, 3), [0; 3]);
        let message = write_color_png(Path::new("a.png"), &empty).unwrap_err().to_string();
        assert_eq!(message, "a.png: PNG has no pictures of 0x3");
    }
}
