//! What a Kinect v1 makes of exact depth: noise that grows with distance (Nguyen et al. 2012),
//! disparity steps, and holes.

use super::tracer::CentreHits;
use crate::image::Image;
use crate::math::Pinhole;
use crate::math::random::Rng;
use rayon::prelude::*;

/// The infrared projector stands to the right of the camera.
pub const BASELINE_M: f32 = 0.075;
/// Of the infrared camera; disparity in pixels is `BASELINE_M * FOCAL_PX / z`.
pub const FOCAL_PX: f32 = 580.0;
pub const DISPARITY_STEPS_PER_PX: f32 = 8.0;
pub const MIN_DEPTH_M: f32 = 0.4;
pub const MAX_DEPTH_M: f32 = 4.5;
/// Standard deviation of where a pixel really looks.
const LATERAL_SIGMA_PX: f32 = 0.5;
/// Surfaces flatter than this against the line of sight give nothing: 80 degrees.
const MIN_COSINE: f32 = 0.17;
/// A step of this share of depth to a neighbour is an edge.
const EDGE_STEP: f32 = 0.03;
/// Share of edge pixels that are lost.
const EDGE_LOSS: f32 = 0.5;

/// Axial standard deviation in metres at a depth.
pub fn axial_sigma_m(depth_m: f32) -> f32 {
    0.0012 + 0.0019 * (depth_m - 0.4) * (depth_m - 0.4)
}

/// The nearest depth that the sensor can express.
pub fn quantised_m(depth_m: f32) -> f32 {
    let disparity = BASELINE_M * FOCAL_PX / depth_m;
    let steps = (disparity * DISPARITY_STEPS_PER_PX).round();
    BASELINE_M * FOCAL_PX * DISPARITY_STEPS_PER_PX / steps
}

/// Depth as the sensor would give it. `in_projector_shadow(x, y)` says whether something stands
/// between the projector and what the pixel shows.
pub fn sense(
    exact: &CentreHits,
    camera: &Pinhole,
    words: [u32; 2],
    in_projector_shadow: impl Fn(usize, usize) -> bool + Sync,
) -> Image<f32> {
    let mut out = Image::new(camera.size(), 0.0);
    out.par_rows_mut().for_each(|(y, row)| {
        for (x, pixel) in row.iter_mut().enumerate() {
            let mut rng = Rng::new(&[words[0], words[1], 0x6b, y as u32, x as u32]);
            *pixel = sense_pixel(exact, x, y, &mut rng, &in_projector_shadow).unwrap_or(0.0);
        }
    });
    out
}

fn sense_pixel(
    exact: &CentreHits,
    x: usize,
    y: usize,
    rng: &mut Rng,
    in_projector_shadow: &impl Fn(usize, usize) -> bool,
) -> Option<f32> {
    let size = exact.depth_m.size();
    let jittered = |v: usize, end: usize, offset: f32| {
        ((v as f32 + offset).round().max(0.0) as usize).min(end - 1)
    };
    let x = jittered(x, size.width, rng.normal() * LATERAL_SIGMA_PX);
    let y = jittered(y, size.height, rng.normal() * LATERAL_SIGMA_PX);
    let lost = rng.uniform() < EDGE_LOSS && at_edge(&exact.depth_m, x, y);
    let depth_m = exact.depth_m[(x, y)];
    let flat = exact.cosine[(x, y)] < MIN_COSINE;
    if depth_m <= 0.0 || flat || lost || in_projector_shadow(x, y) {
        return None;
    }
    let sensed = quantised_m(depth_m + rng.normal() * axial_sigma_m(depth_m));
    (MIN_DEPTH_M..=MAX_DEPTH_M).contains(&sensed).then_some(sensed)
}

fn at_edge(depth_m: &Image<f32>, x: usize, y: usize) -> bool {
    let here = depth_m[(x, y)];
    [(-1, 0), (1, 0), (0, -1), (0, 1)]
        .iter()
        .map(|&(dx, dy)| depth_m.clamped(x as isize + dx, y as isize + dy))
        .any(|there| (there - here).abs() > EDGE_STEP * here)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Size;

    fn wall(depth_m: f32, cosine: f32) -> (CentreHits, Pinhole) {
        let size = Size::new(160, 120);
        let exact = CentreHits {
            depth_m: Image::new(size, depth_m),
            cosine: Image::new(size, cosine),
            object: Image::new(size, 0),
        };
        let camera = Pinhole { width: 160, height: 120, fx: 131.0, fy: 131.0, cx: 79.5, cy: 59.5 };
        (exact, camera)
    }

    #[test]
    fn spread_on_a_wall_is_that_of_the_formula() {
        for depth_m in [0.8f32, 1.5, 2.5, 4.0] {
            let (exact, camera) = wall(depth_m, 1.0);
            let sensed = sense(&exact, &camera, [1, 2], |_, _| false);
            let n = sensed.as_slice().len() as f64;
            let mean = sensed.as_slice().iter().map(|&d| f64::from(d)).sum::<f64>() / n;
            let variance =
                sensed.as_slice().iter().map(|&d| (f64::from(d) - mean).powi(2)).sum::<f64>() / n;
            // Rounding to disparity steps of width s adds s^2 / 12.
            let depth = f64::from(depth_m);
            let step = depth * depth / (43.5 * 8.0);
            let expected = (f64::from(axial_sigma_m(depth_m)).powi(2) + step * step / 12.0).sqrt();
            // 0.5 % standard error from 19200 pixels; s^2 / 12 holds within a few percent where
            // the step (4.6 cm at 4 m) is as wide as 1.7 sigma
            assert!((variance.sqrt() / expected - 1.0).abs() < 0.05, "{depth_m}: {variance}");
            assert!((mean - depth).abs() < 0.1 * expected, "{mean}");
        }
    }

    #[test]
    fn depths_are_whole_disparity_steps() {
        let (exact, camera) = wall(2.2, 1.0);
        let sensed = sense(&exact, &camera, [5, 6], |_, _| false);
        for &d in sensed.as_slice() {
            let steps = 43.5 * 8.0 / f64::from(d);
            assert!((steps - steps.round()).abs() < 1e-4, "{d}");
        }
    }

    #[test]
    fn holes_where_the_sensor_has_them() {
        let none = |(exact, camera): &(CentreHits, Pinhole), shadow: bool| {
            let sensed = sense(exact, camera, [3, 4], |_, _| shadow);
            sensed.as_slice().iter().all(|&d| d == 0.0)
        };
        assert!(!none(&wall(1.0, 0.2), false));
        assert!(none(&wall(1.0, 0.1), false), "grazing");
        assert!(none(&wall(1.0, 1.0), true), "shadow");
        assert!(none(&wall(0.0, 1.0), false), "nothing hit");
        assert!(none(&wall(5.5, 1.0), false), "too far");
        assert!(none(&wall(0.3, 1.0), false), "too near");
    }

    #[test]
    fn edges_lose_about_half_of_their_pixels() {
        let (mut exact, camera) = wall(1.0, 1.0);
        for y in 0..120 {
            exact.depth_m.row_mut(y)[80..].fill(2.0);
        }
        let sensed = sense(&exact, &camera, [7, 8], |_, _| false);
        let lost =
            (0..120).flat_map(|y| [79, 80].map(|x| sensed[(x, y)])).filter(|&d| d == 0.0).count();
        // Half of the looks that stay on the edge's two columns (84 %), of 240
        assert!((70..=130).contains(&lost), "{lost}");
        assert!((0..120).all(|y| sensed[(20, y)] > 0.0));
    }
}
