//! Pictures as files hold them, from whoever made the files. Sizes are checked before memory is taken.
//!
//! A header may claim any size. Beyond [`SMALL_PIXELS`] no more is believed than the format's densest code can
//! hold in a file of that length, so that memory is bounded by the length times a constant, and by
//! [`MAX_PIXELS`]. No complete picture is refused by that, but for blank ones of fewer than 8 bits a pixel.

use super::Size;
use crate::files;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};
use std::io::Cursor;
use std::path::Path;

/// Larger pictures are refused before they are decoded.
pub const MAX_PIXELS: usize = 64 << 20;

/// Every header may claim this much.
const SMALL_PIXELS: u64 = 1 << 20;

/// No compressed picture of [`MAX_PIXELS`] needs more.
const MAX_FILE_BYTES: u64 = 512 << 20;

/// Deflate's longest copy, 258 bytes, takes two bits at least.
const MAX_DEFLATE_RATIO: u64 = 1032;

/// A JPEG block of 8x8 pixels takes a bit at least in each component, and one component has at least half as
/// many blocks as the picture in all.
const MAX_JPEG_PIXELS_PER_BYTE: u64 = 1024;

/// A run of 127 pixels takes two bytes in each of four channels.
const MAX_RADIANCE_PIXELS_PER_BYTE: u64 = 16;

/// What cameras and textures come in.
pub(crate) const USUAL: &[ImageFormat] = &[ImageFormat::Png, ImageFormat::Jpeg];

/// Those, and pictures of light.
pub(crate) const WITH_RADIANCE: &[ImageFormat] =
    &[ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::Hdr];

/// The bytes of a picture file.
pub(crate) fn read(path: &Path) -> std::io::Result<Vec<u8>> {
    files::read(path, MAX_FILE_BYTES)
}

/// Reads the header. The format is told from the bytes, and must be one of `formats`.
pub(crate) fn open<'a>(
    bytes: &'a [u8],
    formats: &[ImageFormat],
) -> Result<(impl ImageDecoder + 'a, Size), String> {
    let format = image::guess_format(bytes).map_err(|e| e.to_string())?;
    if !formats.contains(&format) {
        return Err(format!("{format:?} pictures are not read; use {}", names(formats)));
    }
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let mut limits = Limits::default();
    // Of what a PNG has beside its pixels, a profile can grow like them. Rows are taken at once, too.
    let inflated = (bytes.len() as u64).saturating_mul(MAX_DEFLATE_RATIO);
    let rows = SMALL_PIXELS * 8 + (1 << 20);
    limits.max_alloc = Some(inflated.saturating_add(rows).min(MAX_PIXELS as u64 * 8));
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|e| e.to_string())?;
    let (width, height) = decoder.dimensions();
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || pixels > MAX_PIXELS as u64 {
        return Err(format!("{width}x{height} pixels; at most {MAX_PIXELS} are read"));
    }
    if pixels > most_pixels(format, bytes) {
        let length = bytes.len();
        return Err(format!("{width}x{height} pixels cannot be in {length} bytes: cut off?"));
    }
    Ok((decoder, Size::new(width as usize, height as usize)))
}

/// The whole picture.
pub(crate) fn decode(bytes: &[u8], formats: &[ImageFormat]) -> Result<DynamicImage, String> {
    pixels(open(bytes, formats)?.0)
}

/// What [`open`] has found.
pub(crate) fn pixels(decoder: impl ImageDecoder) -> Result<DynamicImage, String> {
    DynamicImage::from_decoder(decoder).map_err(|e| e.to_string())
}

/// The picture in a file.
pub(crate) fn decode_file(path: &Path, formats: &[ImageFormat]) -> Result<DynamicImage, String> {
    decode(&read(path).map_err(|e| e.to_string())?, formats)
}

/// Pixels that a file of this length can hold.
fn most_pixels(format: ImageFormat, bytes: &[u8]) -> u64 {
    let length = bytes.len() as u64;
    let most = match format {
        ImageFormat::Png => length.saturating_mul(MAX_DEFLATE_RATIO * 8) / png_bits(bytes).max(8),
        ImageFormat::Jpeg => length.saturating_mul(MAX_JPEG_PIXELS_PER_BYTE),
        _ => length.saturating_mul(MAX_RADIANCE_PIXELS_PER_BYTE),
    };
    most.max(SMALL_PIXELS)
}

/// Bits of a stored pixel, from the header that the decoder has accepted.
fn png_bits(bytes: &[u8]) -> u64 {
    let at = |i: usize| u64::from(bytes.get(i).copied().unwrap_or(0));
    let channels = match at(25) {
        2 => 3,
        4 => 2,
        6 => 4,
        _ => 1,
    };
    at(24) * channels
}

fn names(formats: &[ImageFormat]) -> String {
    formats.iter().map(|f| format!("{f:?}").to_uppercase()).collect::<Vec<_>>().join(" or ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::codecs::jpeg::JpegEncoder;
    use image::codecs::png::{CompressionType, FilterType, PngEncoder};
    use image::{ExtendedColorType, ImageEncoder, RgbImage};

    /// A PNG of one byte value, as small as deflate makes it.
    fn flat_png(width: u32, height: u32, color: ExtendedColorType, bytes: usize) -> Vec<u8> {
        let mut out = Vec::new();
        PngEncoder::new_with_quality(&mut out, CompressionType::Best, FilterType::NoFilter)
            .write_image(&vec![0; bytes], width, height, color)
            .unwrap();
        out
    }

    /// Another size in the header, its checksum made good.
    fn with_size(mut png: Vec<u8>, width: u32, height: u32) -> Vec<u8> {
        png[16..20].copy_from_slice(&width.to_be_bytes());
        png[20..24].copy_from_slice(&height.to_be_bytes());
        let crc = !png[12..29].iter().fold(!0u32, |crc, &byte| {
            (0..8).fold(crc ^ u32::from(byte), |c, _| {
                if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 }
            })
        });
        png[29..33].copy_from_slice(&crc.to_be_bytes());
        png
    }

    #[test]
    fn what_the_file_cannot_hold_is_refused_by_the_header() {
        let small = flat_png(16, 16, ExtendedColorType::Rgb8, 16 * 16 * 3);
        assert!(decode(&small, USUAL).is_ok());
        // 192 MB of pixels in some 70 bytes.
        let error = decode(&with_size(small.clone(), 8192, 8192), USUAL).unwrap_err();
        assert!(error.contains("8192x8192") && error.contains("cannot be in"), "{error}");
        let error = decode(&with_size(small, 60_000, 60_000), USUAL).unwrap_err();
        assert!(error.contains("60000x60000") && error.contains("at most"), "{error}");

        let mut jpeg = Vec::new();
        JpegEncoder::new(&mut jpeg).encode_image(&RgbImage::new(16, 16)).unwrap();
        let frame = jpeg.windows(2).position(|w| w == [0xff, 0xc0]).unwrap();
        jpeg[frame + 5..frame + 9].copy_from_slice(&[0x20, 0, 0x20, 0]);
        let error = decode(&jpeg, USUAL).unwrap_err();
        assert!(error.contains("8192x8192") && error.contains("cannot be in"), "{error}");

        let hdr = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8000 +X 8000\n";
        let error = decode(hdr, WITH_RADIANCE).unwrap_err();
        assert!(error.contains("cannot be in"), "{error}");
        assert!(decode(hdr, USUAL).unwrap_err().contains("not read; use PNG or JPEG"));
    }

    #[test]
    fn pictures_that_compress_best_are_read() {
        // Zeros in a file near deflate's limit.
        let side = 2048;
        let png = flat_png(side, side, ExtendedColorType::Rgb8, 12 << 20);
        let ratio = (12 << 20) / png.len();
        assert!(ratio > 900 && ratio < MAX_DEFLATE_RATIO as usize, "{ratio}");
        let found = decode(&png, USUAL).unwrap();
        assert_eq!((found.width(), found.height()), (side, side));

        let mut jpeg = Vec::new();
        JpegEncoder::new_with_quality(&mut jpeg, 1)
            .encode_image(&RgbImage::new(2048, 2048))
            .unwrap();
        let density = (2048 * 2048) / jpeg.len() as u64;
        // Three blocks of two codes each, 14 bits by the usual tables.
        assert!(density > 30 && density < MAX_JPEG_PIXELS_PER_BYTE, "{density}");
        assert!(decode(&jpeg, USUAL).is_ok());

        let black = vec![image::Rgb([0.0f32; 3]); 2048 * 1024];
        let mut hdr = Vec::new();
        image::codecs::hdr::HdrEncoder::new(&mut hdr).encode(&black, 2048, 1024).unwrap();
        let density = (2048 * 1024) / hdr.len() as u64;
        assert!(density > 8 && density < MAX_RADIANCE_PIXELS_PER_BYTE, "{density}");
        assert!(decode(&hdr, WITH_RADIANCE).is_ok());
    }
}
