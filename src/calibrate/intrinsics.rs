//! Focal lengths, principal point and distortion of one camera from views of a board.

use super::CalibrateError;
use super::board::{Board, BoardView, PosedView};
use super::uncertainty::deviations;
use crate::capture::calibration::{CameraModel, Distortion};
use crate::image::Size;
use crate::math::Pose;
use nalgebra::{Translation3, UnitQuaternion, Vector3};
use opencv::calib3d;
use opencv::core::{Mat, Point2f, Point3f, Size as CvSize, TermCriteria, Vector};
use opencv::prelude::*;

/// Fewer views leave focal length and distance mixed up.
pub(super) const FEWEST_VIEWS: usize = 4;
/// A focal length that is known no better than to this share of itself is not determined: views that tell
/// it from the distance know it tens of times better.
const UNDETERMINED: f64 = 0.02;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LensModel {
    /// No distortion.
    Ideal,
    /// Brown-Conrady, 5 coefficients.
    Brown,
    /// With a denominator, 8 coefficients.
    Rational,
    /// Equidistant fish-eye, 4 coefficients.
    Fisheye,
}

/// A view that the solution does not rest on.
#[derive(Clone, Debug, PartialEq)]
pub struct RefusedView {
    pub key: String,
    pub reason: String,
}

#[derive(Clone, Debug)]
pub struct FoundCamera {
    pub camera: CameraModel,
    /// One standard deviation of fx, fy, cx, cy in pixels.
    pub deviation_px: [f64; 4],
    /// RMS reprojection error over the used views, pixels.
    pub rms_px: f64,
    pub views: Vec<PosedView>,
    pub outliers: Vec<(PosedView, RefusedView)>,
}

/// Solves for the camera; views that fit three times worse than the median, and worse than a third of
/// a pixel, are left out and the rest solved again.
pub fn find_camera(
    board: &Board,
    views: &[BoardView],
    size: Size,
    model: LensModel,
) -> Result<FoundCamera, CalibrateError> {
    board.check()?;
    let mut used = views.to_vec();
    let mut outliers = Vec::new();
    loop {
        if used.len() < FEWEST_VIEWS {
            let problem =
                format!("{} usable views of the board, {FEWEST_VIEWS} are needed", used.len());
            return Err(CalibrateError::Data(problem));
        }
        let (camera, views) = solve(board, &used, size, model)?;
        let errors: Vec<f64> = views.iter().map(|v| v.rms_px(&camera, board)).collect();
        let limit = outlier_limit(&errors);
        let worst = errors.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
        match worst {
            // NaN counts as worst and as beyond any limit.
            Some((at, error)) if error.is_nan() || error > limit => {
                let refused = used.remove(at);
                let reason = format!("reprojection error {error:.2} px, limit {limit:.2} px");
                log::warn!("view {} is left out: {reason}", refused.key);
                outliers.push((views[at].clone(), RefusedView { key: refused.key, reason }));
            }
            _ => {
                let all: Vec<[f64; 2]> =
                    views.iter().flat_map(|v| v.residuals(&camera, board)).collect();
                let rms_px = super::board::rms(&all);
                let deviation_px = deviations(&camera, board, &views);
                check_determined(&camera, deviation_px, &views)?;
                return Ok(FoundCamera { camera, deviation_px, rms_px, views, outliers });
            }
        }
    }
}

fn check_determined(
    camera: &CameraModel,
    deviation_px: [f64; 4],
    views: &[PosedView],
) -> Result<(), CalibrateError> {
    let share = |k: usize, f: f64| deviation_px[k] / f.abs();
    let worst = share(0, camera.fx).max(share(1, camera.fy));
    // NaN is no answer, either.
    if worst <= UNDETERMINED {
        return Ok(());
    }
    let normal = |v: &PosedView| v.camera_from_board.rotation * Vector3::z();
    let apart = |a: &PosedView| {
        views.iter().map(|b| normal(a).dot(&normal(b)).clamp(-1.0, 1.0).acos()).fold(0.0, f64::max)
    };
    let spread = views.iter().map(apart).fold(0.0, f64::max).to_degrees();
    Err(CalibrateError::Data(format!(
        "the {} views do not determine the focal length (to {:.0} %): the boards stand within {spread:.0} \
         degrees of parallel to each other. Tilt the board by 20 to 50 degrees to each side, and show it \
         large",
        views.len(),
        100.0 * worst,
    )))
}

/// Errors are compared with the median of their kind: it stands as long as half of the views are good.
pub(super) fn outlier_limit(errors: &[f64]) -> f64 {
    let mut sorted = errors.to_vec();
    sorted.sort_by(f64::total_cmp);
    (3.0 * sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)).max(1.0 / 3.0)
}

pub(super) fn object_points(
    board: &Board,
    numbers: impl Iterator<Item = usize>,
) -> Vector<Point3f> {
    let point = |n: usize| {
        let p = board.corner(n);
        Point3f::new(p.x as f32, p.y as f32, 0.0)
    };
    numbers.map(point).collect()
}

pub(super) fn image_points(places: impl Iterator<Item = [f64; 2]>) -> Vector<Point2f> {
    places.map(|[x, y]| Point2f::new(x as f32, y as f32)).collect()
}

type Solution = (CameraModel, Vec<PosedView>);

fn solve(
    board: &Board,
    views: &[BoardView],
    size: Size,
    model: LensModel,
) -> Result<Solution, CalibrateError> {
    let objects: Vector<Vector<Point3f>> =
        views.iter().map(|v| object_points(board, v.corners.iter().map(|c| c.0))).collect();
    let places: Vector<Vector<Point2f>> =
        views.iter().map(|v| image_points(v.corners.iter().map(|c| c.1))).collect();
    let cv_size = CvSize::new(size.width as i32, size.height as i32);
    let (mut matrix, mut lens) = (Mat::default(), Mat::default());
    let (mut turns, mut shifts) = (Vector::<Mat>::new(), Vector::<Mat>::new());
    let end = TermCriteria::new(3, 200, 1e-10)?;
    if model == LensModel::Fisheye {
        let flags = calib3d::Fisheye_CALIB_RECOMPUTE_EXTRINSIC | calib3d::Fisheye_CALIB_FIX_SKEW;
        calib3d::calibrate(
            &objects,
            &places,
            cv_size,
            &mut matrix,
            &mut lens,
            &mut turns,
            &mut shifts,
            flags,
            end,
        )
        .map_err(fisheye_error)?;
    } else {
        let flags = match model {
            LensModel::Rational => calib3d::CALIB_RATIONAL_MODEL,
            LensModel::Ideal => {
                calib3d::CALIB_ZERO_TANGENT_DIST
                    | calib3d::CALIB_FIX_K1
                    | calib3d::CALIB_FIX_K2
                    | calib3d::CALIB_FIX_K3
            }
            LensModel::Brown | LensModel::Fisheye => 0,
        };
        calib3d::calibrate_camera(
            &objects,
            &places,
            cv_size,
            &mut matrix,
            &mut lens,
            &mut turns,
            &mut shifts,
            flags,
            end,
        )?;
    }
    let k = numbers(&matrix)?;
    let camera = CameraModel {
        width: size.width,
        height: size.height,
        fx: k[0],
        fy: k[4],
        cx: k[2],
        cy: k[5],
        distortion: distortion(model, &numbers(&lens)?),
    };
    let mut posed = Vec::with_capacity(views.len());
    for (i, view) in views.iter().enumerate() {
        let (turn, shift) = (numbers(&turns.get(i)?)?, numbers(&shifts.get(i)?)?);
        let camera_from_board = pose(&turn, &shift);
        posed.push(PosedView { view: view.clone(), camera_from_board });
    }
    Ok((camera, posed))
}

/// What OpenCV's fish-eye solver says when views contradict each other or the lens is none.
fn fisheye_error(error: opencv::Error) -> CalibrateError {
    CalibrateError::Data(format!(
        "no fish-eye lens fits the views: is it one, are the boards at several slants, and is the board's \
         size right? (OpenCV: {})",
        error.message.lines().next().unwrap_or_default()
    ))
}

fn pose(turn: &[f64], shift: &[f64]) -> Pose {
    Pose::from_parts(
        Translation3::new(shift[0], shift[1], shift[2]),
        UnitQuaternion::from_scaled_axis(Vector3::new(turn[0], turn[1], turn[2])),
    )
}

/// The elements of a matrix of doubles, by rows.
pub(super) fn numbers(matrix: &Mat) -> Result<Vec<f64>, CalibrateError> {
    let mut all = Vec::with_capacity(matrix.total() * matrix.channels() as usize);
    for row in 0..matrix.rows() {
        match matrix.channels() {
            1 => all.extend_from_slice(matrix.at_row::<f64>(row)?),
            _ => all.extend(matrix.at_row::<opencv::core::Vec3d>(row)?.iter().flat_map(|v| v.0)),
        }
    }
    Ok(all)
}

fn distortion(model: LensModel, d: &[f64]) -> Distortion {
    let at = |i: usize| d.get(i).copied().unwrap_or(0.0);
    match model {
        LensModel::Ideal => Distortion::None,
        LensModel::Brown => {
            Distortion::Brown { k1: at(0), k2: at(1), p1: at(2), p2: at(3), k3: at(4) }
        }
        LensModel::Rational => Distortion::Rational {
            k1: at(0),
            k2: at(1),
            p1: at(2),
            p2: at(3),
            k3: at(4),
            k4: at(5),
            k5: at(6),
            k6: at(7),
        },
        LensModel::Fisheye => {
            Distortion::KannalaBrandt { k1: at(0), k2: at(1), k3: at(2), k4: at(3) }
        }
    }
}
