//! The Input stage: a raw frame becomes linear light, noise-filtered, with sane depth.

use super::{ColorFilter, InputParams, RawFrame, RgbdFrame};
use crate::image::Image;
use crate::math::color::{LINEAR_FROM_SRGB8, luminance, srgb_from_linear};
use std::sync::LazyLock;

/// Keeps its buffers from frame to frame: nothing is allocated once the size is known.
#[derive(Clone, Debug)]
pub struct InputStage {
    params: InputParams,
    linear: Image<[f32; 3]>,
    median: Image<[u8; 3]>,
}

impl InputStage {
    pub fn new(params: &InputParams) -> Self {
        Self { params: params.clone(), linear: Image::default(), median: Image::default() }
    }

    /// Moves the pictures of `raw` into `out` and adds filtered linear colour and intensity. Depth that
    /// is not finite or outside the range of the parameters becomes missing.
    pub fn prepare(&mut self, raw: RawFrame, out: &mut RgbdFrame) {
        out.index = raw.index;
        out.timestamp_s = raw.timestamp_s;
        out.world_from_camera = raw.world_from_camera;
        out.color_srgb = raw.color;
        out.depth_m = raw.depth_m;
        let (min, max) = (self.params.min_depth_m, self.params.max_depth_m);
        out.depth_m.par_rows_mut_each(|_, row| sanitise_row(row, min, max));

        let size = out.color_srgb.size();
        out.color.reshape(size, [0.0; 3]);
        out.intensity.reshape(size, 0.0);
        match self.params.color_filter {
            ColorFilter::None => linearise(&out.color_srgb, &mut out.color),
            ColorFilter::Gaussian => {
                self.linear.reshape(size, [0.0; 3]);
                linearise(&out.color_srgb, &mut self.linear);
                gaussian(&self.linear, &mut out.color);
            }
            ColorFilter::Median => {
                self.median.reshape(size, [0; 3]);
                median(&out.color_srgb, &mut self.median);
                linearise(&self.median, &mut out.color);
            }
        }
        let color = &out.color;
        let table: &[f32] = &*STEPS_FROM_ROOT;
        out.intensity.par_rows_mut_each(|y, row| intensity_row(color.row(y), table, row));
    }
}

/// Rows in parallel, several to a task: a row of 640 pixels takes about a microsecond.
trait EachRow<T> {
    fn par_rows_mut_each(&mut self, work: impl Fn(usize, &mut [T]) + Sync);
}

impl<T: Send + Sync> EachRow<T> for Image<T> {
    fn par_rows_mut_each(&mut self, work: impl Fn(usize, &mut [T]) + Sync) {
        use rayon::prelude::*;
        self.par_rows_mut().with_min_len(16).for_each(|(y, row)| work(y, row));
    }
}

/// NaN fails every comparison, so it becomes missing as well.
fn sanitise_row(depth_m: &mut [f32], min: f32, max: f32) {
    for d in depth_m {
        let keep = (*d > 0.0) & (*d >= min) & (*d <= max) & (*d < f32::INFINITY);
        *d = if keep { *d } else { 0.0 };
    }
}

fn linearise(srgb: &Image<[u8; 3]>, out: &mut Image<[f32; 3]>) {
    let table: &[f32; 256] = &LINEAR_FROM_SRGB8;
    out.par_rows_mut_each(|y, row| {
        let codes = srgb.row(y).as_flattened();
        for (linear, &code) in row.as_flattened_mut().iter_mut().zip(codes) {
            *linear = table[code as usize];
        }
    });
}

/// 3x3 binomial filter; at the border the picture is continued by its last pixel.
fn gaussian(source: &Image<[f32; 3]>, out: &mut Image<[f32; 3]>) {
    let last = source.height().saturating_sub(1);
    out.par_rows_mut_each(|y, row| {
        let near = [y.saturating_sub(1), y, (y + 1).min(last)];
        gaussian_row(near.map(|y| source.row(y).as_flattened()), row.as_flattened_mut());
    });
}

/// One row of interleaved RGB. Sums are ordered so that a constant stays exactly what it was.
#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn gaussian_row(rows: [&[f32]; 3], out: &mut [f32]) {
    let n = out.len();
    let [above, here, below] = rows.map(|r| &r[..n]);
    let column = |i: usize| (above[i] + below[i]) + 2.0 * here[i];
    let blend = |left, middle, right| ((left + right) + 2.0f32 * middle) * (1.0 / 16.0);
    for channel in 0..3.min(n) {
        let (first, last) = (channel, n - 3 + channel);
        let inner = |i: usize| column(i.min(last));
        out[first] = blend(column(first), column(first), inner(first + 3));
        out[last] = blend(column(last.saturating_sub(3).max(first)), column(last), column(last));
    }
    if n < 9 {
        return;
    }
    let m = n - 6;
    for (i, out) in out[3..3 + m].iter_mut().enumerate() {
        *out = blend(column(i), column(i + 3), column(i + 6));
    }
}

/// 3x3 median of each channel. The sRGB curve rises, so the median of codes is the median of light.
fn median(source: &Image<[u8; 3]>, out: &mut Image<[u8; 3]>) {
    let last = source.height().saturating_sub(1);
    out.par_rows_mut_each(|y, row| {
        let near = [y.saturating_sub(1), y, (y + 1).min(last)];
        median_row(near.map(|y| source.row(y).as_flattened()), row.as_flattened_mut());
    });
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn median_row(rows: [&[u8]; 3], out: &mut [u8]) {
    let n = out.len();
    let [a, b, c] = rows.map(|r| &r[..n]);
    for channel in 0..3.min(n) {
        let last = n - 3 + channel;
        for i in [channel, last] {
            let (l, r) = (i.saturating_sub(3).max(channel), (i + 3).min(last));
            out[i] = median_of_9([a[l], a[i], a[r], b[l], b[i], b[r], c[l], c[i], c[r]]);
        }
    }
    if n < 9 {
        return;
    }
    let m = n - 6;
    let [a, b, c] = [a, b, c].map(|r| [&r[..m], &r[3..3 + m], &r[6..6 + m]]);
    for (i, out) in out[3..3 + m].iter_mut().enumerate() {
        let [a, b, c] = [a, b, c].map(|r| r.map(|tap| tap[i]));
        *out = median_of_9([a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2]]);
    }
}

/// Sorts three columns of three; the median is that of the largest minimum, the middle median and the
/// smallest maximum.
#[inline(always)]
fn median_of_9([a, b, c, d, e, f, g, h, i]: [u8; 9]) -> u8 {
    let sort = |x: u8, y: u8, z: u8| {
        let (x, y) = (x.min(y), x.max(y));
        let (y, z) = (y.min(z), y.max(z));
        (x.min(y), x.max(y), z)
    };
    let (a, b, c) = sort(a, b, c);
    let (d, e, f) = sort(d, e, f);
    let (g, h, i) = sort(g, h, i);
    let low = a.max(d).max(g);
    let high = c.min(f).min(i);
    let (_, middle, _) = sort(b, e, h);
    sort(low, middle, high).1
}

const ROOTS: usize = 1024;

/// Encoded intensity in 8-bit steps, tabled over the square root of luminance: over the root the sRGB
/// curve is almost a straight line, so linear interpolation is good to a thousandth of a step.
static STEPS_FROM_ROOT: LazyLock<[f32; ROOTS + 2]> = LazyLock::new(|| {
    std::array::from_fn(|i| {
        let root = i as f32 / ROOTS as f32;
        255.0 * srgb_from_linear(root * root)
    })
});

/// The curves that the Input stage looks up, for other devices.
#[cfg(feature = "gpu")]
pub struct InputTables {
    /// Linear light of each 8-bit sRGB code.
    pub linear_from_code: &'static [f32; 256],
    /// Encoded intensity at equal steps of the root of luminance from 0 to 1, and one more.
    pub steps_from_root: &'static [f32],
}

#[cfg(feature = "gpu")]
pub fn input_tables() -> InputTables {
    InputTables { linear_from_code: &LINEAR_FROM_SRGB8, steps_from_root: &*STEPS_FROM_ROOT }
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn intensity_row(color: &[[f32; 3]], table: &[f32], out: &mut [f32]) {
    for (out, rgb) in out.iter_mut().zip(color) {
        let place = luminance(*rgb).sqrt().min(1.0) * ROOTS as f32;
        let below = place as usize;
        let share = place - below as f32;
        *out = table[below] + share * (table[below + 1] - table[below]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Size;
    use crate::math::color::linear_from_srgb;
    use crate::math::random::Rng;

    fn raw(size: Size, seed: u32) -> RawFrame {
        let mut rng = Rng::new(&[seed]);
        let color = (0..size.pixels()).map(|_| [0; 3].map(|_: i32| rng.next_u32() as u8)).collect();
        let depth = (0..size.pixels()).map(|_| 4.0 * rng.uniform()).collect();
        RawFrame {
            index: 3,
            timestamp_s: 0.1,
            color: Image::from_vec(size, color),
            depth_m: Image::from_vec(size, depth),
            world_from_camera: None,
            exposure_s: None,
        }
    }

    fn prepared(raw: RawFrame, color_filter: ColorFilter) -> RgbdFrame {
        let mut out = RgbdFrame::default();
        let params = InputParams { color_filter, ..InputParams::default() };
        InputStage::new(&params).prepare(raw, &mut out);
        out
    }

    /// The 3x3 neighbourhood of a channel, continued at the border.
    fn near(image: &Image<[u8; 3]>, x: usize, y: usize, c: usize) -> [u8; 9] {
        std::array::from_fn(|k| {
            image.clamped(x as isize + k as isize % 3 - 1, y as isize + k as isize / 3 - 1)[c]
        })
    }

    const SIZES: [Size; 6] = [
        Size::new(67, 43),
        Size::new(1, 1),
        Size::new(1, 5),
        Size::new(2, 3),
        Size::new(3, 1),
        Size::new(640, 2),
    ];

    #[test]
    fn filters_equal_their_definition_up_to_the_border() {
        for size in SIZES {
            let source = raw(size, 1);
            let gauss = prepared(source.clone(), ColorFilter::Gaussian).color;
            let median = prepared(source.clone(), ColorFilter::Median).color;
            let plain = prepared(source.clone(), ColorFilter::None).color;
            for (x, y, c) in
                (0..size.pixels() * 3).map(|i| (i / 3 % size.width, i / 3 / size.width, i % 3))
            {
                let mut codes = near(&source.color, x, y, c);
                let linear = |code: u8| f64::from(linear_from_srgb(f32::from(code) / 255.0));
                let weights = [1.0, 2.0, 1.0, 2.0, 4.0, 2.0, 1.0, 2.0, 1.0];
                let blurred: f64 =
                    codes.iter().zip(weights).map(|(&v, w)| linear(v) * w / 16.0).sum();
                // nine f32 values up to 1 and eight sums: a few 2^-24
                assert!((f64::from(gauss[(x, y)][c]) - blurred).abs() < 1e-6, "{size} {x} {y}");
                assert_eq!(f64::from(plain[(x, y)][c]), linear(codes[4]));
                codes.sort_unstable();
                assert_eq!(f64::from(median[(x, y)][c]), linear(codes[4]), "{size} {x} {y}");
            }
        }
    }

    #[test]
    fn grey_keeps_its_code_and_a_constant_its_value() {
        let size = Size::new(19, 7);
        for code in 0..=255u8 {
            let mut source = raw(size, 2);
            source.color.fill([code; 3]);
            let out = prepared(source, ColorFilter::Gaussian);
            assert!(
                out.color.as_slice().iter().all(|&p| p == [LINEAR_FROM_SRGB8[code as usize]; 3])
            );
            // table: 0.001, see the next test; f32 luminance weights: 255 * 1e-7
            let worst = out.intensity.as_slice().iter().map(|v| (v - f32::from(code)).abs());
            assert!(worst.fold(0.0, f32::max) < 2e-3, "{code}");
        }
    }

    #[test]
    fn the_intensity_table_follows_the_curve() {
        let mut out = [0.0f32];
        for i in 0..=100_000 {
            let linear = i as f32 / 1e5;
            intensity_row(&[[linear; 3]], &*STEPS_FROM_ROOT, &mut out);
            let exact = 255.0 * srgb_from_linear(luminance([linear; 3]));
            assert!((out[0] - exact).abs() < 2e-3, "{linear}: {} {exact}", out[0]);
        }
    }

    #[test]
    fn only_depth_in_range_passes() {
        let size = Size::new(9, 1);
        let mut source = raw(size, 3);
        let values = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, -0.0, 0.19, 0.2, 8.0, 8.01];
        source.depth_m = Image::from_vec(size, values.into());
        let out = prepared(source, ColorFilter::None);
        assert_eq!(out.depth_m.as_slice(), [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.2, 8.0, 0.0]);
    }

    #[test]
    fn buffers_are_kept_and_threads_change_nothing() {
        let size = Size::new(67, 43);
        let mut stage = InputStage::new(&InputParams::default());
        let mut out = RgbdFrame::default();
        stage.prepare(raw(size, 4), &mut out);
        let place = out.color.as_slice().as_ptr();
        stage.prepare(raw(size, 5), &mut out);
        assert_eq!(out.color.as_slice().as_ptr(), place);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let alone = pool.install(|| prepared(raw(size, 5), ColorFilter::Gaussian));
        assert_eq!((&alone.color, &alone.intensity), (&out.color, &out.intensity));
    }
}
