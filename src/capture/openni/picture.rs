//! Frames of the library as pictures: checked before a byte is read.

use super::device_handle::FrameRef;
use super::ffi;
use crate::capture::live::DeviceError;
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
    let layout = Layout { row: size.width * pixel_bytes, height: size.height };
    layout.rows(frame.data(), header.stride).map_err(bad)
}

/// Bytes of a picture's row without padding, and rows.
#[derive(Clone, Copy)]
struct Layout {
    row: usize,
    height: usize,
}

impl Layout {
    fn rows(self, data: &[u8], stride: i32) -> Result<impl Iterator<Item = &[u8]>, String> {
        let Self { row, height } = self;
        let step = usize::try_from(stride).ok().filter(|&s| s >= row && s > 0);
        let step = step.ok_or_else(|| format!("rows {stride} bytes apart hold no {row} bytes"))?;
        // The last row needs no padding.
        let needed =
            height.checked_sub(1).map_or(0, |h| h.saturating_mul(step).saturating_add(row));
        if data.len() < needed {
            return Err(format!("{} of {needed} bytes", data.len()));
        }
        Ok(data.chunks(step).take(height).map(move |r| &r[..row]))
    }
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
    fn padding_is_skipped_and_short_data_are_refused() {
        let data: Vec<u8> = (0..14).collect();
        let layout = Layout { row: 4, height: 3 };
        let rows: Vec<_> = layout.rows(&data, 5).unwrap().map(<[u8]>::to_vec).collect();
        assert_eq!(rows, [[0, 1, 2, 3], [5, 6, 7, 8], [10, 11, 12, 13]]);
        let fails = |stride, bytes: usize, what: &str| {
            let error = layout.rows(&data[..bytes], stride).err().expect(what);
            assert!(error.contains(what), "{error}");
        };
        fails(5, 13, "13 of 14 bytes");
        fails(3, 14, "hold no 4 bytes");
        fails(-4, 14, "-4 bytes apart");
        fails(i32::MAX, 14, "14 of");
        let none = Layout { row: 4, height: 0 };
        assert_eq!(none.rows(&[], 4).unwrap().count(), 0);
    }

    #[test]
    fn mirroring_is_undone_row_by_row() {
        let mirrored = Image::from_vec(Size::new(3, 2), vec![3, 2, 1, 6, 5, 4]);
        assert_eq!(upright(mirrored, true).as_slice(), [1, 2, 3, 4, 5, 6]);
    }
}
