//! Textures on slanted and stretched planes, against stripes known exactly.

use super::*;
use crate::scene::Wrap;

const SIDE: usize = 256;
const PIXELS_PER_M: f32 = 128.0;

/// Repeating stripes across u or v, white first, `half_period` texels each.
fn stripes(across: usize, half_period: usize) -> Arc<Texture> {
    let texels = (0..SIDE * SIDE).map(|i| [i % SIDE, i / SIDE][across] / half_period % 2);
    let texels = texels.map(|dark| if dark == 0 { [255; 4] } else { [0, 0, 0, 255] }).collect();
    Arc::new(Texture::new(SIDE, SIDE, texels, [Wrap::Repeat; 2]).unwrap())
}

/// A plane with `density` texels a pixel where it is seen face-on from [`distance`].
fn striped_plane(texture: Arc<Texture>, density: Vec2) -> Arc<Model> {
    let half = 4.0;
    let corners = [(-half, -half), (half, -half), (half, half), (-half, half)]
        .map(|(x, y)| Vec3::new(x, y, 0.0));
    let material = Material { texture: Some(texture), ..Default::default() };
    let mut part = quad(corners, material);
    for v in &mut part.vertices {
        v.uv = v.position.truncate() * density * PIXELS_PER_M / SIDE as f32;
    }
    model(part)
}

/// From the eye to the middle of the plane: where a metre is as many pixels wide in both views.
fn distance() -> f32 {
    pinhole(160, 120).scale_and_centre().0.x / PIXELS_PER_M
}

/// Red of every pixel of the plane, and the texture coordinates at its centre in texels.
fn shown(view: View, plane: Arc<Model>, density: Vec2, turn: Quat) -> Vec<(f32, Vec2)> {
    let pose =
        Similarity { rotation: turn, scale: 1.0, translation: Vec3::new(0.001, 0.002, distance()) };
    let picture = draw(&[VirtualObject::placed(plane, pose)], &GBuffer::empty(view));
    let size = view.size();
    let all = (0..size.height).flat_map(|y| (0..size.width).map(move |x| (x, y)));
    all.filter(|&at| picture.merged.origin[at] == Origin::Virtual)
        .map(|(x, y)| {
            let pixel = Vec2::new(x as f32, y as f32);
            let point = view.unproject(pixel, picture.merged.depth_m[(x, y)]);
            let on_plane = pose.affine().inverse().transform_point3(point);
            let texel = on_plane.truncate() * density * PIXELS_PER_M;
            (picture.layer.albedo[(x, y)][0], texel)
        })
        .collect()
}

/// Face-on, 80 degrees from it, and the same turned on the screen so that the stripes lie aslant.
fn turns() -> [Quat; 4] {
    let (slant, roll) = (Quat::from_rotation_x(1.4), Quat::from_rotation_z(0.7));
    [Quat::IDENTITY, roll, slant, roll * slant]
}

#[test]
fn stripes_a_pixel_resolves_keep_their_contrast() {
    for view in [ortho(160, 120, PIXELS_PER_M), pinhole(160, 120)] {
        let reach = if view.is_perspective() { 24.0 } else { f32::INFINITY };
        for (turn, density) in turns()
            .into_iter()
            .flat_map(|turn| [Vec2::ONE, Vec2::new(1.0, 6.0)].map(|density| (turn, density)))
            // 36 texels a pixel is more than the taps reach
            .filter(|(turn, density)| density.y == 1.0 || (*turn * Vec3::Y).z.abs() < 0.5)
        {
            let plane = striped_plane(stripes(0, 8), density);
            let seen = shown(view, plane, density, turn);
            let mut checked = 0;
            for (red, texel) in seen {
                let along = texel.x.rem_euclid(16.0);
                let to_edge = 4.0 - (along.rem_euclid(8.0) - 4.0).abs();
                // Taps reach two texels where they are up to two wide. In perspective, more texels
                // lie across a row beside the middle: 24 * 0.055 here, half of it to either side.
                if to_edge < 3.0 || texel.abs().max_element() > reach {
                    continue;
                }
                let expected = if along < 8.0 { 1.0 } else { 0.0 };
                assert!((red - expected).abs() < 0.02, "{turn} {density}: {red} at {texel}");
                checked += 1;
            }
            assert!(checked > 60, "{turn} {density}: {checked}");
        }
    }
}

#[test]
fn stripes_finer_than_a_pixel_become_their_mean() {
    for view in [ortho(160, 120, PIXELS_PER_M), pinhole(160, 120)] {
        for turn in &turns()[2..] {
            let plane = striped_plane(stripes(1, 1), Vec2::ONE);
            let seen = shown(view, plane, Vec2::ONE, *turn);
            // In the far half a pixel is at least 5.9 texels long in perspective too. Without the slack
            // of the bilinear filter, 7 taps on black and white texels leave 1/14.
            for (red, texel) in seen.into_iter().filter(|(_, texel)| texel.y >= 0.0) {
                assert!((red - 0.5).abs() < 0.1, "{turn}: {red} at {texel}");
            }
        }
    }
}
