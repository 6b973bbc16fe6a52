//! Row-major images. Integer pixel coordinates are pixel centres.

pub(crate) mod encoded;

pub use encoded::MAX_PIXELS;
use rayon::prelude::*;
use std::ops::{Index, IndexMut};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Size {
    pub width: usize,
    pub height: usize,
}

impl Size {
    pub const fn new(width: usize, height: usize) -> Self {
        Self { width, height }
    }

    pub const fn pixels(self) -> usize {
        self.width * self.height
    }
}

impl std::fmt::Display for Size {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}

/// `height` rows of `width` values, without padding.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Image<T> {
    size: Size,
    data: Vec<T>,
}

impl<T> Image<T> {
    /// Takes `data` as rows of `size.width`. Panics where the length does not fit the size:
    /// readers check sizes at the door.
    pub fn from_vec(size: Size, data: Vec<T>) -> Self {
        assert_eq!(data.len(), size.pixels(), "image data for {size}");
        Self { size, data }
    }

    pub fn size(&self) -> Size {
        self.size
    }

    pub fn width(&self) -> usize {
        self.size.width
    }

    pub fn height(&self) -> usize {
        self.size.height
    }

    pub fn as_slice(&self) -> &[T] {
        &self.data
    }

    pub fn as_mut_slice(&mut self) -> &mut [T] {
        &mut self.data
    }

    pub fn row(&self, y: usize) -> &[T] {
        &self.data[y * self.size.width..(y + 1) * self.size.width]
    }

    pub fn row_mut(&mut self, y: usize) -> &mut [T] {
        &mut self.data[y * self.size.width..(y + 1) * self.size.width]
    }

    pub fn get(&self, x: usize, y: usize) -> Option<&T> {
        (x < self.size.width && y < self.size.height).then(|| &self.data[y * self.size.width + x])
    }

    pub fn into_vec(self) -> Vec<T> {
        self.data
    }
}

impl<T: Clone> Image<T> {
    pub fn new(size: Size, value: T) -> Self {
        Self { size, data: vec![value; size.pixels()] }
    }

    /// Gives the image this size; keeps its memory where it already fits. Contents are unspecified
    /// after a change of size.
    pub fn reshape(&mut self, size: Size, value: T) {
        if self.size != size {
            self.data.resize(size.pixels(), value);
            self.size = size;
        }
    }

    pub fn fill(&mut self, value: T) {
        self.data.fill(value);
    }
}

impl<T: Copy> Image<T> {
    /// The value at the nearest pixel inside the image.
    pub fn clamped(&self, x: isize, y: isize) -> T {
        let x = x.clamp(0, self.size.width as isize - 1) as usize;
        let y = y.clamp(0, self.size.height as isize - 1) as usize;
        self.data[y * self.size.width + x]
    }
}

impl<T: Send + Sync> Image<T> {
    /// Rows with their index, in parallel. Each row is written by one thread, so results do not
    /// depend on the number of threads.
    pub fn par_rows_mut(&mut self) -> impl IndexedParallelIterator<Item = (usize, &mut [T])> {
        self.data.par_chunks_mut(self.size.width.max(1)).enumerate()
    }
}

impl<T> Index<(usize, usize)> for Image<T> {
    type Output = T;

    fn index(&self, (x, y): (usize, usize)) -> &T {
        assert!(x < self.size.width, "column {x} of {}", self.size);
        &self.data[y * self.size.width + x]
    }
}

impl<T> IndexMut<(usize, usize)> for Image<T> {
    fn index_mut(&mut self, (x, y): (usize, usize)) -> &mut T {
        assert!(x < self.size.width, "column {x} of {}", self.size);
        &mut self.data[y * self.size.width + x]
    }
}

/// Unit vectors as three planes; zero where there is none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NormalImage {
    pub x: Image<f32>,
    pub y: Image<f32>,
    pub z: Image<f32>,
}

impl NormalImage {
    pub fn new(size: Size) -> Self {
        let zero = Image::new(size, 0.0);
        Self { x: zero.clone(), y: zero.clone(), z: zero }
    }

    pub fn size(&self) -> Size {
        self.x.size()
    }

    pub fn reshape(&mut self, size: Size) {
        self.x.reshape(size, 0.0);
        self.y.reshape(size, 0.0);
        self.z.reshape(size, 0.0);
    }

    pub fn at(&self, x: usize, y: usize) -> glam::Vec3 {
        glam::Vec3::new(self.x[(x, y)], self.y[(x, y)], self.z[(x, y)])
    }

    pub fn set(&mut self, x: usize, y: usize, normal: glam::Vec3) {
        self.x[(x, y)] = normal.x;
        self.y[(x, y)] = normal.y;
        self.z[(x, y)] = normal.z;
    }
}
