//! How well views of a board determine a camera, for any lens model.

use super::board::{Board, PosedView, project, rms};
use crate::capture::calibration::{CameraModel, Distortion};
use crate::math::Pose;
use nalgebra::{DMatrix, SMatrix, Translation3, UnitQuaternion, Vector3, Vector6};

/// One standard deviation of fx, fy, cx, cy in pixels, from the scatter of the corners and with every
/// other unknown (distortion, places of the boards) free. Infinite where the views leave one open.
pub(super) fn deviations(camera: &CameraModel, board: &Board, views: &[PosedView]) -> [f64; 4] {
    let mut unknowns = vec![camera.fx, camera.fy, camera.cx, camera.cy];
    unknowns.extend(coefficients(&camera.distortion));
    let count = unknowns.len();
    let mut information = DMatrix::<f64>::zeros(count, count);
    let mut residuals = Vec::new();
    for view in views {
        residuals.extend(view.residuals(camera, board));
        let (mut own, mut cross) = (SMatrix::<f64, 6, 6>::zeros(), DMatrix::<f64>::zeros(count, 6));
        for &(number, _) in &view.view.corners {
            let point = board.corner(number);
            let of_camera = |k: usize, step: f64| {
                let mut moved = unknowns.clone();
                moved[k] += step;
                project(&with_unknowns(camera, &moved), &(view.camera_from_board * point))
            };
            let of_place = |k: usize, step: f64| {
                let mut by = Vector6::zeros();
                by[k] = step;
                project(camera, &(moved(&view.camera_from_board, &by) * point))
            };
            let lens: Option<Vec<[f64; 2]>> =
                (0..count).map(|k| slope(|step| of_camera(k, step), unknowns[k])).collect();
            let place: Option<Vec<[f64; 2]>> =
                (0..6).map(|k| slope(|step| of_place(k, step), 0.0)).collect();
            let (Some(lens), Some(place)) = (lens, place) else { continue };
            for axis in 0..2 {
                for i in 0..count {
                    for j in 0..count {
                        information[(i, j)] += lens[i][axis] * lens[j][axis];
                    }
                    for j in 0..6 {
                        cross[(i, j)] += lens[i][axis] * place[j][axis];
                    }
                }
                for i in 0..6 {
                    for j in 0..6 {
                        own[(i, j)] += place[i][axis] * place[j][axis];
                    }
                }
            }
        }
        // What the place of the board takes of it.
        let Some(inverse) = own.try_inverse() else { return [f64::INFINITY; 4] };
        information -= &cross * inverse * cross.transpose();
    }
    let freedom = (2 * residuals.len()) as f64 - (count + 6 * views.len()) as f64;
    // Two coordinates to a corner.
    let variance = rms(&residuals).powi(2) * residuals.len() as f64 / freedom.max(1.0);
    let covariance: Option<DMatrix<f64>> = information.try_inverse();
    std::array::from_fn(|k| match &covariance {
        Some(c) if c[(k, k)] >= 0.0 => (variance * c[(k, k)]).sqrt(),
        _ => f64::INFINITY,
    })
}

fn slope(at: impl Fn(f64) -> Option<[f64; 2]>, value: f64) -> Option<[f64; 2]> {
    let step = 1e-6 * value.abs().max(0.1);
    let (before, after) = (at(-step)?, at(step)?);
    Some([0, 1].map(|i| (after[i] - before[i]) / (2.0 * step)))
}

fn moved(pose: &Pose, by: &Vector6<f64>) -> Pose {
    let shift = Translation3::new(by[0], by[1], by[2]);
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(by[3], by[4], by[5]));
    Pose::from_parts(shift * pose.translation, turn * pose.rotation)
}

fn coefficients(distortion: &Distortion) -> Vec<f64> {
    match *distortion {
        Distortion::None => vec![],
        Distortion::Brown { k1, k2, p1, p2, k3 } => vec![k1, k2, p1, p2, k3],
        Distortion::Rational { k1, k2, p1, p2, k3, k4, k5, k6 } => {
            vec![k1, k2, p1, p2, k3, k4, k5, k6]
        }
        Distortion::KannalaBrandt { k1, k2, k3, k4 } => vec![k1, k2, k3, k4],
    }
}

fn with_unknowns(camera: &CameraModel, unknowns: &[f64]) -> CameraModel {
    let [fx, fy, cx, cy] = [0, 1, 2, 3].map(|k| unknowns[k]);
    let d = &unknowns[4..];
    let distortion = match camera.distortion {
        Distortion::None => Distortion::None,
        Distortion::Brown { .. } => {
            Distortion::Brown { k1: d[0], k2: d[1], p1: d[2], p2: d[3], k3: d[4] }
        }
        Distortion::Rational { .. } => Distortion::Rational {
            k1: d[0],
            k2: d[1],
            p1: d[2],
            p2: d[3],
            k3: d[4],
            k4: d[5],
            k5: d[6],
            k6: d[7],
        },
        Distortion::KannalaBrandt { .. } => {
            Distortion::KannalaBrandt { k1: d[0], k2: d[1], k3: d[2], k4: d[3] }
        }
    };
    CameraModel { fx, fy, cx, cy, distortion, ..*camera }
}
