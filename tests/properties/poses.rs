//! Poses and projections.

use crate::arbitrary::*;
use glam::{DQuat, DVec3, Vec2, Vec3};
use kinlight::capture::trajectory::Trajectory;
use kinlight::math::{
    Orthographic, Pinhole, Pose, Projection, View, affine_from_pose, pose_from_xyzw,
};
use proptest::prelude::*;

/// Half a rounding of f32, relative.
const ROUNDING: f64 = 0.5 * f32::EPSILON as f64;

fn pose() -> impl Strategy<Value = Pose> {
    (direction(), 0.0..20.0f64, rotation())
        .prop_map(|(towards, metres, q)| made(metres * towards, q))
}

fn made(t: DVec3, q: DQuat) -> Pose {
    pose_from_xyzw(t.to_array(), [q.x, q.y, q.z, q.w]).unwrap()
}

/// Metres, and radians, of one pose in the axes of another.
fn apart(a: &Pose, b: &Pose) -> f64 {
    let step = a.inverse() * b;
    step.translation.vector.norm().max(step.rotation.angle())
}

proptest! {
    #[test]
    fn composition_and_inverse(a in pose(), b in pose(), c in pose()) {
        // three products of numbers up to 60; angles near 0 come from an arc cosine, which halves the digits
        prop_assert!(apart(&((a * b) * c), &(a * (b * c))) < 1e-7);
        prop_assert!(apart(&(a * a.inverse()), &Pose::identity()) < 1e-7);
        prop_assert!(((a * b) * c).translation.vector.metric_distance(&(a * (b * c)).translation.vector) < 1e-12);
        prop_assert!((a.rotation.coords.norm() - 1.0).abs() < 1e-15);
    }

    /// The f32 transform of kernels moves points as the pose does.
    #[test]
    fn kernels_move_points_as_the_pose_does(a in pose(), p in direction(), metres in 0.0..20.0f64) {
        let p = metres * p;
        let exact = a * nalgebra::Point3::new(p.x, p.y, p.z);
        let found = affine_from_pose(&a).transform_point3(p.as_vec3()).as_dvec3();
        let error = (found - DVec3::new(exact.x, exact.y, exact.z)).length();
        // matrix entries of three roundings, three products and sums, a translation: of the lengths involved
        let size = metres + a.translation.vector.norm();
        prop_assert!(error < 12.0 * ROUNDING * size.max(1e-3), "{error:e} of {size}");
    }

    #[test]
    fn poses_between_two_are_on_the_way(a in pose(), turn in direction(), angle in 0.0..2.5f64, moved in direction(), share in 0.0..1.0f64) {
        let b = Pose::from_parts(
            (a.translation.vector + nalgebra::Vector3::new(moved.x, moved.y, moved.z)).into(),
            made(DVec3::ZERO, DQuat::from_axis_angle(turn, angle)).rotation * a.rotation,
        );
        let track = Trajectory::new(vec![(10.0, a), (10.1, b)]);
        let between = track.at(10.0 + 0.1 * share, 0.2).unwrap();
        let whole = a.rotation.angle_to(&b.rotation);
        // times are some 10 s, good to 2e-15: 2e-14 of the step; angles as above
        prop_assert!((a.rotation.angle_to(&between.rotation) - share * whole).abs() < 1e-6);
        let walked = (between.translation.vector - a.translation.vector).norm();
        prop_assert!((walked - share).abs() < 1e-9);
        prop_assert_eq!(track.at(10.0, 0.2), Some(a));
        prop_assert_eq!(track.at(10.1, 0.2), Some(b));
        prop_assert_eq!(track.at(9.999, 0.2), None);
    }

    #[test]
    fn projection_comes_back(
        f in prop::array::uniform2(-2.0..5.0f32),
        c in prop::array::uniform2(-1e4..1e4f32),
        pixel in prop::array::uniform2(0.0..2000.0f32),
        depth in -3.0..3.0f32,
        perspective: bool,
    ) {
        let (f, depth_m) = (f.map(|e| 10f32.powf(e)), 10f32.powf(depth));
        let projection = match perspective {
            true => Projection::Perspective(Pinhole { width: 2000, height: 2000, fx: f[0], fy: f[1], cx: c[0], cy: c[1] }),
            false => Projection::Orthographic(Orthographic { width: 2000, height: 2000, pixels_per_m: f[0], cx: c[0], cy: c[1] }),
        };
        let view = View { projection, world_from_view: Pose::identity() };
        let point = view.unproject(Vec2::from(pixel), depth_m);
        prop_assert_eq!(point.z, depth_m);
        let back = view.project(point).unwrap();
        for axis in 0..2 {
            // six roundings of the distance from the principal point, one of the sum
            let size = 6.0 * f64::from((pixel[axis] - c[axis]).abs()) + f64::from(pixel[axis].abs() + c[axis].abs());
            prop_assert!(f64::from((back[axis] - pixel[axis]).abs()) <= ROUNDING * size, "{back} {pixel:?}");
        }
        if perspective {
            prop_assert_eq!(view.project(Vec3::new(point.x, point.y, -depth_m)), None);
            prop_assert_eq!(view.project(Vec3::new(point.x, point.y, 0.0)), None);
        }
    }

    /// A picture of half the size sees along the same rays.
    #[test]
    fn halving_a_camera_keeps_its_rays(f in 10.0..1000.0f32, c in -100.0..1000.0f32, pixel in 0usize..1000, level in 0u32..4) {
        let full = Pinhole { width: 8192, height: 8192, fx: f, fy: f, cx: c, cy: c };
        let half = full.halved(level);
        let block = f64::from(1u32 << level);
        let middle = pixel as f64 * block + 0.5 * (block - 1.0);
        let exact = (middle - f64::from(c)) / f64::from(f);
        let found = (pixel as f64 - f64::from(half.cx)) / f64::from(half.fx);
        // the principal point rounds three times, in numbers of its size
        let bound = 4.0 * ROUNDING * (f64::from(c).abs() + 1.0) / f64::from(f);
        prop_assert!((found - exact).abs() < bound, "{found} {exact}");
    }
}
