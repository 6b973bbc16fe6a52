//! The things that stand in the built-in scenes. Each is made where its foot is given.

use super::material::{Albedo, Material};
use super::mesh::{Mesh, MeshData};
use super::scene::{Key, Motion, Object};
use super::shape::Shape;
use glam::{Quat, Vec2, Vec3, Vec3A, vec2, vec3};
use std::f32::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

pub fn vec_a(r: f32, g: f32, b: f32) -> Vec3A {
    Vec3A::new(r, g, b)
}

pub fn wood(dark: [f32; 3], light: [f32; 3], cell: f32) -> Material {
    let colors = [Vec3A::from_array(dark), Vec3A::from_array(light)];
    Material::of(Albedo::Grain { colors, cell })
}

pub fn floor(z: f32, half: f32, material: Material) -> Object {
    Object::new(Shape::Quad { half: Vec2::splat(half) }, material, vec3(0.0, 0.0, z))
}

/// Upright in the plane y = `y`.
pub fn wall_behind(y: f32, half: f32, material: Material) -> Object {
    Object::new(Shape::Quad { half: Vec2::splat(half) }, material, vec3(0.0, y, 0.0))
        .rotated(Quat::from_rotation_x(FRAC_PI_2))
}

/// A framed abstract on a wall behind.
pub fn picture(at: Vec3, width: f32, height: f32) -> Vec<Object> {
    let frame = Material::diffuse(0.10, 0.07, 0.05).coated(0.4);
    let paper = Material::diffuse(0.60, 0.58, 0.52);
    let shape = |w: f32, h: f32, d: f32| Shape::block(w, d, h);
    let mut out = vec![
        Object::new(shape(width, height, 0.024), frame, at),
        Object::new(shape(width - 0.04, height - 0.04, 0.028), paper, at),
    ];
    let patches = [
        (-0.25, 0.10, 0.22, 0.42, [0.10, 0.22, 0.38]),
        (0.08, -0.12, 0.30, 0.30, [0.55, 0.30, 0.08]),
        (0.28, 0.18, 0.16, 0.24, [0.42, 0.08, 0.08]),
        (-0.12, -0.26, 0.34, 0.12, [0.08, 0.26, 0.16]),
    ];
    for (x, z, w, h, [r, g, b]) in patches {
        let offset = vec3(x * width, 0.0, z * height);
        let patch = shape(w * width, h * height, 0.030);
        out.push(Object::new(patch, Material::diffuse(r, g, b), at + offset));
    }
    out
}

/// Top at z = 0.
pub fn table(width: f32, depth: f32) -> Vec<Object> {
    let top = wood([0.36, 0.22, 0.12], [0.56, 0.39, 0.23], 0.022).coated(0.55);
    let leg = wood([0.20, 0.12, 0.07], [0.28, 0.18, 0.10], 0.02);
    let mut out = vec![Object::new(Shape::block(width, depth, 0.04), top, vec3(0.0, 0.0, -0.02))];
    for (sx, sy) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
        let at = vec3(sx * (width * 0.5 - 0.06), sy * (depth * 0.5 - 0.06), -0.39);
        out.push(Object::new(Shape::block(0.06, 0.06, 0.70), leg.clone(), at));
    }
    out
}

pub fn book_stack(at: Vec3) -> Vec<Object> {
    let mut out = Vec::new();
    let mut z = 0.0;
    let books = [
        (0.25, 0.18, 0.036, 14.0, [0.10, 0.20, 0.14]),
        (0.23, 0.16, 0.028, -6.0, [0.46, 0.30, 0.10]),
        (0.19, 0.13, 0.034, 24.0, [0.34, 0.07, 0.08]),
    ];
    for (width, depth, height, yaw, [r, g, b]) in books {
        let cover = Material::diffuse(r, g, b).coated(0.5);
        let lines = Albedo::Stripes {
            colors: [vec_a(0.66, 0.62, 0.52), vec_a(0.52, 0.48, 0.40)],
            axis: 2,
            period: 0.006,
            share: 0.6,
        };
        let layer = |z: f32| at + Vec3::Z * z;
        let pages = Shape::block(width - 0.012, depth - 0.012, height - 0.008);
        out.push(Object::new(pages, Material::of(lines), layer(z + height * 0.5)).yawed(yaw));
        for board in [0.002, height - 0.002] {
            let shape = Shape::block(width, depth, 0.004);
            out.push(Object::new(shape, cover.clone(), layer(z + board)).yawed(yaw));
        }
        let spine =
            Quat::from_rotation_z(f32::to_radians(yaw)) * vec3(-width * 0.5 + 0.002, 0.0, 0.0);
        let shape = Shape::block(0.004, depth, height);
        out.push(Object::new(shape, cover, layer(z + height * 0.5) + spine).yawed(yaw));
        z += height;
    }
    out
}

pub fn lathe(profile: &[Vec2], around: usize) -> Shape {
    Shape::Mesh(Arc::new(Mesh::new(MeshData::lathe(profile, around))))
}

/// A smooth curve through points (Catmull-Rom), `steps` pieces between neighbours.
pub fn curve(points: &[Vec2], steps: usize) -> Vec<Vec2> {
    let at = |i: isize| points[i.clamp(0, points.len() as isize - 1) as usize];
    let mut out = vec![points[0]];
    for i in 0..points.len() as isize - 1 {
        let [a, b, c, d] = [at(i - 1), at(i), at(i + 1), at(i + 2)];
        for k in 1..=steps {
            let t = k as f32 / steps as f32;
            let p = b * 2.0
                + (c - a) * t
                + (a * 2.0 - b * 5.0 + c * 4.0 - d) * (t * t)
                + (b * 3.0 - a - c * 3.0 + d) * (t * t * t);
            out.push(p * 0.5);
        }
    }
    out
}

pub fn vase(at: Vec3, scale: f32) -> Object {
    let outside = [
        vec2(0.042, 0.0),
        vec2(0.060, 0.03),
        vec2(0.076, 0.085),
        vec2(0.062, 0.15),
        vec2(0.034, 0.20),
        vec2(0.030, 0.235),
        vec2(0.042, 0.265),
    ];
    let mut profile = vec![vec2(0.0, 0.0), outside[0], outside[0]];
    profile.extend(curve(&outside, 6));
    let inside = [vec2(0.038, 0.266), vec2(0.026, 0.235), vec2(0.030, 0.20), vec2(0.05, 0.13)];
    profile.extend(curve(&inside, 4));
    profile.push(vec2(0.0, 0.02));
    profile.iter_mut().for_each(|p| *p *= scale);
    let glaze = Albedo::Stripes {
        colors: [vec_a(0.10, 0.26, 0.27), vec_a(0.58, 0.52, 0.40)],
        axis: 2,
        period: 0.088 * scale,
        share: 0.72,
    };
    Object::new(lathe(&profile, 72), Material::of(glaze).coated(0.3), at)
}

/// Body and handle; the handle points along the yaw.
pub fn mug(at: Vec3, yaw: f32, [r, g, b]: [f32; 3]) -> Vec<Object> {
    let profile = [
        vec2(0.0, 0.0),
        vec2(0.034, 0.0),
        vec2(0.038, 0.003),
        vec2(0.040, 0.012),
        vec2(0.040, 0.093),
        vec2(0.0388, 0.096),
        vec2(0.0368, 0.096),
        vec2(0.036, 0.093),
        vec2(0.036, 0.014),
        vec2(0.030, 0.008),
        vec2(0.0, 0.008),
    ];
    let glaze = Material::diffuse(r, g, b).coated(0.25);
    let ring = Shape::Mesh(Arc::new(Mesh::new(MeshData::torus(0.026, 0.0055, 48, 16))));
    let side = Quat::from_rotation_z(yaw.to_radians()) * vec3(0.044, 0.0, 0.05);
    let upright = Quat::from_rotation_z(yaw.to_radians()) * Quat::from_rotation_x(FRAC_PI_2);
    vec![
        Object::new(lathe(&profile, 64), glaze.clone(), at),
        Object::new(ring, glaze, at + side).rotated(upright),
    ]
}

pub fn bowl(at: Vec3) -> Object {
    let outside = [vec2(0.034, 0.0), vec2(0.036, 0.008), vec2(0.066, 0.030), vec2(0.084, 0.062)];
    let inside = [vec2(0.080, 0.062), vec2(0.062, 0.033), vec2(0.032, 0.014), vec2(0.0, 0.011)];
    let mut profile = vec![vec2(0.0, 0.0), outside[0], outside[0]];
    profile.extend(curve(&outside, 6));
    profile.extend(curve(&inside, 6));
    Object::new(lathe(&profile, 72), Material::diffuse(0.58, 0.56, 0.50).coated(0.4), at)
}

pub fn cone(at: Vec3) -> Object {
    let shape = Shape::Frustum { bottom_radius: 0.055, top_radius: 0.006, height: 0.15 };
    Object::new(shape, Material::diffuse(0.20, 0.32, 0.12), at)
}

/// Palm, fingers and sleeve around the wrist's origin; it comes from the right, stays above the
/// middle of the table's front and leaves again.
pub fn hand(motion: usize) -> (Motion, Vec<Object>) {
    let skin = Material::diffuse(0.56, 0.34, 0.25);
    let sleeve = Material::of(Albedo::Stripes {
        colors: [vec_a(0.09, 0.13, 0.26), vec_a(0.36, 0.38, 0.42)],
        axis: 2,
        period: 0.05,
        share: 0.7,
    });
    let ellipsoid = |x, y, z| Shape::Ellipsoid { radii: Vec3A::new(x, y, z) };
    // The hand points along -x, the palm looks down.
    let mut out = vec![
        Object::new(ellipsoid(0.052, 0.042, 0.017), skin.clone(), vec3(-0.045, 0.0, 0.0)),
        Object::new(ellipsoid(0.040, 0.026, 0.021), skin.clone(), vec3(0.01, 0.0, 0.0)),
    ];
    for (y, length, fan) in
        [(-0.031, 0.058, 12.0), (-0.011, 0.070, 4.0), (0.011, 0.074, -3.0), (0.030, 0.064, -10.0)]
    {
        let bend = Quat::from_rotation_z(f32::to_radians(fan)) * Quat::from_rotation_y(-0.22);
        let reach = bend * vec3(-length * 0.72, 0.0, 0.0);
        let finger = ellipsoid(length * 0.62, 0.0095, 0.0095);
        out.push(Object::new(finger, skin.clone(), vec3(-0.080, y, 0.0) + reach).rotated(bend));
    }
    let thumb = Quat::from_rotation_z(f32::to_radians(-48.0)) * Quat::from_rotation_y(-0.3);
    out.push(
        Object::new(ellipsoid(0.042, 0.012, 0.012), skin, vec3(-0.045, 0.055, -0.006))
            .rotated(thumb),
    );
    let arm = Shape::Frustum { bottom_radius: 0.034, top_radius: 0.052, height: 0.6 };
    let along_x = Quat::from_rotation_y(FRAC_PI_2);
    out.push(Object::new(arm, sleeve, vec3(0.03, 0.0, 0.0)).rotated(along_x));
    let turned = |yaw: f32, roll: f32| {
        Quat::from_rotation_z(f32::to_radians(yaw)) * Quat::from_rotation_x(f32::to_radians(roll))
    };
    let key = |time_s, position, rotation| Key { time_s, position, rotation };
    let keys = vec![
        key(0.90, vec3(0.95, -0.42, 0.26), turned(-14.0, 20.0)),
        key(1.10, vec3(0.56, -0.34, 0.20), turned(-12.0, 14.0)),
        key(1.33, vec3(0.22, -0.28, 0.14), turned(-8.0, 6.0)),
        key(1.55, vec3(0.12, -0.27, 0.11), turned(-4.0, 0.0)),
        key(1.78, vec3(0.30, -0.31, 0.15), turned(-10.0, 8.0)),
        key(2.05, vec3(0.95, -0.44, 0.27), turned(-16.0, 20.0)),
    ];
    (Motion { keys }, out.into_iter().map(|o| o.moving(motion)).collect())
}

pub fn screen(at: Vec3) -> Vec<Object> {
    let black = Material::diffuse(0.05, 0.05, 0.055).coated(0.5);
    let glow = Material {
        emission: Vec3A::new(0.05, 0.08, 0.12),
        ..Material::diffuse(0.03, 0.03, 0.03).coated(0.2)
    };
    vec![
        Object::new(Shape::block(0.24, 0.18, 0.012), black.clone(), at + Vec3::Z * 0.006),
        Object::new(Shape::block(0.05, 0.03, 0.16), black.clone(), at + vec3(0.0, 0.03, 0.09)),
        Object::new(Shape::block(0.56, 0.035, 0.33), black, at + vec3(0.0, 0.0, 0.275)),
        Object::new(Shape::block(0.53, 0.037, 0.30), glow, at + vec3(0.0, 0.0, 0.275)),
    ]
}

pub fn keyboard(at: Vec3) -> Vec<Object> {
    let case = Material::diffuse(0.14, 0.14, 0.15);
    let key = Material::diffuse(0.50, 0.50, 0.48);
    let mut out = vec![Object::new(Shape::block(0.42, 0.15, 0.014), case, at + Vec3::Z * 0.007)];
    for row in 0..5 {
        for column in 0..14 {
            let offset =
                vec3(-0.195 + 0.030 * column as f32, -0.056 + 0.028 * row as f32, 0.014 + 0.005);
            out.push(Object::new(Shape::block(0.024, 0.022, 0.010), key.clone(), at + offset));
        }
    }
    out
}

pub fn desk_lamp(at: Vec3) -> Vec<Object> {
    let metal = Material::diffuse(0.42, 0.10, 0.07).coated(0.35);
    let steel = Material::diffuse(0.30, 0.30, 0.31).coated(0.3);
    let lean = Quat::from_rotation_y(f32::to_radians(22.0));
    let elbow = at + lean * (Vec3::Z * 0.34);
    let down = Quat::from_rotation_y(f32::to_radians(125.0));
    vec![
        Object::new(Shape::cylinder(0.085, 0.02), metal.clone(), at),
        Object::new(Shape::cylinder(0.009, 0.34), steel.clone(), at).rotated(lean),
        Object::new(Shape::sphere(0.016), steel.clone(), elbow),
        Object::new(Shape::cylinder(0.009, 0.12), steel, elbow).rotated(down),
        Object::new(
            Shape::Frustum { bottom_radius: 0.022, top_radius: 0.075, height: 0.11 },
            metal,
            elbow + down * (Vec3::Z * 0.12),
        )
        .rotated(down),
    ]
}

pub fn pen_pot(at: Vec3) -> Vec<Object> {
    let pot = Material::diffuse(0.20, 0.20, 0.22);
    let mut out = vec![Object::new(Shape::cylinder(0.036, 0.09), pot, at)];
    let pens = [(0.0, [0.50, 0.10, 0.08]), (2.1, [0.10, 0.16, 0.42]), (4.0, [0.45, 0.38, 0.08])];
    for (turn, [r, g, b]) in pens {
        let lean = Quat::from_rotation_z(turn) * Quat::from_rotation_y(0.25);
        let foot = at + lean * vec3(0.0, 0.0, 0.02);
        let pen = Shape::cylinder(0.0045, 0.15);
        out.push(Object::new(pen, Material::diffuse(r, g, b), foot).rotated(lean));
    }
    out
}

pub fn low_table() -> Vec<Object> {
    let top = wood([0.40, 0.27, 0.15], [0.56, 0.42, 0.27], 0.03).coated(0.5);
    let leg = Material::diffuse(0.12, 0.12, 0.12);
    let mut out = vec![Object::new(Shape::cylinder(0.46, 0.03), top, vec3(0.0, 0.0, -0.03))];
    for i in 0..4 {
        let turn = PI * (0.25 + 0.5 * i as f32);
        let at = vec3(0.34 * turn.cos(), 0.34 * turn.sin(), -0.42);
        let splay = Quat::from_rotation_z(turn) * Quat::from_rotation_y(-0.12);
        out.push(Object::new(Shape::cylinder(0.018, 0.395), leg.clone(), at).rotated(splay));
    }
    out
}

/// Four boards with books and vessels; `at` is the middle of its foot.
pub fn shelf(at: Vec3) -> Vec<Object> {
    let board = wood([0.46, 0.38, 0.28], [0.56, 0.48, 0.37], 0.03);
    let mut out = Vec::new();
    for side in [-0.45, 0.45] {
        let block = Shape::block(0.025, 0.26, 1.35);
        out.push(Object::new(block, board.clone(), at + vec3(side, 0.0, 0.675)));
    }
    for level in 0..4 {
        let z = 0.06 + 0.42 * level as f32;
        let block = Shape::block(0.90, 0.26, 0.025);
        out.push(Object::new(block, board.clone(), at + vec3(0.0, 0.0, z)));
        out.extend(book_row(at + vec3(-0.42, -0.01, z + 0.0125), level as u32));
    }
    out.push(vase(at + vec3(0.30, 0.0, 0.4925), 1.0));
    out.push(bowl(at + vec3(0.28, 0.0, 0.9125)));
    out
}

fn book_row(start: Vec3, row: u32) -> Vec<Object> {
    let mut rng = crate::math::random::Rng::new(&[0xb00c, row]);
    let mut x = 0.0;
    let mut out = Vec::new();
    for _ in 0..11 {
        let (thick, depth, height) = (
            0.022 + 0.028 * rng.uniform(),
            0.15 + 0.06 * rng.uniform(),
            0.20 + 0.10 * rng.uniform(),
        );
        let color = [rng.uniform(), rng.uniform(), rng.uniform()].map(|v| 0.07 + 0.42 * v * v);
        let material = Material::diffuse(color[0], color[1], color[2]).coated(0.55);
        let at = start + vec3(x + thick * 0.5, 0.0, height * 0.5);
        out.push(Object::new(Shape::block(thick, depth, height), material, at));
        x += thick + 0.002;
    }
    out
}

pub fn armchair(at: Vec3) -> Vec<Object> {
    let cloth = Material::of(Albedo::Grain {
        colors: [vec_a(0.16, 0.24, 0.26), vec_a(0.22, 0.31, 0.33)],
        cell: 0.012,
    });
    let wooden = Material::diffuse(0.20, 0.12, 0.07);
    let turn = Quat::from_rotation_z(f32::to_radians(-38.0));
    let mut out = Vec::new();
    let mut add = |shape: Shape, material: &Material, offset: Vec3, tilt: Quat| {
        out.push(Object::new(shape, material.clone(), at + turn * offset).rotated(turn * tilt));
    };
    let level = Quat::IDENTITY;
    add(Shape::block(0.58, 0.56, 0.16), &cloth, vec3(0.0, 0.0, 0.36), level);
    let back = Quat::from_rotation_x(-0.18);
    add(Shape::block(0.58, 0.14, 0.55), &cloth, vec3(0.0, 0.30, 0.62), back);
    for side in [-0.33, 0.33] {
        add(Shape::block(0.09, 0.60, 0.10), &cloth, vec3(side, 0.0, 0.56), level);
        for front in [-0.24, 0.24] {
            add(Shape::cylinder(0.022, 0.52), &wooden, vec3(side, front, 0.0), level);
        }
    }
    let cushion = Shape::Ellipsoid { radii: Vec3A::new(0.20, 0.07, 0.18) };
    add(cushion, &Material::diffuse(0.50, 0.33, 0.10), vec3(0.05, 0.17, 0.60), back);
    out
}

pub fn plant(at: Vec3) -> Vec<Object> {
    let clay = Material::diffuse(0.44, 0.22, 0.13);
    let leaf = Material::diffuse(0.10, 0.25, 0.08).coated(0.45);
    let pot = Shape::Frustum { bottom_radius: 0.10, top_radius: 0.14, height: 0.24 };
    let mut out = vec![Object::new(pot, clay, at)];
    let mut rng = crate::math::random::Rng::new(&[0x9_1a27]);
    for i in 0..26 {
        let turn = 2.4 * i as f32;
        let up = 0.30 + 0.022 * i as f32;
        let lean = 0.9 - 0.02 * i as f32 + 0.2 * rng.uniform();
        let pose = Quat::from_rotation_z(turn) * Quat::from_rotation_y(lean);
        let blade = Shape::Ellipsoid { radii: Vec3A::new(0.035, 0.006, 0.13) };
        let foot = at + vec3(0.0, 0.0, up);
        out.push(
            Object::new(blade, leaf.clone(), foot + pose * (Vec3::Z * 0.12))
                .rotated(pose * Quat::from_rotation_z(FRAC_PI_2)),
        );
    }
    let stem = Shape::cylinder(0.012, 0.72);
    out.push(Object::new(stem, leaf, at + Vec3::Z * 0.2));
    out
}
