//! Curved things of the scene `still-life`. Each is made where its foot is given.

use super::material::{Albedo, Material};
use super::mesh::{Mesh, MeshData};
use super::props::{curve, lathe, vec_a};
use super::sampler::sin_cos_turns;
use super::scene::Object;
use super::shape::Shape;
use glam::{Quat, Vec2, Vec3, Vec3A, vec2};
use std::f32::consts::FRAC_PI_2;
use std::sync::Arc;

fn turned(points: &[Vec2], around: usize) -> Shape {
    let mut profile = vec![vec2(0.0, points[0].y), points[0], points[0]];
    profile.extend(curve(points, 6));
    profile.push(vec2(0.0, profile[profile.len() - 1].y));
    lathe(&profile, around)
}

pub fn bottle(at: Vec3) -> Object {
    let outside = [
        vec2(0.036, 0.0),
        vec2(0.039, 0.02),
        vec2(0.039, 0.14),
        vec2(0.030, 0.175),
        vec2(0.015, 0.205),
        vec2(0.013, 0.26),
        vec2(0.016, 0.265),
        vec2(0.015, 0.285),
    ];
    let glass = Material::diffuse(0.07, 0.18, 0.09).coated(0.25);
    Object::new(turned(&outside, 64), glass, at)
}

pub fn goblet(at: Vec3) -> Object {
    let outside = [
        vec2(0.040, 0.0),
        vec2(0.036, 0.006),
        vec2(0.009, 0.016),
        vec2(0.008, 0.055),
        vec2(0.016, 0.075),
        vec2(0.040, 0.105),
        vec2(0.045, 0.150),
    ];
    let inside = [vec2(0.041, 0.150), vec2(0.036, 0.108), vec2(0.014, 0.085), vec2(0.0, 0.082)];
    let mut profile = vec![vec2(0.0, 0.0), outside[0], outside[0]];
    profile.extend(curve(&outside, 6));
    profile.extend(curve(&inside, 5));
    Object::new(lathe(&profile, 72), Material::diffuse(0.52, 0.47, 0.40).coated(0.35), at)
}

pub fn plate(at: Vec3) -> Object {
    let outside = [vec2(0.062, 0.0), vec2(0.066, 0.006), vec2(0.098, 0.014), vec2(0.125, 0.022)];
    let inside = [vec2(0.122, 0.026), vec2(0.095, 0.018), vec2(0.066, 0.011), vec2(0.0, 0.010)];
    let mut profile = vec![vec2(0.0, 0.0), outside[0], outside[0]];
    profile.extend(curve(&outside, 5));
    profile.extend(curve(&inside, 5));
    Object::new(lathe(&profile, 96), Material::diffuse(0.60, 0.60, 0.57).coated(0.4), at)
}

pub fn pear(at: Vec3, lean: f32) -> Object {
    let outside = [
        vec2(0.012, 0.0),
        vec2(0.034, 0.010),
        vec2(0.043, 0.036),
        vec2(0.034, 0.066),
        vec2(0.020, 0.088),
        vec2(0.015, 0.104),
        vec2(0.004, 0.112),
    ];
    let skin = Material::diffuse(0.48, 0.42, 0.10);
    Object::new(turned(&outside, 56), skin, at).rotated(Quat::from_rotation_y(lean))
}

pub fn apple(at: Vec3, [r, g, b]: [f32; 3]) -> Object {
    let outside = [
        vec2(0.010, 0.004),
        vec2(0.024, 0.0),
        vec2(0.038, 0.020),
        vec2(0.042, 0.044),
        vec2(0.031, 0.068),
        vec2(0.014, 0.070),
        vec2(0.004, 0.060),
    ];
    Object::new(turned(&outside, 56), Material::diffuse(r, g, b).coated(0.45), at)
}

/// A gourd on its side.
pub fn gourd(at: Vec3, yaw: f32) -> Object {
    let outside = [
        vec2(0.010, 0.0),
        vec2(0.052, 0.022),
        vec2(0.066, 0.070),
        vec2(0.048, 0.125),
        vec2(0.030, 0.165),
        vec2(0.034, 0.205),
        vec2(0.022, 0.240),
        vec2(0.005, 0.248),
    ];
    let skin = Albedo::Stripes {
        colors: [vec_a(0.55, 0.30, 0.07), vec_a(0.40, 0.19, 0.04)],
        axis: 2,
        period: 0.04,
        share: 0.6,
    };
    let lying = Quat::from_rotation_z(yaw.to_radians()) * Quat::from_rotation_y(FRAC_PI_2 - 0.09);
    let middle = at + Vec3::Z * 0.064;
    Object::new(turned(&outside, 64), Material::of(skin), middle).rotated(lying)
}

/// A ring on the table, leaning on nothing.
pub fn ring(at: Vec3, radius: f32, thickness: f32) -> Object {
    let shape = Shape::Mesh(Arc::new(Mesh::new(MeshData::torus(radius, thickness, 72, 24))));
    Object::new(shape, Material::diffuse(0.30, 0.33, 0.40), at + Vec3::Z * thickness)
}

/// Hangs in folds before a wall at y = `wall_y` and runs out over the table.
pub fn drapery(wall_y: f32, width: f32) -> Object {
    let (rows, columns) = (72, 160);
    let at =
        |row: f32, column: f32| fold(wall_y, row / rows as f32, column / columns as f32, width);
    let mut mesh = MeshData::default();
    // Rows run from the table's end upwards, so that faces look into the room.
    mesh.add_grid(rows + 1, columns + 1, |row, column| {
        let (r, c) = (row as f32, column as f32);
        let (along, across) = (at(r + 0.5, c) - at(r - 0.5, c), at(r, c + 0.5) - at(r, c - 0.5));
        (at(r, c), across.cross(along).normalize(), Vec2::new(c, r))
    });
    let cloth =
        Albedo::Grain { colors: [vec_a(0.30, 0.32, 0.36), vec_a(0.40, 0.41, 0.43)], cell: 0.03 };
    Object::new(Shape::Mesh(Arc::new(Mesh::new(mesh))), Material::of(cloth), Vec3::ZERO)
}

/// A point of the cloth: `s` in [0, 1] from its edge on the table to its upper edge, `w` in [0, 1]
/// from left to right.
fn fold(wall_y: f32, s: f32, w: f32, width: f32) -> Vec3A {
    const LYING_M: f32 = 0.26;
    const BEND_M: f32 = 0.12;
    const HANGING_M: f32 = 0.62;
    let bend_length = BEND_M * FRAC_PI_2;
    let length = s * (LYING_M + bend_length + HANGING_M);
    let front = wall_y - 0.07;
    let lying_end = front - BEND_M;
    // On the profile: a straight, a quarter circle, a straight; `out` is its normal.
    let (y, z, out) = if length < LYING_M {
        (lying_end - LYING_M + length, 0.0, Vec3A::Z)
    } else if length < LYING_M + bend_length {
        let (sin, cos) = sin_cos_turns((length - LYING_M) / BEND_M / std::f32::consts::TAU);
        (lying_end + BEND_M * sin, BEND_M * (1.0 - cos), Vec3A::new(0.0, -sin, cos))
    } else {
        (front, BEND_M + length - LYING_M - bend_length, -Vec3A::Y)
    };
    let wave = |turns: f32| sin_cos_turns(turns.rem_euclid(1.0)).0;
    // Folds grow from flat on the table to deep on the wall, and wander as they fall.
    let depth = 0.035 * (s * 1.4 - 0.1).clamp(0.0, 1.0);
    let folds = 0.6 * wave(6.0 * w + 0.35 * s) + 0.4 * wave(10.3 * w - 0.5 * s + 0.2);
    let lift = 0.003 + 0.004 * (1.0 + wave(3.0 * w + 2.0 * s));
    Vec3A::new((w - 0.5) * width, y, z) + out * (depth * (1.0 + folds) + lift)
}
