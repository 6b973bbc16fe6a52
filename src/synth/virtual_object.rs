//! The figure that is shipped as the virtual object: a trefoil knot on a turned foot, 18 cm high,
//! made here, with a texture made here. It stands on its origin with +y up, as glTF wants it.

use super::material::value_noise;
use super::mesh::MeshData;
use super::sampler::sin_cos_turns;
use crate::image::{Image, Size};
use crate::math::color::srgb8_from_linear;
use crate::scene::{Material, Model, PartData, Texture, Vertex, Wrap};
use glam::{Affine3A, Quat, Vec2, Vec3, Vec3A};
use std::sync::Arc;

const TEXTURE: Size = Size::new(512, 512);
/// The knot's texture lies above this v, the foot's below.
const SEAM: f32 = 0.7;
const ALONG: usize = 360;
const ACROSS: usize = 20;
const FOOT_AROUND: usize = 72;
const KNOT_CENTRE_M: f32 = 0.129;

/// Mesh (+y up, origin at the middle of the foot's underside) and sRGB texture.
pub fn figure() -> (MeshData, Image<[u8; 3]>) {
    let mut mesh = foot();
    add_knot(&mut mesh);
    // Made with +z up; +z -> +y keeps the handedness with y -> -z.
    for v in mesh.positions.iter_mut().chain(&mut mesh.normals) {
        *v = Vec3A::new(v.x, v.z, -v.y);
    }
    (mesh, texture())
}

/// The figure as a model to compose.
pub fn model() -> Model {
    let (mesh, picture) = figure();
    let corners = mesh.positions.iter().zip(&mesh.normals).zip(&mesh.uvs);
    let vertices = corners
        .map(|((&p, &n), &uv)| Vertex { position: p.into(), normal: n.into(), uv })
        .collect();
    let texels = picture.as_slice().iter().map(|&[r, g, b]| [r, g, b, 255]).collect();
    let texture =
        Texture::new(picture.width(), picture.height(), texels, [Wrap::Repeat; 2]).map(Arc::new);
    let material = Material { texture, ..Material::default() };
    let part = PartData { vertices, triangles: mesh.triangles, material, ..PartData::default() };
    Model::new("figure", vec![part]).expect("the figure's triangles name its own corners")
}

/// Where a glTF object (+y up) stands in a world with +z up: turned by `yaw_deg` about the world's
/// +z. Scale is of positions alone.
pub fn world_from_figure(at: Vec3, yaw_deg: f32) -> Affine3A {
    let upright = Quat::from_rotation_x(std::f32::consts::FRAC_PI_2);
    let yaw = Quat::from_rotation_z(yaw_deg.to_radians());
    Affine3A::from_rotation_translation(yaw * upright, at)
}

/// A stepped foot with a short stem that reaches into the knot.
fn foot() -> MeshData {
    let mut profile = vec![Vec2::new(0.0, 0.0), Vec2::new(0.046, 0.0), Vec2::new(0.046, 0.0)];
    let mut corner = |from: Vec2, to: Vec2, bulge: Vec2| {
        for i in 0..=6 {
            let t = i as f32 / 6.0;
            let (a, b, c) = ((1.0 - t) * (1.0 - t), 2.0 * t * (1.0 - t), t * t);
            profile.push(from * a + bulge * b + to * c);
        }
    };
    corner(Vec2::new(0.046, 0.0), Vec2::new(0.046, 0.012), Vec2::new(0.050, 0.006));
    corner(Vec2::new(0.0455, 0.0125), Vec2::new(0.034, 0.018), Vec2::new(0.036, 0.0125));
    corner(Vec2::new(0.0335, 0.0185), Vec2::new(0.013, 0.038), Vec2::new(0.014, 0.019));
    corner(Vec2::new(0.0128, 0.039), Vec2::new(0.008, 0.066), Vec2::new(0.0095, 0.046));
    profile.push(Vec2::new(0.008, 0.066));
    profile.push(Vec2::new(0.0, 0.066));
    let mut mesh = MeshData::lathe(&profile, FOOT_AROUND);
    for (uv, p) in mesh.uvs.iter_mut().zip(&mesh.positions) {
        // By height and radius, so that the texture does not jump between the lathe's pieces.
        let along = (p.z + p.x.hypot(p.y)) / 0.1;
        *uv = Vec2::new(uv.x, SEAM + 0.01 + (0.98 - SEAM) * along.clamp(0.0, 1.0));
    }
    mesh
}

/// Centre line of a trefoil, upright: its plane is x-z.
fn trefoil(turns: f32) -> Vec3A {
    let (s1, c1) = sin_cos_turns(turns.rem_euclid(1.0));
    let (s2, c2) = sin_cos_turns((2.0 * turns).rem_euclid(1.0));
    let (s3, _) = sin_cos_turns((3.0 * turns).rem_euclid(1.0));
    Vec3A::new(s1 + 2.0 * s2, -1.1 * s3, c1 - 2.0 * c2) * 0.0197
}

fn add_knot(mesh: &mut MeshData) {
    let centre = Vec3A::new(0.0, 0.0, KNOT_CENTRE_M);
    mesh.add_grid(ALONG + 1, ACROSS + 1, |row, column| {
        let (u, v) = (row as f32 / ALONG as f32, column as f32 / ACROSS as f32);
        let tangent = (trefoil(u + 1e-3) - trefoil(u - 1e-3)).normalize();
        // The direction from the knot's middle gives a frame that closes after one turn.
        let middle = trefoil(u);
        let side = tangent.cross(middle).normalize();
        let out = side.cross(tangent);
        let (sin, cos) = sin_cos_turns(v);
        let normal = out * cos + side * sin;
        (centre + middle + normal * 0.0105, normal, Vec2::new(u, 0.01 + (SEAM - 0.02) * v))
    });
}

/// Above: glazed bands around the tube. Below: dark wood for the foot.
fn texture() -> Image<[u8; 3]> {
    let mut out = Image::new(TEXTURE, [0; 3]);
    let (teal, cream) = (Vec3A::new(0.02, 0.22, 0.24), Vec3A::new(0.72, 0.62, 0.44));
    let copper = Vec3A::new(0.45, 0.14, 0.05);
    let (dark, light) = (Vec3A::new(0.06, 0.03, 0.015), Vec3A::new(0.16, 0.08, 0.04));
    for y in 0..TEXTURE.height {
        let v = (y as f32 + 0.5) / TEXTURE.height as f32;
        for x in 0..TEXTURE.width {
            let u = (x as f32 + 0.5) / TEXTURE.width as f32;
            let color = if v < SEAM {
                // 24 twisted bands; noise on a circle, so that the texture closes
                let (sin, cos) = sin_cos_turns(u);
                let speck = value_noise(Vec3A::new(sin * 9.0, cos * 9.0, v * 9.0), 71);
                let phase = (u * 24.0 + v / SEAM + 0.25 * speck).rem_euclid(1.0);
                let band = smooth_step(0.0, 0.08, phase) * (1.0 - smooth_step(0.55, 0.63, phase));
                let line = smooth_step(0.70, 0.74, phase) * (1.0 - smooth_step(0.84, 0.88, phase));
                cream.lerp(teal, band).lerp(copper, line) * (0.85 + 0.3 * speck)
            } else {
                let (sin, cos) = sin_cos_turns(u);
                let p = Vec3A::new(sin * 2.0, cos * 2.0, v * 60.0);
                dark.lerp(light, value_noise(p, 29))
            };
            out[(x, y)] = color.to_array().map(srgb8_from_linear);
        }
    }
    out
}

fn smooth_step(from: f32, to: f32, x: f32) -> f32 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::bvh::Aabb;

    #[test]
    fn stands_on_its_origin_and_is_18_cm_high() {
        let (mesh, _) = figure();
        let bounds = Aabb::of_points(mesh.positions.iter().copied());
        assert!(bounds.min.y.abs() < 1e-6, "{bounds:?}");
        assert!((bounds.max.y - 0.18).abs() < 0.005, "{bounds:?}");
        assert!(bounds.max.x < 0.08 && bounds.min.x > -0.08);
        assert!((10_000..20_000).contains(&mesh.triangles.len()), "{}", mesh.triangles.len());
    }

    #[test]
    fn normals_are_unit_and_on_the_side_that_triangles_face() {
        let (mesh, _) = figure();
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(|i| mesh.positions[i as usize]);
            let face = (b - a).cross(c - a).normalize();
            for i in triangle {
                let normal = mesh.normals[*i as usize];
                assert!((normal.length() - 1.0).abs() < 1e-4);
                assert!(normal.dot(face) > 0.5, "{normal} on a face towards {face}");
            }
        }
    }

    #[test]
    fn up_is_up_in_the_world() {
        let pose = world_from_figure(Vec3::new(0.1, 0.2, 0.3), 90.0);
        let tip = pose.transform_point3(Vec3::new(0.05, 0.18, 0.0));
        assert!((tip - Vec3::new(0.1, 0.25, 0.48)).length() < 1e-6, "{tip}");
    }
}
