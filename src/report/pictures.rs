//! Pictures small enough to travel inside a page, as data URIs.

use super::sources::Problem;
use crate::image::encoded::{USUAL, decode_file};
use image::codecs::jpeg::JpegEncoder;
use image::imageops::{FilterType, resize};
use image::{Rgb, RgbImage};
use std::path::Path;

/// The pictures of one page: what they may still take, and which could not be read.
#[derive(Debug)]
pub(super) struct Pictures {
    /// Bytes of data URIs. A page of this size opens at once and passes as an attachment.
    left: usize,
    problems: Vec<Problem>,
}

impl Default for Pictures {
    fn default() -> Self {
        Self { left: 6 << 20, problems: Vec::new() }
    }
}

impl Pictures {
    /// Reads a picture of 8 bits, no wider than `width`. `None` where there is no such file; one that
    /// cannot be read becomes a problem.
    pub fn read(&mut self, path: &Path, width: u32) -> Option<RgbImage> {
        if !path.exists() {
            return None;
        }
        let picture = read(path, width);
        picture.map_err(|e| self.problem(path, &e)).ok()
    }

    fn problem(&mut self, path: &Path, problem: &str) {
        let problem = Problem { path: path.to_owned(), problem: problem.to_owned() };
        if !self.problems.contains(&problem) {
            self.problems.push(problem);
        }
    }

    /// Files that are there and could not be read.
    pub fn into_problems(self) -> Vec<Problem> {
        self.problems
    }

    /// Takes all of these from what is left, or nothing.
    pub fn take<'a>(&mut self, uris: impl IntoIterator<Item = &'a str>) -> bool {
        let bytes = uris.into_iter().map(str::len).sum();
        match self.left.checked_sub(bytes) {
            Some(left) => {
                self.left = left;
                true
            }
            None => false,
        }
    }
}

const QUALITY: u8 = 85;

fn read(path: &Path, width: u32) -> Result<RgbImage, String> {
    let picture = decode_file(path, USUAL)?.into_rgb8();
    if picture.width() <= width {
        return Ok(picture);
    }
    let scale = f64::from(width) / f64::from(picture.width());
    let height = ((f64::from(picture.height()) * scale).round() as u32).max(1);
    Ok(resize(&picture, width, height, FilterType::CatmullRom))
}

/// As a JPEG inside a URI. `None` for an empty picture.
pub(super) fn data_uri(picture: &RgbImage) -> Option<String> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, QUALITY).encode_image(picture).ok()?;
    Some(format!("data:image/jpeg;base64,{}", base64(&bytes)))
}

/// Differences of 1/4 of the range and more are the brightest.
const DIFFERENCE_GAIN: f64 = 4.0;

/// Where two pictures differ: the largest difference of the three channels, in encoded values, from
/// black over purple and orange to white. `None` where they are not of one size.
pub(super) fn difference(a: &RgbImage, b: &RgbImage) -> Option<RgbImage> {
    if a.dimensions() != b.dimensions() {
        return None;
    }
    let pixel = |(a, b): (&Rgb<u8>, &Rgb<u8>)| {
        let most = (0..3).map(|k| a[k].abs_diff(b[k])).max().unwrap_or(0);
        heat((DIFFERENCE_GAIN * f64::from(most) / 255.0).min(1.0))
    };
    let pixels: Vec<u8> = a.pixels().zip(b.pixels()).flat_map(pixel).collect();
    RgbImage::from_raw(a.width(), a.height(), pixels)
}

/// Black, purple, orange, pale yellow: lighter for larger, so that it reads without colour too.
fn heat(share: f64) -> [u8; 3] {
    const STOPS: [[f64; 3]; 4] =
        [[0.0, 0.0, 8.0], [110.0, 28.0, 110.0], [240.0, 110.0, 40.0], [252.0, 252.0, 190.0]];
    let position = share.clamp(0.0, 1.0) * (STOPS.len() - 1) as f64;
    let below = (position as usize).min(STOPS.len() - 2);
    let part = position - below as f64;
    std::array::from_fn(|k| {
        (STOPS[below][k] + part * (STOPS[below + 1][k] - STOPS[below][k])).round() as u8
    })
}

fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let mut group = [0; 3];
        group[..chunk.len()].copy_from_slice(chunk);
        let bits = u32::from_be_bytes([0, group[0], group[1], group[2]]);
        for i in 0..4 {
            let digit = DIGITS[(bits >> (18 - 6 * i)) as usize & 63];
            out.push(if i <= chunk.len() { digit as char } else { '=' });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_that_of_rfc_4648() {
        let pairs = [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("foobar", "Zm9vYmFy"),
        ];
        for (plain, encoded) in pairs {
            assert_eq!(base64(plain.as_bytes()), encoded);
        }
        assert_eq!(base64(&[0xff, 0xfe, 0xfd]), "//79");
    }

    #[test]
    fn differences_are_shown_where_they_are() {
        let a = RgbImage::from_pixel(4, 2, Rgb([100, 100, 100]));
        let mut b = a.clone();
        b.put_pixel(2, 1, Rgb([100, 180, 100]));
        let map = difference(&a, &b).unwrap();
        assert_eq!(map.get_pixel(2, 1).0, heat(1.0));
        assert_eq!(map.get_pixel(0, 0).0, heat(0.0));
        assert!(difference(&a, &RgbImage::new(2, 2)).is_none());
        let luminance = |share| heat(share).iter().map(|&v| u32::from(v)).sum::<u32>();
        assert!(
            (0..20).all(|i| luminance(f64::from(i) / 20.0) < luminance(f64::from(i + 1) / 20.0))
        );
    }

    #[test]
    fn pictures_shrink_and_bad_files_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        RgbImage::from_pixel(90, 30, Rgb([9, 200, 30])).save(&path).unwrap();
        let mut pictures = Pictures::default();
        let small = pictures.read(&path, 30).unwrap();
        assert_eq!(small.dimensions(), (30, 10));
        assert!(data_uri(&small).unwrap().starts_with("data:image/jpeg;base64,/9j/"));
        std::fs::write(&path, b"no picture").unwrap();
        assert_eq!(pictures.read(&folder.path().join("b.png"), 30), None, "not there");
        assert_eq!(pictures.read(&path, 30), None, "broken");
        assert_eq!(pictures.read(&path, 30), None, "asked for again");
        let problems = pictures.into_problems();
        assert_eq!(problems.len(), 1, "{problems:?}");
        assert!(problems[0].path == path && !problems[0].problem.is_empty());
    }

    #[test]
    fn the_page_takes_all_or_nothing() {
        let mut pictures = Pictures { left: 10, problems: vec![] };
        assert!(pictures.take(["1234", "567"]));
        assert!(!pictures.take(["12", "34"]));
        assert!(pictures.take(["123"]));
    }
}
