//! Pictures from files. Sizes are checked before memory is taken.

use super::CaptureError;
use crate::image::{Image, Size};
use image::{ColorType, DynamicImage, ImageDecoder, ImageFormat, ImageReader};
use std::io::Cursor;
use std::path::Path;

/// Larger pictures are refused before they are decoded.
pub const MAX_PIXELS: usize = 64 << 20;

/// No compressed picture of [`MAX_PIXELS`] needs more.
const MAX_FILE_BYTES: u64 = 512 << 20;

/// 8-bit sRGB. Grey pictures become RGB, alpha is dropped, 16-bit channels are rounded to 8.
pub(crate) fn color(path: &Path) -> Result<Image<[u8; 3]>, CaptureError> {
    let bytes = read(path)?;
    let (decoder, size) = open(path, &bytes)?;
    if ImageFormat::Jpeg == guess(path, &bytes)? && !ends_as_jpeg(&bytes) {
        return Err(CaptureError::file(path, "JPEG is cut off: no end marker"));
    }
    Ok(rgb(decode(path, decoder)?, size))
}

/// 8-bit sRGB of a JPEG in memory, which must have this size and [an end](ends_as_jpeg).
pub(super) fn jpeg(bytes: &[u8], expected: Size) -> Result<Image<[u8; 3]>, String> {
    let (decoder, size) = decoder(bytes, ImageFormat::Jpeg)?;
    if size != expected {
        return Err(format!("a JPEG of {size} among pictures of {expected}"));
    }
    Ok(rgb(DynamicImage::from_decoder(decoder).map_err(|e| e.to_string())?, size))
}

fn rgb(picture: DynamicImage, size: Size) -> Image<[u8; 3]> {
    // The decoder's buffer has no rest: it holds 3 bytes for each pixel of its own size.
    Image::from_vec(size, picture.into_rgb8().into_raw().as_chunks::<3>().0.to_vec())
}

/// 16-bit grey, as stored.
pub(super) fn depth(path: &Path) -> Result<Image<u16>, CaptureError> {
    let bytes = read(path)?;
    let (decoder, size) = open(path, &bytes)?;
    check_depth_type(path, decoder.color_type())?;
    Ok(Image::from_vec(size, decode(path, decoder)?.into_luma16().into_raw()))
}

/// Size of a colour picture from its header.
pub(super) fn color_size(path: &Path) -> Result<Size, CaptureError> {
    Ok(open(path, &read(path)?)?.1)
}

/// Size of a depth picture from its header, which must say 16-bit grey.
pub(super) fn depth_size(path: &Path) -> Result<Size, CaptureError> {
    let bytes = read(path)?;
    let (decoder, size) = open(path, &bytes)?;
    check_depth_type(path, decoder.color_type())?;
    Ok(size)
}

fn check_depth_type(path: &Path, found: ColorType) -> Result<(), CaptureError> {
    if found == ColorType::L16 {
        return Ok(());
    }
    let problem = format!("depth must be a 16-bit grey picture, this is {found:?}");
    Err(CaptureError::file(path, problem))
}

fn read(path: &Path) -> Result<Vec<u8>, CaptureError> {
    let io = |e| CaptureError::io(path, e);
    let meta = std::fs::metadata(path).map_err(io)?;
    if !meta.is_file() || meta.len() > MAX_FILE_BYTES {
        return Err(CaptureError::file(path, "not a picture file of reasonable length"));
    }
    std::fs::read(path).map_err(io)
}

fn guess(path: &Path, bytes: &[u8]) -> Result<ImageFormat, CaptureError> {
    image::guess_format(bytes).map_err(|e| CaptureError::file(path, e.to_string()))
}

fn open<'a>(path: &Path, bytes: &'a [u8]) -> Result<(impl ImageDecoder + 'a, Size), CaptureError> {
    let format = guess(path, bytes)?;
    if !matches!(format, ImageFormat::Png | ImageFormat::Jpeg) {
        return Err(CaptureError::file(
            path,
            format!("{format:?} pictures are not read; use PNG or JPEG"),
        ));
    }
    decoder(bytes, format).map_err(|problem| CaptureError::file(path, problem))
}

fn decoder(bytes: &[u8], format: ImageFormat) -> Result<(impl ImageDecoder + '_, Size), String> {
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let mut limits = image::Limits::default();
    limits.max_alloc = Some(MAX_PIXELS as u64 * 8);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|e| e.to_string())?;
    let (width, height) = decoder.dimensions();
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || pixels > MAX_PIXELS as u64 {
        return Err(format!("{width}x{height} pixels; at most {MAX_PIXELS} are read"));
    }
    Ok((decoder, Size::new(width as usize, height as usize)))
}

fn decode(path: &Path, decoder: impl ImageDecoder) -> Result<DynamicImage, CaptureError> {
    DynamicImage::from_decoder(decoder).map_err(|e| CaptureError::file(path, e.to_string()))
}

/// JPEG decoders fill what is missing at the end with grey; a cut file shows by its end marker only.
/// Cameras may append a few bytes after it.
pub(super) fn ends_as_jpeg(bytes: &[u8]) -> bool {
    let tail = &bytes[bytes.len().saturating_sub(1024)..];
    tail.windows(2).any(|w| w == [0xff, 0xd9])
}
