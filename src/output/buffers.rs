//! Viewable pictures of the pipeline's buffers.

use crate::geometry::Origin;
use crate::image::{Image, NormalImage};
use rayon::prelude::*;

/// Values shown as black and as white; what lies outside is clamped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    pub black: f32,
    pub white: f32,
}

impl Range {
    /// Smallest and largest finite value of an image for which `counts` holds; `None` where there
    /// is none.
    pub fn of(image: &Image<f32>, counts: impl Fn(f32) -> bool) -> Option<Self> {
        let values = image.as_slice().iter().copied().filter(|&v| v.is_finite() && counts(v));
        values.fold(None, |range, v| {
            let Range { black, white } = range.unwrap_or(Range { black: v, white: v });
            Some(Range { black: black.min(v), white: white.max(v) })
        })
    }

    /// Position of `value` in the range, 0 to 1; a range of no extent is all 1.
    fn position(self, value: f32) -> f32 {
        let extent = self.white - self.black;
        if extent == 0.0 { 1.0 } else { ((value - self.black) / extent).clamp(0.0, 1.0) }
    }
}

/// Near is white, far is dark grey, missing is black. Inverse depth, as disparity is what a sensor
/// measures: steps near the camera show.
pub fn depth_picture(depth_m: &Image<f32>, nearest_m: f32, farthest_m: f32) -> Image<[u8; 3]> {
    let range = Range { black: 1.0 / farthest_m, white: 1.0 / nearest_m };
    map(depth_m, |depth| {
        let there = depth > 0.0 && depth.is_finite();
        let grey = if there { 40.0 + 215.0 * range.position(1.0 / depth) } else { 0.0 };
        [(grey + 0.5) as u8; 3]
    })
}

/// World axes x, y, z as red, green, blue: -1 is 0, +1 is 255. Missing is black.
pub fn normal_picture(normals: &NormalImage) -> Image<[u8; 3]> {
    let planes = [&normals.x, &normals.y, &normals.z].map(|plane| plane.as_slice());
    let code = |v: f32| (v.clamp(-1.0, 1.0) * 127.5 + 128.0) as u8;
    let pixel = |i: usize| {
        let n = planes.map(|plane| plane[i]);
        if n == [0.0; 3] { [0; 3] } else { n.map(code) }
    };
    Image::from_vec(normals.size(), (0..planes[0].len()).into_par_iter().map(pixel).collect())
}

/// Model is blue, sensor orange, virtual objects magenta, nothing black.
pub fn origin_picture(origin: &Image<Origin>) -> Image<[u8; 3]> {
    map(origin, |origin| match origin {
        Origin::None => [0, 0, 0],
        Origin::Model => [66, 113, 180],
        Origin::Sensor => [240, 150, 50],
        Origin::Virtual => [200, 60, 160],
    })
}

/// Any values as grey, linear from `range.black` to `range.white`. Values that are not finite are
/// red.
pub fn value_picture(values: &Image<f32>, range: Range) -> Image<[u8; 3]> {
    map(values, |value| {
        if value.is_finite() {
            [(range.position(value) * 255.0 + 0.5) as u8; 3]
        } else {
            [255, 0, 0]
        }
    })
}

fn map<T: Copy + Sync>(image: &Image<T>, pixel: impl Fn(T) -> [u8; 3] + Sync) -> Image<[u8; 3]> {
    let pixels = image.as_slice().par_iter().map(|&value| pixel(value));
    Image::from_vec(image.size(), pixels.collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Size;

    fn row(values: &[f32]) -> Image<f32> {
        Image::from_vec(Size::new(values.len(), 1), values.to_vec())
    }

    fn greys(image: &Image<[u8; 3]>) -> Vec<u8> {
        assert!(image.as_slice().iter().all(|[r, g, b]| r == g && g == b));
        image.as_slice().iter().map(|p| p[0]).collect()
    }

    #[test]
    fn near_is_bright_and_missing_black() {
        let depth = row(&[0.5, 0.2, 4.0, 9.0, 0.0, f32::NAN, -1.0, f32::INFINITY, 1.0]);
        let picture = depth_picture(&depth, 0.5, 4.0);
        // 1/1 m is 3/7 of the way from 1/4 to 1/0.5: 40 + 215 * 0.75 / 1.75 = 132.1
        assert_eq!(greys(&picture), [255, 255, 40, 40, 0, 0, 0, 0, 132]);
    }

    #[test]
    fn normals_show_their_axes() {
        let mut normals = NormalImage::new(Size::new(3, 1));
        normals.set(0, 0, glam::Vec3::Z);
        normals.set(1, 0, -glam::Vec3::X);
        let picture = normal_picture(&normals);
        assert_eq!(picture.as_slice(), [[128, 128, 255], [0, 128, 128], [0, 0, 0]]);
    }

    #[test]
    fn values_are_spread_over_their_range() {
        let values = row(&[-2.0, 0.0, 2.0, f32::NAN, 6.0]);
        let range = Range::of(&values, |_| true).unwrap();
        assert_eq!(range, Range { black: -2.0, white: 6.0 });
        let picture = value_picture(&values, range);
        assert_eq!(picture[(3, 0)], [255, 0, 0]);
        assert_eq!([0, 1, 2, 4].map(|x| picture[(x, 0)][0]), [0, 64, 128, 255]);
        assert_eq!(Range::of(&values, |v| v > 10.0), None);
        let flat = Range { black: 1.0, white: 1.0 };
        assert_eq!(greys(&value_picture(&row(&[1.0, 0.0]), flat)), [255, 255]);
    }

    #[test]
    fn origins_have_four_colours() {
        let all = [Origin::None, Origin::Model, Origin::Sensor, Origin::Virtual];
        let picture = origin_picture(&Image::from_vec(Size::new(4, 1), all.to_vec()));
        let mut colours = picture.into_vec();
        colours.dedup();
        assert_eq!(colours.len(), 4);
    }
}
