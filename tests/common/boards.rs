//! Pictures of calibration boards through known cameras.

use kinlight::capture::calibration::CameraModel;
use kinlight::image::{Image, Size};
use kinlight::math::Pose;
use kinlight::math::random::Rng;
use nalgebra::{Point3, Translation3, UnitQuaternion, Vector3};
use rayon::prelude::*;
use std::path::Path;

/// Rays through each side of a pixel: edges are as smooth as a sensor's.
const SIDE: usize = 3;

/// A camera with the ideal rays through its pixels, nine to a pixel; NaN where it sees nothing.
pub struct Eye {
    pub model: CameraModel,
    rays: Vec<[f32; 2]>,
}

impl Eye {
    pub fn new(model: CameraModel) -> Self {
        let per_row = model.width * SIDE;
        let rays = (0..model.height * SIDE)
            .into_par_iter()
            .flat_map_iter(|j| (0..per_row).map(move |i| (i, j)))
            .map(|(i, j)| {
                let place = |k: usize| (k as f64 + 0.5) / SIDE as f64 - 0.5;
                let (xd, yd) = ((place(i) - model.cx) / model.fx, (place(j) - model.cy) / model.fy);
                let (x, y) = model.distortion.undistort(xd, yd).unwrap_or((f64::NAN, f64::NAN));
                [x as f32, y as f32]
            })
            .collect();
        Self { model, rays }
    }

    /// What the camera sees of a flat pattern (0 black, 1 white, by place on the board in metres), before
    /// grey, with `noise` codes of noise.
    pub fn picture(
        &self,
        camera_from_board: &Pose,
        pattern: &(dyn Fn(f64, f64) -> f64 + Sync),
        noise: f32,
        seed: u32,
    ) -> Image<[u8; 3]> {
        let size = Size::new(self.model.width, self.model.height);
        let board_from_camera = camera_from_board.inverse();
        let eye = board_from_camera * Point3::origin();
        let light = |ray: [f32; 2]| {
            let ray = Vector3::new(f64::from(ray[0]), f64::from(ray[1]), 1.0);
            let along = board_from_camera * ray;
            let reach = -eye.z / along.z;
            let at = eye + reach * along;
            if reach > 0.0 { pattern(at.x, at.y) } else { 0.5 }
        };
        let pixels = (0..size.pixels())
            .into_par_iter()
            .map(|i| {
                let (x, y) = (i % size.width, i / size.width);
                let sum: f64 = (0..SIDE * SIDE)
                    .map(|k| (x * SIDE + k % SIDE, y * SIDE + k / SIDE))
                    .map(|(a, b)| light(self.rays[b * size.width * SIDE + a]))
                    .sum();
                let code = 30.0 + 190.0 * sum as f32 / (SIDE * SIDE) as f32;
                let noisy = code + noise * Rng::new(&[seed, i as u32]).normal();
                [noisy.round().clamp(0.0, 255.0) as u8; 3]
            })
            .collect();
        Image::from_vec(size, pixels)
    }
}

/// A chessboard with a margin of one square, on a grey wall.
pub fn chessboard(columns: usize, rows: usize, square_m: f64) -> impl Fn(f64, f64) -> f64 + Sync {
    move |x, y| {
        let (i, j) = ((x / square_m).floor(), (y / square_m).floor());
        let within = |v: f64, low: f64, count: usize| v >= low && v < count as f64 - 1.0 - low;
        if within(i, -1.0, columns) && within(j, -1.0, rows) {
            (i + j).rem_euclid(2.0)
        } else if within(i, -2.0, columns) && within(j, -2.0, rows) {
            1.0
        } else {
            0.5
        }
    }
}

/// A drawn board of this many squares, half a square of margin, its lower left corner at the origin.
pub fn drawn(
    board: &Image<u8>,
    squares: (usize, usize),
    square_m: f64,
) -> impl Fn(f64, f64) -> f64 + Sync {
    let (width, height) = (squares.0 as f64 + 1.0, squares.1 as f64 + 1.0);
    move |x, y| {
        let (u, v) = (x / square_m + 0.5, squares.1 as f64 + 0.5 - y / square_m);
        if !(0.0..width).contains(&u) || !(0.0..height).contains(&v) {
            return 0.5;
        }
        let at = |t: f64, whole: f64, pixels: usize| (t / whole * pixels as f64) as usize;
        f64::from(board[(at(u, width, board.width()), at(v, height, board.height()))]) / 255.0
    }
}

/// Poses that show the middle of the board somewhere in the picture, slanted up to `slant` radians.
pub fn poses(
    count: usize,
    middle: [f64; 2],
    distance_m: f64,
    slant: f64,
    aside: f64,
    seed: u32,
) -> Vec<Pose> {
    let mut rng = Rng::new(&[seed]);
    let mut within = |reach: f64| reach * (2.0 * f64::from(rng.uniform()) - 1.0);
    (0..count)
        .map(|_| {
            let turn =
                UnitQuaternion::from_euler_angles(within(slant), within(slant), within(0.25));
            let z = distance_m * (1.0 + within(0.2));
            let to = Vector3::new(within(aside) * z, within(0.75 * aside) * z, z);
            let middle = turn * Vector3::new(middle[0], middle[1], 0.0);
            Pose::from_parts(Translation3::from(to - middle), turn)
        })
        .collect()
}

pub fn save(picture: &Image<[u8; 3]>, path: &Path) {
    kinlight::output::write_color_png(path, picture).unwrap();
}
