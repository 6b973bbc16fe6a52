use super::*;
use crate::math::random::hash;

const SIZE: Size = Size::new(96, 64);

fn picture(pixel: impl Fn(usize, usize) -> [u8; 3]) -> Image<[u8; 3]> {
    let pixels = (0..SIZE.pixels()).map(|i| pixel(i % SIZE.width, i / SIZE.width));
    Image::from_vec(SIZE, pixels.collect())
}

fn grey(value: u8) -> Image<[u8; 3]> {
    Image::new(SIZE, [value; 3])
}

fn noise(seed: u32, low: u32, range: u32) -> Image<[u8; 3]> {
    let value = |x: usize, y: usize, k: u32| {
        (low + hash(hash(seed * 3 + k) ^ (y * SIZE.width + x) as u32) % range) as u8
    };
    picture(|x, y| [0, 1, 2].map(|k| value(x, y, k)))
}

fn gradient(x: usize, y: usize) -> [u8; 3] {
    [40 + 2 * x as u8, 200 - x as u8, 60 + 2 * y as u8]
}

/// A soft shadow on a gradient.
fn shadow() -> Image<[u8; 3]> {
    picture(|x, y| {
        let d2 = (x as i32 - 50).pow(2) + (y as i32 - 30).pow(2);
        let keeps = (d2 + 300).min(900) as u32;
        gradient(x, y).map(|v| (u32::from(v) * keeps / 900) as u8)
    })
}

fn stripes(shift: usize) -> Image<[u8; 3]> {
    picture(|x, y| if (x + shift + y / 2) % 9 < 3 { [230, 220, 200] } else { [30, 25, 40] })
}

fn disc(inside: [u8; 3]) -> Image<[u8; 3]> {
    picture(|x, y| {
        let d2 = (x as i32 - 40).pow(2) + (y as i32 - 35).pow(2);
        if d2 < 400 { inside } else { [120, 130, 140] }
    })
}

/// Pairs, with the mean and the value at (41, 30) that the authors' program gives (nv-flip 0.1.2 at 67
/// pixels a degree).
type Pair = (&'static str, Image<[u8; 3]>, Image<[u8; 3]>, f64, f32);

fn pairs() -> Vec<Pair> {
    let plain = picture(gradient);
    vec![
        ("noise", noise(1, 0, 256), noise(2, 0, 256), 0.441168, 0.534525),
        ("grain", noise(3, 110, 20), noise(4, 110, 20), 0.072637, 0.087142),
        ("shadow", plain.clone(), shadow(), 0.199924, 0.877083),
        ("shift", stripes(0), stripes(1), 0.497608, 0.544021),
        ("colour", disc([220, 20, 30]), disc([20, 200, 40]), 0.236878, 0.970280),
        ("black and white", grey(0), grey(255), 0.967392, 0.967392),
        ("a grey step", grey(128), grey(132), 0.078696, 0.078696),
    ]
}

fn mean(map: &Image<f32>) -> f64 {
    map.as_slice().iter().map(|&v| f64::from(v)).sum::<f64>() / map.size().pixels() as f64
}

#[test]
fn agrees_with_the_authors_program() {
    for (name, reference, test, expected, pixel) in pairs() {
        let map = flip_map(&reference, &test, 67.0).unwrap();
        let (found, at) = (mean(&map), map[(41, 30)]);
        // they differ by up to 6e-6: f32 on both sides, and six digits kept
        assert!((found - expected).abs() < 2e-5, "{name}: {found} against {expected}");
        assert!((at - pixel).abs() < 2e-5, "{name}: {at} against {pixel}");
    }
}

#[test]
fn nothing_is_seen_between_equal_pictures_and_order_does_not_count() {
    for (name, reference, test, ..) in pairs() {
        assert_eq!(flip(&reference, &reference).unwrap(), 0.0, "{name}");
        assert_eq!(flip(&reference, &test).unwrap(), flip(&test, &reference).unwrap(), "{name}");
        let map = flip_map(&reference, &test, PIXELS_PER_DEGREE).unwrap();
        assert!(map.as_slice().iter().all(|v| (0.0..=1.0).contains(v)), "{name}");
    }
    assert!(flip(&grey(0), &grey(255)).unwrap() > 0.95);
}

#[test]
fn fine_patterns_fade_with_distance() {
    let (a, b) = (noise(1, 0, 256), noise(2, 0, 256));
    let at = |ppd: f64| mean(&flip_map(&a, &b, ppd).unwrap());
    assert!(at(20.0) > 1.2 * at(67.0), "{} {}", at(20.0), at(67.0));
}

#[test]
fn odd_sizes_and_bad_arguments() {
    let pixel = Image::new(Size::new(1, 1), [10, 200, 30]);
    assert_eq!(flip(&pixel, &pixel).unwrap(), 0.0);
    let line = |v: u8| Image::new(Size::new(3, 1), [v; 3]);
    assert!(flip(&line(0), &line(255)).unwrap() > 0.9);
    let none = Image::new(Size::new(0, 0), [0; 3]);
    assert!(flip(&none, &none).is_err() && flip(&pixel, &grey(1)).is_err());
    for ppd in [0.0, f64::NAN, f64::INFINITY, 1e9] {
        let message = flip_map(&pixel, &pixel, ppd).unwrap_err().to_string();
        assert!(message.contains("pixels a degree"), "{message}");
    }
}

#[test]
fn threads_do_not_matter() {
    let (a, b) = (noise(5, 0, 256), shadow());
    let map = || flip_map(&a, &b, PIXELS_PER_DEGREE).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(pool.install(map), map());
}
