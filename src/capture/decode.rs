//! Pictures of recordings.

use super::CaptureError;
use crate::image::encoded::{self, USUAL};
use crate::image::{Image, Size};
use image::{ColorType, DynamicImage, ImageDecoder, ImageFormat};
use std::path::Path;

/// 8-bit sRGB. Grey pictures become RGB, alpha is dropped, 16-bit channels are rounded to 8.
pub(crate) fn color(path: &Path) -> Result<Image<[u8; 3]>, CaptureError> {
    color_of(&read(path)?).map_err(|p| CaptureError::file(path, p))
}

/// 16-bit grey, as stored.
pub(super) fn depth(path: &Path) -> Result<Image<u16>, CaptureError> {
    depth_of(&read(path)?).map_err(|p| CaptureError::file(path, p))
}

/// Size of a colour picture from its header.
pub(super) fn color_size(path: &Path) -> Result<Size, CaptureError> {
    let bytes = read(path)?;
    let opened = encoded::open(&bytes, USUAL).map_err(|p| CaptureError::file(path, p))?;
    Ok(opened.1)
}

/// Size of a depth picture from its header, which must say 16-bit grey.
pub(super) fn depth_size(path: &Path) -> Result<Size, CaptureError> {
    let bytes = read(path)?;
    let header = || {
        let (decoder, size) = encoded::open(&bytes, USUAL)?;
        check_depth_type(decoder.color_type())?;
        Ok(size)
    };
    header().map_err(|p: String| CaptureError::file(path, p))
}

pub(crate) fn color_of(bytes: &[u8]) -> Result<Image<[u8; 3]>, String> {
    let (decoder, size) = encoded::open(bytes, USUAL)?;
    if bytes.starts_with(&[0xff, 0xd8]) && !ends_as_jpeg(bytes) {
        return Err("JPEG is cut off: no end marker".into());
    }
    Ok(rgb(encoded::pixels(decoder)?, size))
}

/// 8-bit sRGB of a JPEG in memory, which must have this size and [an end](ends_as_jpeg).
pub(super) fn jpeg(bytes: &[u8], expected: Size) -> Result<Image<[u8; 3]>, String> {
    let (decoder, size) = encoded::open(bytes, &[ImageFormat::Jpeg])?;
    if size != expected {
        return Err(format!("a JPEG of {size} among pictures of {expected}"));
    }
    Ok(rgb(encoded::pixels(decoder)?, size))
}

fn rgb(picture: DynamicImage, size: Size) -> Image<[u8; 3]> {
    // The decoder's buffer has no rest: it holds 3 bytes for each pixel of its own size.
    Image::from_vec(size, picture.into_rgb8().into_raw().as_chunks::<3>().0.to_vec())
}

pub(crate) fn depth_of(bytes: &[u8]) -> Result<Image<u16>, String> {
    let (decoder, size) = encoded::open(bytes, USUAL)?;
    check_depth_type(decoder.color_type())?;
    Ok(Image::from_vec(size, encoded::pixels(decoder)?.into_luma16().into_raw()))
}

fn check_depth_type(found: ColorType) -> Result<(), String> {
    if found == ColorType::L16 {
        return Ok(());
    }
    Err(format!("depth must be a 16-bit grey picture, this is {found:?}"))
}

fn read(path: &Path) -> Result<Vec<u8>, CaptureError> {
    encoded::read(path).map_err(|e| CaptureError::io(path, e))
}

/// JPEG decoders fill what is missing at the end with grey; a cut file shows by its end marker only.
/// Cameras may append a few bytes after it.
pub(super) fn ends_as_jpeg(bytes: &[u8]) -> bool {
    let tail = &bytes[bytes.len().saturating_sub(1024)..];
    tail.windows(2).any(|w| w == [0xff, 0xd9])
}
