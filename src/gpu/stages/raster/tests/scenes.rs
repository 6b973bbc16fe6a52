//! Made scenes, and the shipped one.

use crate::geometry::GBuffer;
use crate::math::random::Rng;
use crate::math::{Pinhole, View, pose_from_xyzw};
use crate::scene::analytic::{AnalyticScene, Shape};
use crate::scene::raster::tests::{at, busy_scene, cuboid, model, quad, sheet, sphere};
use crate::scene::{Material, PartData, Similarity, Texture, VirtualObject, VirtualScene, Wrap};
use glam::{Quat, Vec3};
use std::path::Path;
use std::sync::Arc;

/// Objects before a viewer at the origin who looks along +z.
pub fn all() -> Vec<(String, Vec<VirtualObject>)> {
    let tilt = Quat::from_rotation_z(0.3) * Quat::from_rotation_y(0.5);
    let floor = Quat::from_rotation_x(std::f32::consts::FRAC_PI_2);
    let small = 0.02 * Vec3::ONE;
    let mut scenes: Vec<(String, _)> = [
        ("busy", busy_scene()),
        ("a sphere", vec![at(sphere(0.3, 24), Vec3::Z)]),
        ("a sphere half in the wall", vec![at(sphere(0.3, 24), 1.7 * Vec3::Z)]),
        ("inside a room", vec![at(cuboid(Vec3::new(2.0, 1.0, 1.5)), 0.2 * Vec3::Z)]),
        ("a sheet that crosses the wall", vec![turned(sheet(3.0), tilt, 1.7)]),
        ("a floor that runs through the viewer", vec![turned_at(floor, Vec3::new(0.0, 0.4, 0.0))]),
        ("a sheet in the wall", vec![at(sheet(3.0), 1.7 * Vec3::Z)]),
        ("two sheets in one plane", vec![at(red(), Vec3::Z), at(red_and_blue(), Vec3::Z)]),
        ("vertex colours", vec![turned(red_and_blue(), tilt, 1.2)]),
        ("smaller than a pixel", vec![at(sphere(0.002, 6), Vec3::new(0.1, 0.1, 1.0))]),
        ("far below 1 mm", vec![scaled(cuboid(small), 1e-3, Vec3::new(0.0, 0.0, 0.0015))]),
    ]
    .map(|(name, objects)| (name.to_owned(), objects))
    .into();
    for (wrap, masked, slant) in [
        (Wrap::Repeat, false, 0.2),
        (Wrap::Repeat, true, 1.3),
        (Wrap::MirroredRepeat, true, 0.2),
        (Wrap::MirroredRepeat, false, 1.3),
        (Wrap::ClampToEdge, true, 1.0),
    ] {
        let rotation = Quat::from_rotation_z(0.4) * Quat::from_rotation_x(slant);
        // what is behind a mask's holes
        let behind = at(sphere(0.3, 12), Vec3::new(0.2, 0.0, 1.5));
        let objects = vec![turned(textured(wrap, masked), rotation, 1.2), behind];
        scenes.push((format!("{wrap:?}, masked {masked}, slant {slant}"), objects));
    }
    scenes
}

fn turned(model: Arc<crate::scene::Model>, rotation: Quat, distance_m: f32) -> VirtualObject {
    let translation = distance_m * Vec3::Z;
    VirtualObject::placed(model, Similarity { rotation, scale: 1.0, translation })
}

fn turned_at(rotation: Quat, translation: Vec3) -> VirtualObject {
    VirtualObject::placed(sheet(5.0), Similarity { rotation, scale: 1.0, translation })
}

fn scaled(model: Arc<crate::scene::Model>, scale: f32, translation: Vec3) -> VirtualObject {
    VirtualObject::placed(model, Similarity { rotation: Quat::IDENTITY, scale, translation })
}

fn square(material: Material) -> PartData {
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    quad(corners.map(|(x, y)| Vec3::new(x, y, 0.0)), material)
}

fn red() -> Arc<crate::scene::Model> {
    model(square(Material { base_color: [1.0, 0.1, 0.2, 1.0], ..Material::default() }))
}

fn red_and_blue() -> Arc<crate::scene::Model> {
    let colors = vec![[1.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0, 1.0], [2.0; 4], [0.0; 4]];
    model(PartData { colors, ..square(Material::default()) })
}

/// Three periods of a coarse checker with noise and pin-holes.
fn textured(wrap: Wrap, masked: bool) -> Arc<crate::scene::Model> {
    let mut rng = Rng::new(&[17]);
    let texel = |i: usize| {
        let white = (i % 64 / 8 + i / 64 / 8).is_multiple_of(2);
        let alpha = if rng.uniform() < 0.2 { 0 } else { 255 };
        [if white { 255 } else { 0 }, (255.0 * rng.uniform()) as u8, (i / 64) as u8 * 4, alpha]
    };
    let texture = Texture::new(64, 48, (0..64 * 48).map(texel).collect(), [wrap, wrap]);
    let material = Material {
        texture: texture.map(Arc::new),
        alpha_cutoff: masked.then_some(0.5),
        base_color: [0.9, 0.8, 1.0, 1.0],
    };
    let mut part = square(material);
    for vertex in &mut part.vertices {
        vertex.uv = vertex.uv * 3.0 - 0.7;
    }
    model(part)
}

/// Small boxes, scattered.
pub fn thousand() -> Vec<VirtualObject> {
    let (small, mut rng) = (cuboid(Vec3::splat(0.02)), Rng::new(&[3]));
    let mut place =
        || Vec3::new(rng.uniform() - 0.5, 0.6 * (rng.uniform() - 0.5), 1.0 + rng.uniform());
    (0..1000).map(|_| at(small.clone(), place())).collect()
}

/// The demo sequence's object on the plane that it stands on, seen as in the first frame.
pub fn demo() -> (VirtualScene, GBuffer) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("sequences/demo");
    let numbers = |file: &str| -> Vec<f64> {
        let text = std::fs::read_to_string(folder.join(file)).unwrap();
        let line = text.lines().find(|line| !line.starts_with('#')).unwrap();
        line.split_whitespace().map(|n| n.parse().unwrap()).collect()
    };
    let [fx, fy, cx, cy] = std::array::from_fn(|i| numbers("intrinsics.txt")[i] as f32);
    let camera = Pinhole { width: 640, height: 480, fx, fy, cx, cy }.halved(1);
    let p = numbers("groundtruth.txt");
    let pose = pose_from_xyzw([p[1], p[2], p[3]], [p[4], p[5], p[6], p[7]]).unwrap();
    let table = Shape::Plane { normal: Vec3::Z, offset: 0.0 };
    let real = AnalyticScene::new([table]).render(&View::perspective(camera, pose));
    (VirtualScene::load(&folder.join("scene.toml")).unwrap(), real)
}
