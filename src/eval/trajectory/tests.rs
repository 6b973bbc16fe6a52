use super::*;
use crate::math::pose_from_xyzw;
use crate::math::random::Rng;
use nalgebra::Vector3;

fn pose(t: [f64; 3], q: [f64; 4]) -> Pose {
    pose_from_xyzw(t, q).unwrap()
}

/// A winding path of `n` poses, 30 a second.
fn path(n: usize) -> Vec<TimedPose> {
    (0..n)
        .map(|i| {
            let s = i as f64 * 0.1;
            let t = [s.sin(), 0.3 * (2.0 * s).cos(), 0.05 * s * s];
            let q = [0.2 * s.sin(), 0.1 * s.cos(), 0.15, 1.0];
            TimedPose { timestamp_s: i as f64 / 30.0, world_from_camera: pose(t, q) }
        })
        .collect()
}

fn moved(path: &[TimedPose], by: &Pose) -> Vec<TimedPose> {
    path.iter().map(|p| TimedPose { world_from_camera: by * p.world_from_camera, ..*p }).collect()
}

fn ate(estimate: &[TimedPose], reference: &[TimedPose]) -> AbsoluteError {
    absolute_error(estimate, reference, MATCH_TOLERANCE_S).unwrap()
}

#[test]
fn a_rigidly_moved_copy_has_no_error() {
    let truth = path(50);
    let by = pose([3.0, -20.0, 7.0], [0.9, -0.3, 0.2, -0.4]);
    let estimate = moved(&truth, &by);
    let error = ate(&estimate, &truth);
    // f64 rounding of coordinates near 20, some hundred operations
    assert!(error.translation_m.max < 1e-12, "{error:?}");
    assert_eq!((error.matched, error.degeneracy), (50, None));
    let back = error.reference_from_estimate * by;
    assert!(back.translation.vector.norm() < 1e-12 && back.rotation.angle() < 1e-12);

    let relative = relative_error(&estimate, &truth, MATCH_TOLERANCE_S, 1).unwrap();
    assert_eq!(relative.pairs, 49);
    assert!(relative.translation_m.max < 1e-13 && relative.rotation_deg.max < 1e-12);
}

/// Errors that no rigid motion can take up: alternately +d and -d across a straight line, far
/// enough along it that the best line is the line itself.
#[test]
fn known_offset_gives_known_error() {
    let at = |x: f64, y: f64, i: usize| TimedPose {
        timestamp_s: i as f64,
        world_from_camera: pose([x, y, 0.0], [0.0, 0.0, 0.0, 1.0]),
    };
    let d = 0.01;
    // x = -3, -1, 1, 3 with y = +d, -d, -d, +d: neither mean nor slope, nor rotation about x
    let reference: Vec<_> = (0..4).map(|i| at(2.0 * i as f64 - 3.0, 0.0, i)).collect();
    let signs = [d, -d, -d, d];
    let estimate: Vec<_> = (0..4).map(|i| at(2.0 * i as f64 - 3.0, signs[i], i)).collect();
    let error = ate(&estimate, &reference);
    assert!((error.translation_m.rmse - d).abs() < 1e-12, "{error:?}");
    assert!((error.translation_m.median - d).abs() < 1e-12);
    assert_eq!(error.degeneracy, Some(Degeneracy::StraightLine));
}

#[test]
fn drift_of_a_frame_is_the_relative_error() {
    let truth = path(40);
    // each step of the estimate is the true one followed by the same small motion
    let extra = pose([0.003, 0.0, -0.004], [0.0, 0.001, 0.0, 1.0]);
    let mut estimate = vec![truth[0]];
    for w in truth.windows(2) {
        let step = w[0].world_from_camera.inv_mul(&w[1].world_from_camera);
        let last = estimate.last().unwrap().world_from_camera;
        estimate.push(TimedPose { world_from_camera: last * step * extra, ..w[1] });
    }
    let error = relative_error(&estimate, &truth, MATCH_TOLERANCE_S, 1).unwrap();
    assert!((error.translation_m.rmse - 0.005).abs() < 1e-12, "{error:?}");
    assert!((error.translation_m.max - 0.005).abs() < 1e-12);
    let angle = (2.0 * 0.001f64.atan()).to_degrees();
    assert!((error.rotation_deg.rmse - angle).abs() < 1e-10, "{error:?}");
    let over_five = relative_error(&estimate, &truth, MATCH_TOLERANCE_S, 5).unwrap();
    assert_eq!((over_five.pairs, over_five.step), (35, 5));
}

#[test]
fn no_motion_beats_the_alignment() {
    let truth = path(60);
    let mut rng = Rng::new(&[21]);
    let mut noise = || 0.02 * f64::from(rng.normal());
    let estimate: Vec<_> = moved(&truth, &pose([1.0, 2.0, 3.0], [0.1, 0.7, 0.2, 0.5]))
        .into_iter()
        .map(|mut p| {
            p.world_from_camera.translation.vector += Vector3::new(noise(), noise(), noise());
            p
        })
        .collect();
    let best = ate(&estimate, &truth);
    for axis in 0..6 {
        for step in [-1e-3, 1e-3] {
            let mut v = [0.0; 6];
            v[axis] = step;
            let nudge = pose([v[0], v[1], v[2]], [v[3], v[4], v[5], 1.0]);
            let by = nudge * best.reference_from_estimate;
            let squared: f64 = estimate
                .iter()
                .zip(&truth)
                .map(|(e, t)| {
                    let moved = by * e.world_from_camera;
                    (moved.translation.vector - t.world_from_camera.translation.vector)
                        .norm_squared()
                })
                .sum();
            let rmse = (squared / truth.len() as f64).sqrt();
            assert!(rmse > best.translation_m.rmse, "axis {axis}, {rmse} <= {best:?}");
        }
    }
}

#[test]
fn a_mirrored_path_is_not_aligned_by_reflection() {
    let truth = path(50);
    let mirrored: Vec<_> = truth
        .iter()
        .map(|p| {
            let mut p = *p;
            p.world_from_camera.translation.vector.z *= -1.0;
            p
        })
        .collect();
    let error = ate(&mirrored, &truth);
    assert!(error.translation_m.rmse > 0.01, "{error:?}");
    let rotation = error.reference_from_estimate.rotation.to_rotation_matrix();
    assert!((rotation.matrix().determinant() - 1.0).abs() < 1e-12);
}

#[test]
fn degenerate_paths_are_named_and_still_measured() {
    let truth = path(20);
    let still = moved(&[truth[0]; 20], &pose([5.0, 1.0, 1.0], [0.0, 0.0, 0.0, 1.0]));
    let still: Vec<_> = still
        .iter()
        .zip(&truth)
        .map(|(s, t)| TimedPose { timestamp_s: t.timestamp_s, ..*s })
        .collect();
    let both = ate(&still, &still);
    assert_eq!(both.degeneracy, Some(Degeneracy::Standstill));
    assert!(both.translation_m.max < 1e-12);
    // a standing estimate of a moving camera: the error is the path's own spread
    let error = ate(&still, &truth);
    assert_eq!(error.degeneracy, Some(Degeneracy::Standstill));
    let centres: Vec<_> = truth.iter().map(|p| p.world_from_camera.translation.vector).collect();
    let mean = centres.iter().sum::<Vector3<f64>>() / 20.0;
    let spread = (centres.iter().map(|c| (c - mean).norm_squared()).sum::<f64>() / 20.0).sqrt();
    assert!((error.translation_m.rmse - spread).abs() < 1e-12);
}

#[test]
fn paths_of_extreme_size_are_aligned_and_broken_ones_refused() {
    let truth = path(30);
    for scale in [1e-120, 1e120] {
        let scaled = |poses: &[TimedPose]| -> Vec<TimedPose> {
            let mut poses = poses.to_vec();
            for p in &mut poses {
                p.world_from_camera.translation.vector *= scale;
            }
            poses
        };
        let turned = moved(&truth, &pose([0.0; 3], [0.9, -0.3, 0.2, -0.4]));
        let error = ate(&scaled(&turned), &scaled(&truth));
        assert!(error.translation_m.max < 1e-13 * scale && error.degeneracy.is_none(), "{error:?}");
    }
    for broken in [f64::NAN, f64::INFINITY] {
        let mut estimate = truth.clone();
        estimate[7].world_from_camera.translation.vector.y = broken;
        let message = absolute_error(&estimate, &truth, 0.02).unwrap_err().to_string();
        assert_eq!(message, "a pose of the path is not finite");
    }
}

#[test]
fn association_takes_the_nearest_and_each_pose_once() {
    let at = |timestamp_s: f64| TimedPose { timestamp_s, world_from_camera: Pose::identity() };
    let estimate = [0.0, 0.015, 1.0, 2.0].map(at);
    let reference = [2.019, 0.012, 5.0, 1.021, 0.001].map(at);
    let pairs = associate(&estimate, &reference, 0.02);
    assert_eq!(pairs, [(0, 4), (1, 1), (3, 0)]);
    assert!(associate(&estimate, &[], 0.02).is_empty());
    assert!(associate(&[at(f64::NAN)], &reference, 0.02).is_empty());
    let few = absolute_error(&estimate[2..], &reference, 0.02).unwrap_err().to_string();
    assert!(few.starts_with("only 1 of 2 estimated poses"), "{few}");
    let empty = relative_error(&[], &[], 0.02, 1).unwrap_err().to_string();
    assert!(empty.starts_with("only 0 of 0"), "{empty}");
}
