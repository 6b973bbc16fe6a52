//! Pictures as cameras put them into bytes: packed and planar YCbCr, RGB, motion JPEG. Lengths are checked
//! before a byte is read.

mod mjpeg;
mod rows;
#[cfg(test)]
mod tests;

pub(super) use rows::Rows;

use super::MAX_PIXELS;
use crate::image::{Image, Size};
use kornia_image::ImageSize;
use kornia_imgproc::color::{rgb_from_nv12, rgb_from_uyvy, rgb_from_yuyv};
use std::fmt;

/// Formats that are read. YCbCr is that of BT.601 with 16..235 for luma, as cameras give it; the JPEG files'
/// full range in motion JPEG.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PixelFormat {
    Rgb24,
    Bgr24,
    /// 4:2:2 in one plane: Y0 Cb Y1 Cr.
    Yuyv,
    /// 4:2:2 in one plane: Cb Y0 Cr Y1.
    Uyvy,
    /// 4:2:0: a plane of Y, then one of Cb Cr with rows as far apart.
    Nv12,
    /// A JPEG for each picture, with or without its Huffman tables.
    Mjpeg,
}

impl PixelFormat {
    /// The better first, where size and rate are the same: full chroma, then half of it, then a quarter, then
    /// what was compressed.
    pub const ALL: [Self; 6] =
        [Self::Rgb24, Self::Bgr24, Self::Yuyv, Self::Uyvy, Self::Nv12, Self::Mjpeg];

    /// The four letters that V4L2 has for it.
    pub const fn fourcc(self) -> [u8; 4] {
        *match self {
            Self::Rgb24 => b"RGB3",
            Self::Bgr24 => b"BGR3",
            Self::Yuyv => b"YUYV",
            Self::Uyvy => b"UYVY",
            Self::Nv12 => b"NV12",
            Self::Mjpeg => b"MJPG",
        }
    }

    pub fn from_fourcc(fourcc: [u8; 4]) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.fourcc() == fourcc)
    }

    /// Whether its values are YCbCr without a standard of their own.
    pub const fn is_ycbcr(self) -> bool {
        matches!(self, Self::Yuyv | Self::Uyvy | Self::Nv12)
    }

    /// Bytes of a row without padding; 0 of compressed pictures.
    const fn row_bytes(self, width: usize) -> usize {
        match self {
            Self::Rgb24 | Self::Bgr24 => 3 * width,
            Self::Yuyv | Self::Uyvy => 2 * width,
            Self::Nv12 => width,
            Self::Mjpeg => 0,
        }
    }

    /// Rows of a picture, those of its chroma included.
    const fn row_count(self, height: usize) -> usize {
        match self {
            Self::Nv12 => height + height / 2,
            _ => height,
        }
    }
}

impl fmt::Display for PixelFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&String::from_utf8_lossy(&self.fourcc()))
    }
}

type KorniaColor = kornia_image::Image<u8, 3>;

/// Makes pictures of the bytes of one camera in one mode.
pub struct Unpacker {
    format: PixelFormat,
    size: Size,
    /// From the start of a row to the next.
    stride: usize,
    /// Rows without what pads them, where that must go.
    packed: Vec<u8>,
    /// Of YCbCr.
    converted: Option<KorniaColor>,
}

impl Unpacker {
    /// `stride` is in bytes from row to row; 0 where rows are not padded, and of no concern for motion JPEG.
    ///
    /// # Errors
    /// No picture can be of this size, or rows do not fit the stride.
    pub fn new(format: PixelFormat, size: Size, stride: usize) -> Result<Self, String> {
        let Size { width, height } = size;
        if !width.checked_mul(height).is_some_and(|pixels| (1..=MAX_PIXELS).contains(&pixels)) {
            return Err(format!("pictures of {size}; at most {MAX_PIXELS} pixels are read"));
        }
        let odd = match format {
            PixelFormat::Yuyv | PixelFormat::Uyvy => width % 2 == 1,
            PixelFormat::Nv12 => width % 2 == 1 || height % 2 == 1,
            _ => false,
        };
        if odd {
            return Err(format!("{format} of {size}: its pixels share chroma in pairs"));
        }
        let row = format.row_bytes(width);
        let stride = if stride == 0 { row } else { stride };
        if stride < row {
            return Err(format!("{format} rows of {row} bytes cannot be {stride} bytes apart"));
        }
        let converted = match format.is_ycbcr() {
            true => Some(KorniaColor::from_size_val(ImageSize { width, height }, 0)),
            false => None,
        };
        let converted = converted.transpose().map_err(|e| e.to_string())?;
        Ok(Self { format, size, stride, packed: Vec::new(), converted })
    }

    /// 8-bit sRGB.
    ///
    /// # Errors
    /// Bytes are missing, or are no picture of this format and size.
    pub fn picture(&mut self, bytes: &[u8]) -> Result<Image<[u8; 3]>, String> {
        let row = self.format.row_bytes(self.size.width);
        let rows = Rows { row, count: self.format.row_count(self.size.height) };
        match self.format {
            PixelFormat::Mjpeg => mjpeg::decode(bytes, self.size),
            PixelFormat::Rgb24 | PixelFormat::Bgr24 => {
                let mut pixels = Vec::with_capacity(self.size.pixels());
                for row in rows.of(bytes, self.stride)? {
                    pixels.extend_from_slice(row.as_chunks::<3>().0);
                }
                if self.format == PixelFormat::Bgr24 {
                    pixels.iter_mut().for_each(|pixel| pixel.reverse());
                }
                Ok(Image::from_vec(self.size, pixels))
            }
            PixelFormat::Yuyv | PixelFormat::Uyvy | PixelFormat::Nv12 => {
                let found = rows.of(bytes, self.stride)?;
                let packed = if self.stride == row {
                    &bytes[..row * rows.count]
                } else {
                    self.packed.clear();
                    found.for_each(|row| self.packed.extend_from_slice(row));
                    &self.packed
                };
                // Made together with the format.
                let Some(out) = &mut self.converted else { return Err("not YCbCr".into()) };
                match self.format {
                    PixelFormat::Yuyv => rgb_from_yuyv(packed, out),
                    PixelFormat::Uyvy => rgb_from_uyvy(packed, out),
                    _ => rgb_from_nv12(packed, out),
                }
                .map_err(|e| e.to_string())?;
                Ok(Image::from_vec(self.size, out.as_slice().as_chunks::<3>().0.to_vec()))
            }
        }
    }
}
