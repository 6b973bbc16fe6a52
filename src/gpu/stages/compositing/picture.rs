//! The display picture on the device, and its way back.

use crate::gpu::{Commands, Gpu, GpuBuffer, GpuError, ReadBack};
use crate::image::{Image, Size};

/// An 8-bit sRGB picture on the device.
pub struct GpuPicture {
    pub size: Size,
    /// Rows of three bytes a pixel, without padding, four bytes a word, as
    /// [`FramePictures::color_srgb`](crate::gpu::stages::FramePictures::color_srgb).
    pub bytes: GpuBuffer<u32>,
}

impl GpuPicture {
    /// Black.
    pub fn new(gpu: &Gpu, size: Size) -> Result<Self, GpuError> {
        Ok(Self { size, bytes: GpuBuffer::new(gpu, "display picture", words(size))? })
    }
}

/// Brings pictures of one size back, in the order of their requests.
pub struct PictureReadBack {
    size: Size,
    words: ReadBack<u32>,
}

impl PictureReadBack {
    pub fn new(gpu: &Gpu, size: Size) -> Result<Self, GpuError> {
        Ok(Self { size, words: ReadBack::new(gpu, "display picture", words(size))? })
    }

    /// Has `picture` copied when everything recorded so far is done; returns its bytes.
    ///
    /// # Panics
    /// If the sizes differ, or two copies are under way already.
    pub fn request(&mut self, commands: &mut Commands<'_>, picture: &GpuPicture) -> u64 {
        assert_eq!(picture.size, self.size, "size of the display picture");
        self.words.request(commands, &picture.bytes, words(self.size))
    }

    /// The oldest picture requested, once its commands have been submitted: waits for the device.
    /// `None` where nothing was requested.
    pub fn take(&mut self, gpu: &Gpu) -> Result<Option<Image<[u8; 3]>>, GpuError> {
        let words = self.words.take(gpu)?;
        Ok(words.map(|words| {
            let bytes: Vec<u8> = words.into_iter().flat_map(u32::to_le_bytes).collect();
            let (pixels, _) = bytes[..3 * self.size.pixels()].as_chunks::<3>();
            Image::from_vec(self.size, pixels.to_vec())
        }))
    }
}

fn words(size: Size) -> usize {
    (3 * size.pixels()).div_ceil(4)
}
