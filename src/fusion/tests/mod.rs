mod accuracy;
mod extremes;
mod meshes;
mod stability;
mod stage;
mod timing;

use super::{TsdfVolume, VolumeParams};
use crate::capture::RgbdFrame;
use crate::geometry::GBuffer;
use crate::image::Image;
use crate::math::{Orthographic, Pinhole, Pose, Projection, View};
use crate::scene::analytic::AnalyticScene;
use glam::Vec3;

pub(crate) fn camera(width: usize, height: usize) -> Pinhole {
    let f = 525.0 * width as f32 / 640.0;
    let (cx, cy) = ((width as f32 - 1.0) / 2.0, (height as f32 - 1.0) / 2.0);
    Pinhole { width, height, fx: f, fy: f, cx, cy }
}

/// Pose that looks from `eye` to `target`, with world z up; not straight up or down.
pub(crate) fn look_at(eye: Vec3, target: Vec3) -> Pose {
    let z = (target - eye).normalize();
    let x = z.cross(Vec3::Z).normalize();
    let axes = glam::Mat3::from_cols(x, z.cross(x), z);
    let q = glam::Quat::from_mat3(&axes).as_dquat();
    crate::math::pose_from_xyzw(eye.as_dvec3().to_array(), [q.x, q.y, q.z, q.w]).unwrap()
}

pub(crate) fn orthographic(pixels: usize, side_m: f32, pose: Pose) -> View {
    let middle = (pixels as f32 - 1.0) / 2.0;
    let projection = Orthographic {
        width: pixels,
        height: pixels,
        pixels_per_m: pixels as f32 / side_m,
        cx: middle,
        cy: middle,
    };
    View { projection: Projection::Orthographic(projection), world_from_view: pose }
}

fn frame_of(depth_m: Image<f32>) -> RgbdFrame {
    RgbdFrame { depth_m, ..RgbdFrame::default() }
}

pub(crate) fn render(scene: &AnalyticScene, view: &View) -> RgbdFrame {
    frame_of(scene.render(view).depth_m)
}

fn volume(resolution: usize) -> TsdfVolume {
    let params = VolumeParams { resolution, ..VolumeParams::default() };
    TsdfVolume::new(&params, Vec3::new(0.0, 0.0, 0.4)).unwrap()
}

/// Positions on an arc in front of the corner scene.
pub(crate) fn arc(poses: usize) -> impl Iterator<Item = Pose> {
    (0..poses).map(move |i| {
        let angle = if poses > 1 { i as f32 / (poses - 1) as f32 * 1.2 - 0.4 } else { 0.2 };
        let eye = Vec3::new(1.6 * angle.cos(), -1.6 * angle.sin().abs() - 0.3, 1.2);
        look_at(eye, Vec3::new(-0.1, 0.2, 0.2))
    })
}

fn integrate_arc(
    volume: &mut TsdfVolume,
    scene: &AnalyticScene,
    size: (usize, usize),
    poses: usize,
) {
    for pose in arc(poses) {
        let view = View::perspective(camera(size.0, size.1), pose);
        volume.integrate(&render(scene, &view), &view).unwrap();
    }
}

fn cast(volume: &TsdfVolume, view: &View) -> GBuffer {
    let mut out = GBuffer::empty(*view);
    // poison: every pixel must be written
    out.depth_m.fill(f32::NAN);
    out.normals.x.fill(f32::NAN);
    volume.raycast(view, &mut out);
    out
}
