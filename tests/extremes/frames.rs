//! Frames of scenes that are known exactly, and pictures of patterns.

use glam::{Mat3, Quat, Vec3};
use kinlight::capture::RawFrame;
use kinlight::image::{Image, Size};
use kinlight::math::random::{hash, unit_f32};
use kinlight::math::{Pinhole, Pose, View, pose_from_xyzw};
use kinlight::scene::analytic::{AnalyticScene, Shape};

pub const SIZE: Size = Size::new(64, 48);

/// With an opening angle of 60 degrees along the longer side.
pub fn camera(size: Size) -> Pinhole {
    let f = 0.87 * size.width.max(size.height) as f32;
    let [cx, cy] = [size.width, size.height].map(|n| 0.5 * (n as f32 - 1.0));
    Pinhole { width: size.width, height: size.height, fx: f, fy: f, cx, cy }
}

/// From `eye` towards `at`, upright in a world with +z up.
pub fn look(eye: Vec3, at: Vec3) -> Pose {
    let z = (at - eye).normalize();
    let x = z.cross(Vec3::Z).normalize();
    let q = Quat::from_mat3(&Mat3::from_cols(x, z.cross(x), z)).as_dquat();
    pose_from_xyzw(eye.as_dvec3().to_array(), [q.x, q.y, q.z, q.w]).expect("a turn")
}

/// Where the corner is seen well from.
pub const EYE: Vec3 = Vec3::new(1.55, -0.6, 1.2);
pub const MIDDLE: Vec3 = Vec3::new(-0.1, 0.1, 0.15);

pub fn at_corner() -> Pose {
    look(EYE, MIDDLE)
}

/// A point on the camera's axis.
pub fn in_front(pose: &Pose, metres: f64) -> Vec3 {
    let p = pose * nalgebra::Point3::new(0.0, 0.0, metres);
    Vec3::new(p.x as f32, p.y as f32, p.z as f32)
}

/// A floor and a wall.
pub fn two_planes() -> AnalyticScene {
    AnalyticScene::new([
        Shape::Plane { normal: Vec3::Z, offset: 0.0 },
        Shape::Plane { normal: Vec3::X, offset: -0.9 },
    ])
}

pub fn wall() -> AnalyticScene {
    AnalyticScene::new([Shape::Plane { normal: Vec3::X, offset: -0.2 }])
}

pub fn ball() -> AnalyticScene {
    AnalyticScene::new([Shape::Sphere { centre: MIDDLE, radius: 0.5 }])
}

/// Floor, ceiling and two walls along x, without an end.
pub fn corridor() -> AnalyticScene {
    AnalyticScene::new([
        Shape::Plane { normal: Vec3::Z, offset: 0.0 },
        Shape::Plane { normal: -Vec3::Z, offset: -2.4 },
        Shape::Plane { normal: Vec3::Y, offset: -1.2 },
        Shape::Plane { normal: -Vec3::Y, offset: -1.2 },
    ])
}

/// What the camera sees of a scene under a lamp and ambient light, with a little texture; black where it sees
/// nothing.
pub fn seen(scene: &AnalyticScene, size: Size, pose: Pose, index: usize) -> RawFrame {
    let buffer = scene.render(&View::perspective(camera(size), pose));
    let towards_lamp = Vec3::new(0.4, -0.5, 0.8).normalize();
    let color = (0..size.pixels()).map(|i| {
        let normal = buffer.normals.at(i % size.width, i / size.width);
        let texture = unit_f32(hash(i as u32)) * 12.0;
        let lit = 60.0 + 130.0 * normal.dot(towards_lamp).max(0.0) + texture;
        if normal == Vec3::ZERO { [0; 3] } else { [lit, 0.95 * lit, 0.9 * lit].map(|v| v as u8) }
    });
    let color = Image::from_vec(size, color.collect());
    RawFrame { color, depth_m: buffer.depth_m, ..blank(size, index, Some(pose)) }
}

/// Grey, without depth.
pub fn blank(size: Size, index: usize, pose: Option<Pose>) -> RawFrame {
    RawFrame {
        index,
        timestamp_s: index as f64 / 30.0,
        color: Image::new(size, [120; 3]),
        depth_m: Image::new(size, 0.0),
        world_from_camera: pose,
        exposure_s: None,
    }
}

/// From the value of each pixel.
pub fn picture<T>(size: Size, value: impl Fn(usize, usize) -> T) -> Image<T> {
    let pixels = (0..size.pixels()).map(|i| value(i % size.width, i / size.width));
    Image::from_vec(size, pixels.collect())
}
