//! Flat calibration boards, and what one camera saw of them.

use super::CalibrateError;
use crate::capture::calibration::CameraModel;
use crate::math::Pose;
use nalgebra::Point3;

/// A printed board. Coordinates on it: metres, z = 0, the first corner at the origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Board {
    /// Inner corners in a row and in a column.
    pub columns: usize,
    pub rows: usize,
    pub square_m: f64,
    /// ChArUco: side of the markers, and which.
    pub markers: Option<Markers>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Markers {
    pub side_m: f64,
    /// Bits along a side (4 to 7), and how many markers the dictionary holds (50, 100, 250 or 1000).
    pub bits: usize,
    pub count: usize,
}

impl Board {
    pub fn check(&self) -> Result<(), CalibrateError> {
        let possible = |n: usize| (2..=60).contains(&n);
        let positive = |v: f64| v > 0.0 && v.is_finite();
        let refuse = |problem: String| Err(CalibrateError::Options(problem));
        if !possible(self.columns) || !possible(self.rows) || self.columns * self.rows < 6 {
            return refuse(format!("a board of {}x{} inner corners", self.columns, self.rows));
        }
        if !positive(self.square_m) {
            return refuse(format!("squares of {} m", self.square_m));
        }
        match self.markers {
            Some(m) if !(positive(m.side_m) && m.side_m < self.square_m) => {
                refuse("markers must be smaller than the squares around them".into())
            }
            Some(m) if !(4..=7).contains(&m.bits) || ![50, 100, 250, 1000].contains(&m.count) => {
                refuse(format!("no marker dictionary {}x{}_{}", m.bits, m.bits, m.count))
            }
            _ => Ok(()),
        }
    }

    /// The corner of this number; they are counted along the rows.
    pub fn corner(&self, number: usize) -> Point3<f64> {
        let (x, y) = (number % self.columns, number / self.columns);
        Point3::new(x as f64 * self.square_m, y as f64 * self.square_m, 0.0)
    }

    pub fn corners(&self) -> usize {
        self.columns * self.rows
    }

    /// Whether the board looks the same after half a turn: then its first corner may be the last.
    pub fn has_half_turn(&self) -> bool {
        self.markers.is_none() && (self.columns + self.rows).is_multiple_of(2)
    }
}

/// Corners of the board found in one picture.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardView {
    /// What the picture is called among its kind.
    pub key: String,
    /// Number on the board, and place in the picture.
    pub corners: Vec<(usize, [f64; 2])>,
}

impl BoardView {
    /// The same corners counted from the other end.
    pub fn turned(&self, board: &Board) -> Self {
        let last = board.corners() - 1;
        let mut corners: Vec<_> =
            self.corners.iter().map(|&(n, place)| (last - n.min(last), place)).collect();
        corners.sort_by_key(|c| c.0);
        Self { key: self.key.clone(), corners }
    }
}

/// A view of the board from a known place.
#[derive(Clone, Debug)]
pub struct PosedView {
    pub view: BoardView,
    pub camera_from_board: Pose,
}

impl PosedView {
    /// Found less predicted place of each corner, pixels. A corner behind the camera is infinitely far.
    pub fn residuals(&self, camera: &CameraModel, board: &Board) -> Vec<[f64; 2]> {
        let each = |&(number, found): &(usize, [f64; 2])| {
            let seen = project(camera, &(self.camera_from_board * board.corner(number)));
            seen.map_or([f64::INFINITY; 2], |p| [found[0] - p[0], found[1] - p[1]])
        };
        self.view.corners.iter().map(each).collect()
    }

    /// RMS distance of found and predicted corners, pixels.
    pub fn rms_px(&self, camera: &CameraModel, board: &Board) -> f64 {
        rms(&self.residuals(camera, board))
    }
}

/// RMS length.
pub fn rms(residuals: &[[f64; 2]]) -> f64 {
    let square: f64 = residuals.iter().map(|[x, y]| x * x + y * y).sum();
    (square / residuals.len().max(1) as f64).sqrt()
}

/// The pixel that shows a point in camera axes, by the project's own lens models; `None` behind the
/// camera.
pub fn project(camera: &CameraModel, point: &Point3<f64>) -> Option<[f64; 2]> {
    if point.z <= 1e-9 {
        return None;
    }
    let (x, y) = camera.distortion.distort(point.x / point.z, point.y / point.z);
    Some([camera.fx * x + camera.cx, camera.fy * y + camera.cy])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impossible_boards_are_refused() {
        let board = Board { columns: 9, rows: 6, square_m: 0.025, markers: None };
        assert!(board.check().is_ok());
        assert!(Board { columns: 1, ..board }.check().is_err());
        assert!(Board { square_m: f64::NAN, ..board }.check().is_err());
        let markers = Markers { side_m: 0.03, bits: 4, count: 50 };
        assert!(Board { markers: Some(markers), ..board }.check().is_err());
        let markers = Some(Markers { side_m: 0.018, ..markers });
        assert!(Board { markers, ..board }.check().is_ok());
    }

    #[test]
    fn half_a_turn_counts_from_the_other_end() {
        let board = Board { columns: 3, rows: 3, square_m: 1.0, markers: None };
        assert!(board.has_half_turn() && !Board { rows: 4, ..board }.has_half_turn());
        let view = BoardView { key: "a".into(), corners: vec![(0, [1.0, 2.0]), (8, [3.0, 4.0])] };
        assert_eq!(view.turned(&board).corners, [(0, [3.0, 4.0]), (8, [1.0, 2.0])]);
        assert_eq!(view.turned(&board).turned(&board), view);
    }
}
