use super::*;
use crate::math::random::Rng;
use image::codecs::jpeg::JpegEncoder;

/// BT.601 with luma 16..235 and chroma 16..240, in f64, before rounding. Luma below black is black.
fn rgb_f64(y: u8, cb: u8, cr: u8) -> [f64; 3] {
    let y = 255.0 / 219.0 * (f64::from(y) - 16.0).max(0.0);
    let [cb, cr] = [cb, cr].map(|c| (f64::from(c) - 128.0) * 255.0 / 224.0);
    let (kr, kb) = (0.299, 0.114);
    let [to_red, to_blue] = [2.0 * (1.0 - kr) * cr, 2.0 * (1.0 - kb) * cb];
    let to_green = -(kr * to_red + kb * to_blue) / (1.0 - kr - kb);
    [to_red, to_green, to_blue].map(|c| (y + c).clamp(0.0, 255.0))
}

/// The picture of these YCbCr pixels in a format, rows `stride` bytes apart and filled up with `pad`.
fn ycbcr_bytes(format: PixelFormat, pixels: &Image<[u8; 3]>, stride: usize, pad: u8) -> Vec<u8> {
    let Size { width, height } = pixels.size();
    let mut bytes = Vec::new();
    let mut push = |row: Vec<u8>| {
        let end = bytes.len() + stride;
        bytes.extend(row);
        bytes.resize(end, pad);
    };
    let pairs = |y: usize| (0..width).step_by(2).map(move |x| (x, y));
    for y in 0..height {
        let luma = |x: usize| pixels[(x, y)][0];
        let [_, cb, cr] = [0, 1, 2].map(|c| move |(x, y)| pixels[(x, y)][c]);
        push(match format {
            PixelFormat::Yuyv => {
                pairs(y).flat_map(|p| [luma(p.0), cb(p), luma(p.0 + 1), cr(p)]).collect()
            }
            PixelFormat::Uyvy => {
                pairs(y).flat_map(|p| [cb(p), luma(p.0), cr(p), luma(p.0 + 1)]).collect()
            }
            _ => (0..width).map(luma).collect(),
        });
    }
    if format == PixelFormat::Nv12 {
        for y in (0..height).step_by(2) {
            push(pairs(y).flat_map(|(x, y)| [pixels[(x, y)][1], pixels[(x, y)][2]]).collect());
        }
    }
    bytes
}

/// Noise whose chroma is the same in blocks of 2x2.
fn noise(size: Size) -> Image<[u8; 3]> {
    let mut rng = Rng::new(&[7]);
    let mut pixels = Image::new(size, [0; 3]);
    pixels.as_mut_slice().iter_mut().for_each(|p| {
        let [y, cb, cr, _] = rng.next_u32().to_le_bytes();
        *p = [y, cb, cr];
    });
    for y in 0..size.height {
        for x in 0..size.width {
            let [_, cb, cr] = pixels[(x / 2 * 2, y / 2 * 2)];
            pixels[(x, y)] = [pixels[(x, y)][0], cb, cr];
        }
    }
    pixels
}

const YCBCR: [PixelFormat; 3] = [PixelFormat::Yuyv, PixelFormat::Uyvy, PixelFormat::Nv12];

/// The coefficients of the conversion have three decimals: 1.164 for 255/219 and so on. Over all codes that
/// moves a channel by 0.20 of a code at most (measured), and rounding to codes by 0.5.
const CONVERSION: f64 = 0.70;

#[test]
fn every_code_of_ycbcr_is_within_a_code_of_bt_601() {
    // A picture for each Cb: luma along rows, Cr from row to row.
    let size = Size::new(256, 256);
    let mut unpacker = Unpacker::new(PixelFormat::Yuyv, size, 0).unwrap();
    let mut worst = 0.0f64;
    for cb in 0..=255 {
        let pixels = (0..size.pixels()).map(|i| [(i % 256) as u8, cb, (i / 256) as u8]).collect();
        let pixels = Image::from_vec(size, pixels);
        let bytes = ycbcr_bytes(PixelFormat::Yuyv, &pixels, 512, 0);
        let found = unpacker.picture(&bytes).unwrap();
        for (found, &[y, cb, cr]) in found.as_slice().iter().zip(pixels.as_slice()) {
            for (found, expected) in found.iter().zip(rgb_f64(y, cb, cr)) {
                worst = worst.max((f64::from(*found) - expected).abs());
            }
        }
    }
    assert!(worst <= CONVERSION, "{worst}");
    assert!(worst > 0.5, "rounding alone: {worst}");
}

#[test]
fn extremes_of_ycbcr() {
    let size = Size::new(2, 2);
    let at = |ycbcr| {
        let bytes = ycbcr_bytes(PixelFormat::Nv12, &Image::new(size, ycbcr), 2, 0);
        Unpacker::new(PixelFormat::Nv12, size, 0).unwrap().picture(&bytes).unwrap()[(1, 1)]
    };
    assert_eq!(at([16, 128, 128]), [0; 3]);
    assert_eq!(at([235, 128, 128]), [255; 3]);
    assert_eq!(at([0, 128, 128]), [0; 3]);
    assert_eq!(at([255, 128, 128]), [255; 3]);
    // the primaries of the standard, rounded to codes
    assert_eq!(at([81, 90, 240]), [254, 0, 0]);
    assert_eq!(at([41, 240, 110]), [0, 0, 255]);
    assert_eq!(at([255, 255, 255]), [255, 125, 255]);
    assert_eq!(at([0, 0, 0]), [0, 154, 0]);
}

#[test]
fn rows_with_any_padding_give_the_same_picture() {
    let size = Size::new(38, 14);
    let pixels = noise(size);
    for format in YCBCR {
        let row = format.row_bytes(size.width);
        let picture = |stride: usize, pad| {
            let bytes = ycbcr_bytes(format, &pixels, stride, pad);
            let mut unpacker = Unpacker::new(format, size, stride).unwrap();
            // once more: what is kept from picture to picture must not show
            unpacker.picture(&vec![200; bytes.len()]).unwrap();
            unpacker.picture(&bytes).unwrap()
        };
        let tight = picture(row, 0);
        for (found, &[y, cb, cr]) in tight.as_slice().iter().zip(pixels.as_slice()) {
            for (found, expected) in found.iter().zip(rgb_f64(y, cb, cr)) {
                assert!((f64::from(*found) - expected).abs() <= CONVERSION, "{format}");
            }
        }
        for stride in [row + 1, row + 2, row + 37] {
            assert_eq!(picture(stride, 255), tight, "{format}, {stride} bytes from row to row");
        }
    }
    let rgb = Image::from_vec(Size::new(3, 2), (0..6).map(|i| [i, 50 + i, 100 + i]).collect());
    let bytes = |stride: usize| {
        let mut bytes = Vec::new();
        for y in 0..2 {
            bytes.extend_from_slice(rgb.row(y).as_flattened());
            bytes.resize((y + 1) * stride, 9);
        }
        bytes
    };
    for stride in [9, 10, 16] {
        let mut unpacker = Unpacker::new(PixelFormat::Rgb24, rgb.size(), stride).unwrap();
        assert_eq!(unpacker.picture(&bytes(stride)).unwrap(), rgb);
        let mut unpacker = Unpacker::new(PixelFormat::Bgr24, rgb.size(), stride).unwrap();
        let turned = unpacker.picture(&bytes(stride)).unwrap();
        assert!(turned.as_slice().iter().zip(rgb.as_slice()).all(|(t, p)| {
            let [r, g, b] = *p;
            *t == [b, g, r]
        }));
    }
}

#[test]
fn half_a_frame_is_an_error_that_counts_its_bytes() {
    let size = Size::new(4, 2);
    for (format, stride, whole) in [
        (PixelFormat::Rgb24, 0, 24),
        (PixelFormat::Bgr24, 13, 25),
        (PixelFormat::Yuyv, 0, 16),
        (PixelFormat::Uyvy, 11, 19),
        (PixelFormat::Nv12, 0, 12),
        (PixelFormat::Nv12, 5, 14),
    ] {
        let mut unpacker = Unpacker::new(format, size, stride).unwrap();
        let buffer = vec![128; whole + 5];
        assert!(unpacker.picture(&buffer).is_ok() && unpacker.picture(&buffer[..whole]).is_ok());
        for bytes in [whole - 1, whole / 2, 0] {
            let error = unpacker.picture(&buffer[..bytes]).unwrap_err();
            assert_eq!(error, format!("{bytes} of {whole} bytes"), "{format}");
        }
    }
}

#[test]
fn sizes_that_no_picture_has_are_refused_before_memory_is_taken() {
    let new = |format, width, height, stride| {
        Unpacker::new(format, Size::new(width, height), stride).err().unwrap_or_default()
    };
    for format in PixelFormat::ALL {
        for (width, height) in [(0, 4), (4, 0), (1 << 20, 1 << 20), (usize::MAX, 2)] {
            assert!(new(format, width, height, 0).contains("at most"), "{format}");
        }
    }
    assert!(new(PixelFormat::Yuyv, 5, 4, 0).contains("share chroma"));
    assert!(new(PixelFormat::Nv12, 4, 5, 0).contains("share chroma"));
    assert_eq!(new(PixelFormat::Yuyv, 4, 5, 0), "");
    assert!(new(PixelFormat::Rgb24, 4, 4, 11).contains("12 bytes cannot be 11"));
}

#[test]
fn letters_are_those_of_v4l2_and_no_others() {
    for format in PixelFormat::ALL {
        assert_eq!(PixelFormat::from_fourcc(format.fourcc()), Some(format));
    }
    assert_eq!(PixelFormat::Mjpeg.to_string(), "MJPG");
    assert_eq!(PixelFormat::from_fourcc(*b"H264"), None);
}

/// A smooth picture as a JPEG, and the segments of its Huffman tables cut out of it.
fn jpegs(size: Size) -> [Vec<u8>; 2] {
    let pixels: Vec<u8> = (0..size.pixels())
        .flat_map(|i| [(i % size.width) as u8 * 3, (i / size.width) as u8 * 4, 90])
        .collect();
    let mut whole = Vec::new();
    let (width, height) = (size.width as u32, size.height as u32);
    JpegEncoder::new_with_quality(&mut whole, 90)
        .encode(&pixels, width, height, image::ExtendedColorType::Rgb8)
        .unwrap();
    let mut bare = Vec::new();
    let mut at = 2;
    bare.extend_from_slice(&whole[..2]);
    while whole[at + 1] != 0xda {
        let length = 2 + usize::from(u16::from_be_bytes([whole[at + 2], whole[at + 3]]));
        if whole[at + 1] != 0xc4 {
            bare.extend_from_slice(&whole[at..at + length]);
        }
        at += length;
    }
    bare.extend_from_slice(&whole[at..]);
    [whole, bare]
}

#[test]
fn motion_jpeg_decodes_with_and_without_its_tables() {
    let size = Size::new(64, 48);
    let [whole, bare] = jpegs(size);
    assert!(bare.len() + 400 < whole.len(), "{} of {}", bare.len(), whole.len());
    let mut unpacker = Unpacker::new(PixelFormat::Mjpeg, size, 0).unwrap();
    let picture = unpacker.picture(&whole).unwrap();
    assert_eq!(unpacker.picture(&bare).unwrap(), picture);
    // what some cameras leave behind the picture
    assert_eq!(unpacker.picture(&[&bare[..], &[0; 200]].concat()).unwrap(), picture);
    for (x, y) in [(5, 7), (40, 33)] {
        let expected = [x as u8 * 3, y as u8 * 4, 90];
        for (found, expected) in picture[(x, y)].iter().zip(expected) {
            // coarser quantisation than of a still, on a smooth picture
            assert!(found.abs_diff(expected) <= 6, "{:?} at {x},{y}", picture[(x, y)]);
        }
    }
}

#[test]
fn broken_motion_jpeg_is_an_error_and_says_its_bytes() {
    let size = Size::new(64, 48);
    let [whole, bare] = jpegs(size);
    let mut unpacker = Unpacker::new(PixelFormat::Mjpeg, size, 0).unwrap();
    let mut error = |bytes: &[u8]| unpacker.picture(bytes).unwrap_err();
    for jpeg in [&whole, &bare] {
        let half = &jpeg[..jpeg.len() - 300];
        assert!(error(half).contains(&format!("{} bytes is cut off", half.len())));
        for bytes in 0..jpeg.len() / 2 {
            assert!(!error(&jpeg[..bytes]).is_empty());
        }
    }
    assert!(error(&[7; 100]).contains("100 bytes that are no JPEG"));
    assert!(error(&[0xff; 100]).contains("no JPEG"));
    assert!(error(&[0xff, 0xd8, 0xff, 0xe0, 0, 4, 1, 2, 3, 4, 5, 6]).contains("marker at byte 8"));
    assert!(error(&jpegs(Size::new(32, 48))[0]).contains("32x48 among pictures of 64x48"));
}
