//! The place of a depth (infrared) camera beside the colour camera, from pairs of pictures of a board.

use super::CalibrateError;
use super::board::{Board, BoardView, PosedView, rms};
use super::intrinsics::{RefusedView, image_points, numbers, object_points, outlier_limit};
use crate::capture::calibration::CameraModel;
use crate::math::Pose;
use nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion};
use opencv::calib3d;
use opencv::core::{Mat, Point2f, Point3f, Size as CvSize, TermCriteria, Vector};

#[derive(Clone, Debug)]
pub struct FoundPlace {
    pub color_from_depth: Pose,
    /// RMS distance of corners in the depth camera from where the colour camera and the place predict
    /// them, pixels.
    pub rms_px: f64,
    /// The same of each pair.
    pub pairs: Vec<(String, f64)>,
    pub refused: Vec<RefusedView>,
}

/// One picture of each camera, taken of the same board at the same moment.
struct Pair {
    color: PosedView,
    depth: PosedView,
}

/// Solves for the place with both cameras as they are. Pairs are those views that are called alike; those
/// that contradict the others are left out.
pub fn find_place(
    board: &Board,
    color: (&CameraModel, &[PosedView]),
    depth: (&CameraModel, &[PosedView]),
) -> Result<FoundPlace, CalibrateError> {
    let mut pairs: Vec<Pair> = color
        .1
        .iter()
        .filter_map(|c| {
            let d = depth.1.iter().find(|d| d.view.key == c.view.key)?;
            Some(Pair { color: c.clone(), depth: with_same_start(board, c, d) })
        })
        .collect();
    let mut refused = Vec::new();
    loop {
        if pairs.is_empty() {
            let problem =
                "no pairs: colour and depth pictures must be called alike where the * stands";
            return Err(CalibrateError::Data(problem.into()));
        }
        let color_from_depth = solve(board, color.0, depth.0, &pairs)?;
        let errors: Vec<f64> = pairs
            .iter()
            .map(|pair| rms(&residuals(board, depth.0, pair, &color_from_depth)))
            .collect();
        let limit = outlier_limit(&errors);
        let worst = errors.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
        match worst {
            Some((at, error)) if pairs.len() > 2 && (error.is_nan() || error > limit) => {
                let key = pairs.remove(at).color.view.key;
                let reason =
                    format!("{error:.2} px from where the other pairs say, limit {limit:.2} px");
                log::warn!("pair {key} is left out: {reason}");
                refused.push(RefusedView { key, reason });
            }
            _ => {
                let residual = |p: &Pair| residuals(board, depth.0, p, &color_from_depth);
                let all: Vec<[f64; 2]> = pairs.iter().flat_map(residual).collect();
                let keys = pairs.iter().map(|p| p.color.view.key.clone());
                return Ok(FoundPlace {
                    color_from_depth,
                    rms_px: rms(&all),
                    pairs: keys.zip(errors).collect(),
                    refused,
                });
            }
        }
    }
}

/// Both cameras of a sensor look the same way: of a board that may be read from either end, the
/// reading that turns least between them is meant.
fn with_same_start(board: &Board, color: &PosedView, depth: &PosedView) -> PosedView {
    if !board.has_half_turn() {
        return depth.clone();
    }
    let far = board.corner(board.corners() - 1);
    let half_turn = Pose::from_parts(
        Translation3::new(far.x, far.y, 0.0),
        UnitQuaternion::from_axis_angle(&nalgebra::Vector3::z_axis(), std::f64::consts::PI),
    );
    let turned = PosedView {
        view: depth.view.turned(board),
        camera_from_board: depth.camera_from_board * half_turn,
    };
    let angle =
        |d: &PosedView| (color.camera_from_board * d.camera_from_board.inverse()).rotation.angle();
    if angle(&turned) < angle(depth) { turned } else { depth.clone() }
}

fn residuals(
    board: &Board,
    camera: &CameraModel,
    pair: &Pair,
    color_from_depth: &Pose,
) -> Vec<[f64; 2]> {
    let camera_from_board = color_from_depth.inverse() * pair.color.camera_from_board;
    PosedView { view: pair.depth.view.clone(), camera_from_board }.residuals(camera, board)
}

/// Corners that both saw, as cameras without distortion would have seen them: so the lenses may be of
/// any two models.
fn shared(
    pair: &Pair,
    color: &CameraModel,
    depth: &CameraModel,
) -> Vec<(usize, [f64; 2], [f64; 2])> {
    let ideal = |camera: &CameraModel, [u, v]: [f64; 2]| {
        let (xd, yd) = ((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy);
        let (x, y) = camera.distortion.undistort(xd, yd)?;
        Some([x * camera.fx + camera.cx, y * camera.fy + camera.cy])
    };
    let both =
        |view: &BoardView, number: usize| view.corners.iter().find(|c| c.0 == number).map(|c| c.1);
    pair.color
        .view
        .corners
        .iter()
        .filter_map(|&(n, c)| {
            Some((n, ideal(color, c)?, ideal(depth, both(&pair.depth.view, n)?)?))
        })
        .collect()
}

fn solve(
    board: &Board,
    color: &CameraModel,
    depth: &CameraModel,
    pairs: &[Pair],
) -> Result<Pose, CalibrateError> {
    let mut objects = Vector::<Vector<Point3f>>::new();
    let (mut of_color, mut of_depth) =
        (Vector::<Vector<Point2f>>::new(), Vector::<Vector<Point2f>>::new());
    for corners in pairs.iter().map(|p| shared(p, color, depth)).filter(|c| c.len() >= 4) {
        objects.push(object_points(board, corners.iter().map(|c| c.0)));
        of_color.push(image_points(corners.iter().map(|c| c.1)));
        of_depth.push(image_points(corners.iter().map(|c| c.2)));
    }
    if objects.is_empty() {
        return Err(CalibrateError::Data("no corners that both cameras saw".into()));
    }
    let matrix = |c: &CameraModel| {
        Mat::from_slice_2d(&[[c.fx, 0.0, c.cx], [0.0, c.fy, c.cy], [0.0, 0.0, 1.0]])
    };
    let (mut k_depth, mut k_color) = (matrix(depth)?, matrix(color)?);
    let (mut no_lens, mut none) = (Mat::default(), Mat::default());
    let (mut turn, mut shift) = (Mat::default(), Mat::default());
    let (mut essential, mut fundamental) = (Mat::default(), Mat::default());
    let size = CvSize::new(color.width as i32, color.height as i32);
    calib3d::stereo_calibrate(
        &objects,
        &of_depth,
        &of_color,
        &mut k_depth,
        &mut no_lens,
        &mut k_color,
        &mut none,
        size,
        &mut turn,
        &mut shift,
        &mut essential,
        &mut fundamental,
        calib3d::CALIB_FIX_INTRINSIC,
        TermCriteria::new(3, 200, 1e-10)?,
    )?;
    let (r, t) = (numbers(&turn)?, numbers(&shift)?);
    let rotation = Rotation3::from_matrix(&Matrix3::from_row_slice(&r));
    Ok(Pose::from_parts(
        Translation3::new(t[0], t[1], t[2]),
        UnitQuaternion::from_rotation_matrix(&rotation),
    ))
}
