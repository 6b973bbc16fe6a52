//! Where the edges through a corner of a board cross.
//!
//! Foerstner's operator: the point that lies, weighted by contrast, nearest to the lines through all edge
//! pixels around it. OpenCV's has a square window, which on a ChArUco board either reaches the markers,
//! whose edges pull the corner away, or keeps so far from them that little of the edges is left. This
//! one follows the edges: it leaves out where both coordinates on the board are a marker's.

use crate::image::Image;
use nalgebra::{Matrix2, Vector2};

/// Half of the window along an edge, in squares and at most in pixels: a lens bends longer edges.
const REACH: f64 = 0.4;
const REACH_PX: f64 = 12.0;
/// A gradient takes in a pixel to each side, and a pixel blurs an edge by half of itself.
const BLUR_PX: f64 = 1.5;
/// Weights end over this.
const RAMP_PX: f64 = 1.0;
/// An answer this far from where it was looked for is that of something else, in squares.
const FARTHEST: f64 = 0.25;

/// A corner as it is seen.
pub(super) struct Around {
    pub at: [f64; 2],
    /// The sides of a square at the corner, pixels.
    pub along: [f64; 2],
    pub down: [f64; 2],
    /// Share of a square's side between the edges through the corner and the nearest marker's;
    /// infinite without markers.
    pub clear: f64,
}

/// The crossing near a corner; `None` where there is none, or where the picture or the markers leave it
/// no room.
pub(super) fn crossing(picture: &Image<u8>, around: &Around) -> Option<[f64; 2]> {
    let board_from_picture = Matrix2::from_columns(&[around.along.into(), around.down.into()])
        .try_inverse()
        .filter(|m| m.iter().all(|v| v.is_finite()))?;
    let start = Vector2::from(around.at);
    let mut at = start;
    for _ in 0..50 {
        let next = step(picture, around, &board_from_picture, at)?;
        let moved = (next - at).norm();
        at = next;
        if (board_from_picture * (at - start)).amax() > FARTHEST {
            return None;
        }
        if moved < 1e-4 {
            break;
        }
    }
    Some(at.into())
}

/// The nearest point to the edges in the window about `at`.
fn step(
    picture: &Image<u8>,
    around: &Around,
    board_from_picture: &Matrix2<f64>,
    at: Vector2<f64>,
) -> Option<Vector2<f64>> {
    // Pixels in a square along its sides.
    let side = [Vector2::from(around.along).norm(), Vector2::from(around.down).norm()];
    let reach = side.map(|s| REACH.min(REACH_PX / s));
    let free = side.map(|s| around.clear * s - BLUR_PX);
    if free.iter().any(|&f| f < RAMP_PX) || side.iter().any(|&s| REACH * s < 2.0) {
        return None;
    }
    let [rx, ry] =
        [0, 1].map(|i| (reach[0] * around.along[i]).abs() + (reach[1] * around.down[i]).abs());
    // At the picture's edge the window is cut; the corner itself must have pixels all around.
    let inside = |v: f64, size: usize| v >= 3.0 && v + 4.0 <= size as f64;
    if !(inside(at.x, picture.width()) && inside(at.y, picture.height())) {
        return None;
    }
    let span =
        |v: f64, r: f64, size: usize| ((v - r).ceil().max(1.0), (v + r).min(size as f64 - 2.0));
    let (left, right) = span(at.x, rx, picture.width());
    let (top, bottom) = span(at.y, ry, picture.height());
    let (mut matrix, mut sum) = (Matrix2::zeros(), Vector2::zeros());
    for y in top as usize..=bottom as usize {
        let rows = [y - 1, y, y + 1].map(|y| picture.row(y));
        for x in left as usize..=right as usize {
            let away = Vector2::new(x as f64, y as f64) - at;
            let on_board = board_from_picture * away;
            let weight = weight(on_board.into(), &reach, &side, &free);
            if weight <= 0.0 {
                continue;
            }
            let slope = |a: u8, b: u8| 0.5 * (f64::from(b) - f64::from(a));
            let gradient =
                Vector2::new(slope(rows[1][x - 1], rows[1][x + 1]), slope(rows[0][x], rows[2][x]));
            let square = weight * gradient * gradient.transpose();
            matrix += square;
            sum += square * away;
        }
    }
    Some(at + matrix.try_inverse().filter(|m| m.iter().all(|v| v.is_finite()))? * sum)
}

/// Falls off towards the ends of the window and of what the markers leave.
fn weight(on_board: [f64; 2], reach: &[f64; 2], side: &[f64; 2], free: &[f64; 2]) -> f64 {
    let mut window = 1.0;
    let mut marker = 1.0;
    for i in 0..2 {
        let part = on_board[i] / reach[i];
        window *= (1.0 - part * part).max(0.0);
        let beyond = on_board[i].abs() * side[i] - free[i];
        marker *= (1.0 + beyond / RAMP_PX).clamp(0.0, 1.0);
    }
    window * window * (1.0 - marker)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Size;
    use crate::math::random::Rng;

    const SIDE_PX: f64 = 36.0;

    /// A crossing turned by `angle`, with markers in the white squares up to `clear` of the edges, every
    /// pixel the mean of 16 x 16 points.
    fn picture(at: [f64; 2], angle: f64, clear: f64, noise: f32, seed: u32) -> (Image<u8>, Around) {
        let size = Size::new(64, 64);
        let (sin, cos) = angle.sin_cos();
        let (along, down) = ([SIDE_PX * cos, SIDE_PX * sin], [-SIDE_PX * sin, SIDE_PX * cos]);
        let code = |x: f64, y: f64| {
            let (dx, dy) = (x - at[0], y - at[1]);
            let (u, v) = ((dx * cos + dy * sin) / SIDE_PX, (dy * cos - dx * sin) / SIDE_PX);
            let white = (u > 0.0) == (v > 0.0);
            // The two markers differ, so that they do not pull to both sides alike.
            let marker = u.abs() > clear && v.abs() > clear && (u > 0.0 || v < -0.3);
            if white && !marker { 220.0 } else { 30.0 }
        };
        let mut rng = Rng::new(&[seed]);
        let pixel = |i: usize| {
            let (x, y) = ((i % size.width) as f64, (i / size.width) as f64);
            let part = |k: usize| (k as f64 + 0.5) / 16.0 - 0.5;
            let sum: f64 = (0..256).map(|k| code(x + part(k % 16), y + part(k / 16))).sum();
            (sum / 256.0 + f64::from(noise * rng.normal())).round().clamp(0.0, 255.0) as u8
        };
        let pixels = (0..size.pixels()).map(pixel).collect();
        let start = [at[0] + 0.6, at[1] - 0.4];
        (Image::from_vec(size, pixels), Around { at: start, along, down, clear })
    }

    #[test]
    fn markers_do_not_pull_a_corner_away() {
        let mut rng = Rng::new(&[1]);
        for clear in [0.14, 0.2, f64::INFINITY] {
            let (mut square, mut sum) = (0.0, [0.0; 2]);
            const COUNT: usize = 60;
            for seed in 0..COUNT as u32 {
                let mut part = || f64::from(rng.uniform()) - 0.5;
                let at = [32.0 + part(), 32.0 + part()];
                let (picture, around) = picture(at, part(), clear, 2.0, seed);
                let found = crossing(&picture, &around).expect("a crossing");
                let off = [found[0] - at[0], found[1] - at[1]];
                square += (off[0] * off[0] + off[1] * off[1]) / COUNT as f64;
                sum = [sum[0] + off[0] / COUNT as f64, sum[1] + off[1] / COUNT as f64];
            }
            let (rms, bias) = (square.sqrt(), sum[0].hypot(sum[1]));
            println!("clear {clear}: rms {rms:.4} px, mean {bias:.4} px");
            // Measured 0.018 to 0.023 px, most of it the pixel grid's; the mean of 60 is good to 0.003.
            assert!(rms < 0.035 && bias < 0.009, "{clear}: {rms} {bias}");
        }
    }

    #[test]
    fn no_room_and_no_crossing_are_said() {
        let (picture, around) = picture([32.0, 32.0], 0.1, 0.14, 0.0, 0);
        let tight = Around { clear: 0.06, ..around };
        assert!(crossing(&picture, &tight).is_none(), "markers 2 px away");
        let outside = Around { at: [2.0, 32.0], clear: 0.14, ..tight };
        assert!(crossing(&picture, &outside).is_none());
        let flat = Image::new(Size::new(64, 64), 90u8);
        let around = Around { at: [32.0, 32.0], ..outside };
        assert!(crossing(&flat, &around).is_none());
        let line = Around { down: around.along, ..around };
        assert!(crossing(&picture, &line).is_none());
    }
}
