//! Scenes and views for the tests.

use super::*;
use crate::geometry::{GBuffer, Origin};
use crate::math::{Orthographic, Pinhole, Pose, Projection, View};
use crate::scene::analytic::{AnalyticScene, Shape};
use crate::scene::{Model, PartData, Similarity, Vertex, VirtualObject, VirtualScene};
use glam::{DMat3, DVec3, Vec3};
use std::sync::Arc;

pub const FLOOR: Shape = Shape::Plane { normal: Vec3::Z, offset: 0.0 };

pub fn stage(params: &TransferParams) -> RadianceTransfer {
    RadianceTransfer::new(params, &BounceParams::default()).unwrap()
}

pub fn transferred(params: &TransferParams, main: &GBuffer, auxiliary: &[GBuffer]) -> TransferMap {
    let mut out = TransferMap { coefficients: vec![f32::NAN; 7], ..TransferMap::default() };
    stage(params).transfer(main, auxiliary, &mut out);
    assert_eq!(out.coefficients.len(), out.grid.pixels() * out.bands * out.bands);
    out
}

/// What a constant light of radiance 1 makes of a point.
pub fn furnace(coefficients: &[f32]) -> f32 {
    coefficients[0] * 2.0 * std::f32::consts::PI.sqrt()
}

/// A box, a ball and a post on a floor.
pub fn desk() -> AnalyticScene {
    AnalyticScene::new([
        FLOOR,
        Shape::Box { min: Vec3::new(-0.4, -0.1, 0.0), max: Vec3::new(-0.1, 0.25, 0.3) },
        Shape::Sphere { centre: Vec3::new(0.3, 0.1, 0.22), radius: 0.22 },
        Shape::Box { min: Vec3::new(0.0, -0.3, 0.0), max: Vec3::new(0.05, -0.25, 0.25) },
    ])
}

/// A floor beside a wall of 2 m by 0.8 m.
pub fn wall() -> AnalyticScene {
    let (min, max) = (Vec3::new(-1.0, 0.3, 0.0), Vec3::new(1.0, 0.4, 0.8));
    AnalyticScene::new([FLOOR, Shape::Box { min, max }])
}

/// A view at `eye` that looks at `target`, with world z up in the picture.
pub fn look_at(eye: Vec3, target: Vec3) -> Pose {
    let (eye, target) = (eye.as_dvec3(), target.as_dvec3());
    let z = (target - eye).normalize();
    let up = if z.z.abs() > 0.99 { DVec3::Y } else { DVec3::Z };
    let x = z.cross(up).normalize();
    let q = glam::DQuat::from_mat3(&DMat3::from_cols(x, z.cross(x), z));
    crate::math::pose_from_xyzw(eye.to_array(), q.to_array()).unwrap()
}

pub fn perspective(width: usize, height: usize, pose: Pose) -> View {
    let f = 525.0 * width as f32 / 640.0;
    let (cx, cy) = ((width as f32 - 1.0) / 2.0, (height as f32 - 1.0) / 2.0);
    View::perspective(Pinhole { width, height, fx: f, fy: f, cx, cy }, pose)
}

pub fn orthographic(pixels: usize, side_m: f32, pose: Pose) -> View {
    let c = (pixels as f32 - 1.0) / 2.0;
    let pixels_per_m = pixels as f32 / side_m;
    let ortho = Orthographic { width: pixels, height: pixels, pixels_per_m, cx: c, cy: c };
    View { projection: Projection::Orthographic(ortho), world_from_view: pose }
}

/// A camera that sees the corner scene.
pub fn camera(width: usize, height: usize) -> View {
    perspective(width, height, look_at(Vec3::new(0.9, -1.3, 0.9), Vec3::new(0.0, 0.1, 0.1)))
}

/// Left, right, top, and one from a slanted light.
pub fn auxiliary_views(pixels: usize) -> Vec<View> {
    let middle = Vec3::new(0.0, 0.0, 0.3);
    [Vec3::X, -Vec3::X, Vec3::Z, Vec3::new(0.5, -0.6, 0.7)]
        .map(|from| orthographic(pixels, 2.4, look_at(middle + 2.0 * from, middle)))
        .to_vec()
}

/// Marks what is nearer than before as virtual.
pub fn paint_virtual(before: &GBuffer, mut merged: GBuffer) -> GBuffer {
    for (k, origin) in merged.origin.as_mut_slice().iter_mut().enumerate() {
        if merged.depth_m.as_slice()[k] != before.depth_m.as_slice()[k] {
            *origin = Origin::Virtual;
        }
    }
    merged
}

/// A box without a lid or bottom stands on the floor: four upright walls of 0.2 m by 0.3 m.
pub fn fence(at: Vec3) -> VirtualScene {
    let (a, h) = (0.1, 0.3);
    let base = [[-a, 0.0, -a], [a, 0.0, -a], [a, 0.0, a], [-a, 0.0, a]];
    let mut vertices = Vec::new();
    let mut triangles = Vec::new();
    for k in 0..4 {
        let (p, q) = (Vec3::from(base[k]), Vec3::from(base[(k + 1) % 4]));
        let normal = (q - p).cross(Vec3::Y).normalize();
        let first = vertices.len() as u32;
        for position in [p, q, q + Vec3::Y * h, p + Vec3::Y * h] {
            vertices.push(Vertex { position, normal, ..Vertex::default() });
        }
        triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    let part = PartData { vertices, triangles, ..PartData::default() };
    let model = Arc::new(Model::new("fence", vec![part]).unwrap());
    let pose = Similarity::standing(at, Vec3::Z, 0.3, 1.0);
    VirtualScene::from_objects([VirtualObject::placed(model, pose)])
}
