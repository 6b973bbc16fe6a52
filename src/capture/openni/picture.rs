//! Frames of the library as pictures: checked before a byte is read.

use super::device_handle::FrameRef;
use super::ffi;
use crate::capture::live::DeviceError;
use crate::capture::pixel_formats::Rows;
use crate::image::{Image, Size};

/// Depth as stored, in the stream's unit.
pub fn depth(frame: &FrameRef, size: Size, mirrored: bool) -> Result<Image<u16>, DeviceError> {
    let bytes = rows(frame, size, &[ffi::DEPTH_1_MM, ffi::DEPTH_100_UM], 2)?;
    let mut picture = Vec::with_capacity(size.pixels());
    for row in bytes {
        picture.extend(row.chunks_exact(2).map(|b| u16::from_ne_bytes([b[0], b[1]])));
    }
    Ok(upright(Image::from_vec(size, picture), mirrored))
}

/// 8-bit sRGB.
pub fn color(frame: &FrameRef, size: Size, mirrored: bool) -> Result<Image<[u8; 3]>, DeviceError> {
    let bytes = rows(frame, size, &[ffi::RGB888], 3)?;
    let mut picture = Vec::with_capacity(size.pixels());
    for row in bytes {
        picture.extend_from_slice(row.as_chunks::<3>().0);
    }
    Ok(upright(Image::from_vec(size, picture), mirrored))
}

/// The bytes of each row, without what pads it.
fn rows<'f>(
    frame: &'f FrameRef,
    size: Size,
    formats: &[i32],
    pixel_bytes: usize,
) -> Result<impl Iterator<Item = &'f [u8]>, DeviceError> {
    let header = frame.header();
    let bad = |what: String| DeviceError::BadFrame(format!("frame {}: {what}", header.index));
    if !formats.contains(&header.mode.pixel_format) {
        return Err(bad(format!("pixel format {}", header.mode.pixel_format)));
    }
    if (header.width, header.height) != (size.width as i32, size.height as i32) {
        return Err(bad(format!("{}x{} in a stream of {size}", header.width, header.height)));
    }
    let rows = Rows { row: size.width * pixel_bytes, count: size.height };
    let stride = usize::try_from(header.stride)
        .map_err(|_| bad(format!("rows {} bytes apart", header.stride)))?;
    rows.of(frame.data(), stride).map_err(bad)
}

fn upright<T: Clone + Send + Sync>(mut picture: Image<T>, mirrored: bool) -> Image<T> {
    if mirrored {
        for y in 0..picture.height() {
            picture.row_mut(y).reverse();
        }
    }
    picture
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mirroring_is_undone_row_by_row() {
        let mirrored = Image::from_vec(Size::new(3, 2), vec![3, 2, 1, 6, 5, 4]);
        assert_eq!(upright(mirrored, true).as_slice(), [1, 2, 3, 4, 5, 6]);
    }
}
