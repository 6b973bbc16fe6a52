use super::*;
use crate::math::random::Rng;

const SIZE: Size = Size::new(67, 43);

fn noise(seed: u32) -> Image<[u8; 3]> {
    let mut rng = Rng::new(&[seed]);
    let pixels = (0..SIZE.pixels()).map(|_| std::array::from_fn(|_| rng.next_u32() as u8));
    Image::from_vec(SIZE, pixels.collect())
}

fn grey(value: u8) -> Image<[u8; 3]> {
    Image::new(SIZE, [value; 3])
}

#[test]
fn psnr_of_known_errors() {
    let a = noise(1);
    assert_eq!(psnr_db(&a, &a).unwrap(), f64::INFINITY);
    // every channel off by 5: mse = 25
    let (a, b) = (grey(100), grey(105));
    let expected = 20.0 * (255.0f64 / 5.0).log10();
    assert!((psnr_db(&a, &b).unwrap() - expected).abs() < 1e-12);
    assert!((psnr_db(&grey(0), &grey(255)).unwrap()).abs() < 1e-12);
    // one channel of one pixel off by 255
    let mut c = a.clone();
    c[(66, 42)] = [100, 100, 255];
    let mse = 155.0f64.powi(2) / (3.0 * 67.0 * 43.0);
    assert!((psnr_db(&a, &c).unwrap() - 10.0 * (65025.0 / mse).log10()).abs() < 1e-10);
}

#[test]
fn ssim_in_closed_form() {
    let a = noise(2);
    // a * a / a * a in f64
    assert!((ssim(&a, &a).unwrap() - 1.0).abs() < 1e-12);
    // constants: only the luminance term is left
    let (x, y) = (60.0f64, 200.0);
    let c1 = 2.55f64.powi(2);
    let expected = (2.0 * x * y + c1) / (x * x + y * y + c1);
    // the variance of a constant is rounding of 200^2, against c2 = 58
    assert!((ssim(&grey(60), &grey(200)).unwrap() - expected).abs() < 1e-11);
}

#[test]
fn ssim_equals_the_windowed_definition() {
    let (a, b) = (noise(3), noise(4));
    let (la, lb) = (luma(&a), luma(&b));
    let weight = |i: usize| (-(i as f64 - 5.0).powi(2) / 4.5).exp();
    let norm: f64 = (0..11).map(weight).sum::<f64>().powi(2);
    let (c1, c2) = (6.5025, 58.5225);
    let mut sum = 0.0;
    for y in 0..SIZE.height - 10 {
        for x in 0..SIZE.width - 10 {
            let window = || (0..11).flat_map(|j| (0..11).map(move |i| (i, j)));
            let moment = |f: &dyn Fn(f64, f64) -> f64| {
                window()
                    .map(|(i, j)| {
                        let at = (x + i, y + j);
                        weight(i) * weight(j) / norm * f(la[at], lb[at])
                    })
                    .sum::<f64>()
            };
            let (ma, mb) = (moment(&|a, _| a), moment(&|_, b| b));
            let va = moment(&|a, _| (a - ma).powi(2));
            let vb = moment(&|_, b| (b - mb).powi(2));
            let cov = moment(&|a, b| (a - ma) * (b - mb));
            sum += (2.0 * ma * mb + c1) * (2.0 * cov + c2)
                / ((ma * ma + mb * mb + c1) * (va + vb + c2));
        }
    }
    let expected = sum / ((SIZE.width - 10) * (SIZE.height - 10)) as f64;
    let found = ssim(&a, &b).unwrap();
    assert!((found - expected).abs() < 1e-12, "{found} against {expected}");
    assert!((found - ssim(&b, &a).unwrap()).abs() < 1e-14, "symmetric");
    assert!(found < 0.1, "independent noise is not similar");
}

#[test]
fn relative_rmse_sees_the_mask_only() {
    let truth = Image::new(SIZE, [0.5f32, 0.25, 1.0]);
    let mut estimate = truth.clone();
    let mut mask = Image::new(SIZE, false);
    for x in 0..10 {
        estimate[(x, 7)] = [0.55, 0.275, 1.1];
        mask[(x, 7)] = true;
        estimate[(x, 8)] = [f32::NAN; 3]; // outside
    }
    let error = relative_rmse(&estimate, &truth, &mask).unwrap();
    assert!((error - 0.1).abs() < 1e-6, "{error}"); // f32 inputs
    assert!(relative_rmse(&estimate, &truth, &Image::new(SIZE, false)).is_err());
    assert!(relative_rmse(&estimate, &truth, &Image::new(SIZE, true)).is_err());

    let region = changed(&truth, &estimate, 0.02).unwrap();
    assert!((0..10).all(|x| region[(x, 7)]) && !region[(0, 6)]);
}

#[test]
fn sizes_are_checked() {
    let small = Image::new(Size::new(10, 43), [0u8; 3]);
    let message = psnr_db(&small, &grey(0)).unwrap_err().to_string();
    assert_eq!(message, "pictures of different size: 10x43 and 67x43");
    let message = ssim(&small, &small).unwrap_err().to_string();
    assert!(message.starts_with("a picture of 10x43 is smaller than the 11x11"), "{message}");
    let none = Image::new(Size::new(0, 0), [0u8; 3]);
    assert!(psnr_db(&none, &none).is_err());
}
