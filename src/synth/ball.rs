//! A ball in two colours that stands on its origin, +y up, as glTF wants it.

use super::mesh::MeshData;
use super::sampler::sin_cos_turns;
use crate::image::{Image, Size};
use crate::math::color::srgb8_from_linear;
use glam::{Vec2, Vec3A};

pub const RADIUS_M: f32 = 0.07;
/// Facets of 2 mm: the outline is within 0.1 % of the radius.
const ROWS: usize = 64;
const COLUMNS: usize = 128;
const TEXTURE: Size = Size::new(256, 4);

/// Mesh and sRGB texture; linear albedo of the half at -x and of that at +x.
pub fn painted(albedo: [[f32; 3]; 2]) -> (MeshData, Image<[u8; 3]>) {
    let mut mesh = MeshData::default();
    mesh.add_grid(ROWS + 1, COLUMNS + 1, |row, column| {
        let (u, v) = (column as f32 / COLUMNS as f32, row as f32 / ROWS as f32);
        // From the foot upwards, counter-clockwise seen from above (z up), then turned to y up.
        let (sin_polar, cos_polar) = sin_cos_turns(0.5 * v);
        let (sin, cos) = sin_cos_turns(u);
        let normal = Vec3A::new(sin_polar * cos, -cos_polar, -sin_polar * sin);
        (normal * RADIUS_M + Vec3A::Y * RADIUS_M, normal.normalize(), Vec2::new(u, v))
    });
    let [left, right] = albedo.map(|rgb| rgb.map(srgb8_from_linear));
    let quarter = TEXTURE.width / 4;
    let texel = |i: usize| {
        let x = i % TEXTURE.width;
        if (quarter..3 * quarter).contains(&x) { left } else { right }
    };
    (mesh, Image::from_vec(TEXTURE, (0..TEXTURE.pixels()).map(texel).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::bvh::Ray;
    use crate::synth::mesh::Mesh;

    #[test]
    fn a_ball_on_its_origin_with_its_colours_left_and_right() {
        let (data, texture) = painted([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        let mesh = Mesh::new(data);
        for x in [-0.05f32, -0.004, 0.004, 0.05] {
            for y in [0.03f32, 0.07, 0.11] {
                let ray = Ray::new(Vec3A::new(x, y, 1.0), -Vec3A::Z);
                let hit = mesh.hit(&ray, 9.0).expect("the ball is in the way");
                let radius = (ray.at(hit.t) - Vec3A::Y * RADIUS_M).length();
                assert!((radius / RADIUS_M - 1.0).abs() < 1e-3, "{radius}");
                assert!(mesh.face_normal(hit.triangle).z > 0.0, "faces look outwards");
                let (normal, uv) = mesh.surface(hit.triangle, hit.weights);
                assert!(normal.dot(ray.at(hit.t) - Vec3A::Y * RADIUS_M) > 0.999 * RADIUS_M);
                let texel = texture[((uv.x * 256.0) as usize, (uv.y * 4.0) as usize)];
                assert_eq!(texel, if x < 0.0 { [255, 0, 0] } else { [0, 255, 0] }, "{x} {y}");
            }
        }
    }
}
