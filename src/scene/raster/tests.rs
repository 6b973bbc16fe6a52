mod textures;

use super::*;
use crate::image::Image;
use crate::math::{Orthographic, Pinhole, Pose, Projection, random::Rng};
use crate::scene::analytic::{AnalyticScene, Shape};
use crate::scene::{Material, Model, PartData, Similarity, Texture, Vertex, VirtualObject};
use glam::{Quat, Vec2};
use std::f32::consts::{PI, TAU};
use std::sync::Arc;

pub(crate) fn quad(corners: [Vec3; 4], material: Material) -> PartData {
    let uvs = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
    let vertices =
        (0..4).map(|i| Vertex { position: corners[i], normal: Vec3::ZERO, uv: uvs[i] }).collect();
    PartData { vertices, triangles: vec![[0, 1, 2], [0, 2, 3]], material, ..Default::default() }
}

pub(crate) fn model(part: PartData) -> Arc<Model> {
    Arc::new(Model::new("test", vec![part]).unwrap())
}

pub(crate) fn sphere(radius: f32, stacks: u32) -> Arc<Model> {
    let slices = 2 * stacks;
    let vertices = (0..=stacks)
        .flat_map(|i| (0..=slices).map(move |j| (i, j)))
        .map(|(i, j)| {
            let (theta, phi) = (PI * i as f32 / stacks as f32, TAU * j as f32 / slices as f32);
            let (s, c) = theta.sin_cos();
            let normal = Vec3::new(s * phi.sin(), c, s * phi.cos());
            let uv = Vec2::new(j as f32 / slices as f32, i as f32 / stacks as f32);
            Vertex { position: radius * normal, normal, uv }
        })
        .collect();
    let at = |i: u32, j: u32| i * (slices + 1) + j;
    let triangles = (0..stacks)
        .flat_map(|i| (0..slices).map(move |j| (i, j)))
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    model(PartData { vertices, triangles, ..Default::default() })
}

/// Faces without vertex normals: flat.
pub(crate) fn cuboid(half: Vec3) -> Arc<Model> {
    let vertices = (0..8)
        .map(|i| {
            let sign = |bit: u32| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
            let position = half * Vec3::new(sign(0), sign(1), sign(2));
            Vertex { position, ..Default::default() }
        })
        .collect();
    let faces =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    model(PartData { vertices, triangles, ..Default::default() })
}

pub(crate) fn at(model: Arc<Model>, translation: Vec3) -> VirtualObject {
    VirtualObject::placed(model, Similarity { translation, ..Similarity::IDENTITY })
}

pub(crate) fn pinhole(width: usize, height: usize) -> View {
    let f = width as f32 * 0.82;
    let (cx, cy) = ((width as f32 - 1.0) / 2.0, (height as f32 - 1.0) / 2.0);
    View::perspective(Pinhole { width, height, fx: f, fy: f, cx, cy }, Pose::identity())
}

pub(crate) fn ortho(width: usize, height: usize, pixels_per_m: f32) -> View {
    let (cx, cy) = ((width as f32 - 1.0) / 2.0, (height as f32 - 1.0) / 2.0);
    let projection = Projection::Orthographic(Orthographic { width, height, pixels_per_m, cx, cy });
    View { projection, world_from_view: Pose::identity() }
}

/// Somewhere, turned about all axes.
pub(crate) fn moved(view: View) -> View {
    let world_from_view =
        Pose::new(nalgebra::Vector3::new(0.3, -0.2, 0.5), nalgebra::Vector3::new(0.4, -0.7, 0.2));
    View { world_from_view, ..view }
}

struct Picture {
    merged: GBuffer,
    layer: VirtualLayer,
    report: DrawReport,
}

/// Draws into buffers full of wrong values.
fn draw(objects: &[VirtualObject], real: &GBuffer) -> Picture {
    let mut merged = GBuffer::empty(real.view);
    merged.depth_m.fill(7.7);
    merged.normals.x.fill(7.7);
    merged.origin.fill(Origin::Virtual);
    let size = real.size();
    let mut layer =
        VirtualLayer { albedo: Image::new(size, [7.7; 3]), coverage: Image::new(size, 7.7) };
    let scene = VirtualScene::from_objects(objects);
    let report = Rasteriser::default().draw(&scene, real, &mut merged, &mut layer);
    Picture { merged, layer, report }
}

fn coverage_sum(picture: &Picture) -> f64 {
    picture.layer.coverage.as_slice().iter().map(|&c| f64::from(c)).sum()
}

fn same(a: &GBuffer, b: &GBuffer) -> bool {
    a.view == b.view && a.depth_m == b.depth_m && a.normals == b.normals && a.origin == b.origin
}

/// Pixels whose 3x3 neighbours all show a surface with about the same normal.
fn interior(expected: &GBuffer) -> Vec<(usize, usize)> {
    let size = expected.size();
    (1..size.height - 1)
        .flat_map(|y| (1..size.width - 1).map(move |x| (x, y)))
        .filter(|&(x, y)| {
            let normal = expected.normals.at(x, y);
            (0..9).all(|i| {
                let (u, v) = (x + i % 3 - 1, y + i / 3 - 1);
                expected.depth_m[(u, v)] > 0.0 && expected.normals.at(u, v).dot(normal) > 0.8
            })
        })
        .collect()
}

#[test]
fn sphere_agrees_with_the_analytic_one() {
    let (radius, stacks) = (0.25, 96);
    for view in [moved(pinhole(160, 120)), moved(ortho(160, 120, 200.0))] {
        let in_view = nalgebra::Point3::new(0.05, -0.03, 1.1);
        let centre = (view.world_from_view * in_view).coords;
        let centre = Vec3::new(centre.x as f32, centre.y as f32, centre.z as f32);
        let expected = AnalyticScene::new([Shape::Sphere { centre, radius }]).render(&view);
        let got = draw(&[at(sphere(radius, stacks), centre)], &GBuffer::empty(view)).merged;
        let mut checked = 0;
        for (x, y) in interior(&expected) {
            let pixel = Vec2::new(x as f32, y as f32);
            let eye = view.world_from_view_f32().transform_vector3(view.towards_eye(pixel));
            let facing = expected.normals.at(x, y).dot(eye);
            if facing < 0.3 {
                continue; // near the silhouette the chord's height counts times 1 / cos
            }
            checked += 1;
            // Facets lie inside the sphere by at most r (1 - cos(a / 2) ^ 2), a = pi / stacks.
            let chord = radius * (PI / stacks as f32 / 2.0).powi(2);
            let gap = got.depth_m[(x, y)] - expected.depth_m[(x, y)];
            assert!(gap > -1e-5 && gap < 1.1 * chord / facing + 1e-5, "{x} {y}: {gap}");
            // That gap along the ray moves the normal by gap / r; interpolation adds a^2 / 8.
            let angle = got.normals.at(x, y).dot(expected.normals.at(x, y)).min(1.0).acos();
            assert!(angle < 2e-3, "{x} {y}: {angle}");
            assert_eq!(got.origin[(x, y)], Origin::Virtual);
        }
        assert!(checked > 1500, "{checked}");
    }
}

#[test]
fn box_agrees_with_the_analytic_one() {
    let (half, centre) = (Vec3::new(0.2, 0.15, 0.3), Vec3::new(0.1, -0.1, 1.4));
    let shape = Shape::Box { min: centre - half, max: centre + half };
    let turned =
        Pose::new(nalgebra::Vector3::new(0.6, -0.7, 0.2), nalgebra::Vector3::new(-0.5, -0.4, 0.1));
    for view in [pinhole(160, 120), ortho(160, 120, 150.0)] {
        let view = View { world_from_view: turned, ..view };
        let expected = AnalyticScene::new([shape]).render(&view);
        let got = draw(&[at(cuboid(half), centre)], &GBuffer::empty(view)).merged;
        let pixels = interior(&expected);
        assert!(pixels.len() > 1000, "{}", pixels.len());
        for (x, y) in pixels {
            let gap = (got.depth_m[(x, y)] - expected.depth_m[(x, y)]).abs();
            // f32 pixel coordinates are good to 1e-4 pixel; steep faces are 0.1 m deep a pixel
            assert!(gap < 2e-5, "{x} {y}: {gap}");
            assert!(got.normals.at(x, y).dot(expected.normals.at(x, y)) > 1.0 - 1e-5);
        }
        // Along silhouettes the centre may fall either side by 1/512 pixel, no more.
        let differ = (0..view.size().pixels()).filter(|&i| {
            (got.depth_m.as_slice()[i] > 0.0) != (expected.depth_m.as_slice()[i] > 0.0)
        });
        assert!(differ.count() <= 2);
    }
}

#[test]
fn triangles_with_common_edges_cover_each_sample_once() {
    // A grid of jittered vertices, some of them exactly on samples, wider than the picture.
    let mut rng = Rng::new(&[11]);
    let (n, view) = (9, ortho(67, 43, 1.0));
    let mut point = |i: usize, j: usize| {
        let on_centre = rng.uniform() < 0.3;
        let mut coordinate = |k: usize| {
            let c = (k as f32 - 4.0) * 11.0 + 6.0 * (rng.uniform() - 0.5);
            if on_centre { c.round() } else { c }
        };
        Vec3::new(coordinate(i), coordinate(j), 1.0)
    };
    let points: Vec<Vec3> = (0..n * n).map(|k| point(k % n, k / n)).collect();
    let mut sum = Image::new(view.size(), 0.0f32);
    for cell in 0..(n - 1) * (n - 1) {
        let a = cell % (n - 1) + cell / (n - 1) * n;
        for triangle in [[a, a + 1, a + n], [a + n + 1, a + n, a + 1]] {
            let vertices =
                triangle.map(|i| Vertex { position: points[i], ..Default::default() }).to_vec();
            let part = PartData { vertices, triangles: vec![[0, 1, 2]], ..Default::default() };
            let picture = draw(&[at(model(part), Vec3::ZERO)], &GBuffer::empty(view));
            for (sum, c) in sum.as_mut_slice().iter_mut().zip(picture.layer.coverage.as_slice()) {
                *sum += c; // multiples of 1/8 add exactly
            }
        }
    }
    for y in 4..39 {
        for x in 4..63 {
            assert_eq!(sum[(x, y)], 1.0, "pixel {x} {y}");
        }
    }
}

#[test]
fn four_colours_of_a_texture_are_where_gltf_puts_them() {
    let colors = [[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [255, 255, 0, 255]];
    let texture = Texture::new(2, 2, colors.to_vec(), Default::default()).unwrap();
    let material = Material { texture: Some(Arc::new(texture)), ..Default::default() };
    // u to the right, v down in the picture: camera axes
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    let part = quad(corners.map(|(x, y)| Vec3::new(x, y, 0.0)), material);
    for view in [pinhole(64, 64), ortho(64, 64, 32.0)] {
        let objects = [at(model(part.clone()), Vec3::new(0.0, 0.0, 1.64))];
        let layer = draw(&objects, &GBuffer::empty(view)).layer;
        // these pixels lie 1/128 beside the texel centres
        let quarter = |x, y| layer.albedo[(x, y)].map(|c| (c * 10.0).round() / 10.0);
        assert_eq!(quarter(15, 15), [1.0, 0.0, 0.0], "first texel: top left");
        assert_eq!(quarter(48, 15), [0.0, 1.0, 0.0]);
        assert_eq!(quarter(15, 48), [0.0, 0.0, 1.0], "second row: below");
        assert_eq!(quarter(48, 48), [1.0, 1.0, 0.0]);
    }
}

#[test]
fn texture_coordinates_are_perspective_correct() {
    // A floor that runs away from the camera; u is the distance.
    let ramp: Vec<_> = (0..256).map(|i| [i as u8, 0, 0, 255]).collect();
    let texture = Texture::new(256, 1, ramp, [crate::scene::Wrap::ClampToEdge; 2]).unwrap();
    let material = Material { texture: Some(Arc::new(texture)), ..Default::default() };
    let corners = [(1.0, -2.0), (5.0, -2.0), (5.0, 2.0), (1.0, 2.0)];
    let part = quad(corners.map(|(z, x)| Vec3::new(x, 0.5, z)), material);
    let view = pinhole(160, 120);
    let picture = draw(&[at(model(part), Vec3::ZERO)], &GBuffer::empty(view));
    let Projection::Perspective(camera) = view.projection else { unreachable!() };
    let mut checked = 0;
    for y in 70..119 {
        let depth = 0.5 * camera.fy / (y as f32 - camera.cy);
        if (1.1..4.9).contains(&depth) {
            checked += 1;
            let encoded =
                crate::math::color::srgb_from_linear(picture.layer.albedo[(80, y)][0]) * 255.0;
            // texel centres are half a texel in
            let expected = (depth - 1.0) / 4.0 * 256.0 - 0.5;
            // The mean over a pixel's depth is not the value at its middle: some of its texels' number.
            let texels = depth * depth / (0.5 * camera.fy) * 64.0;
            let tolerance = 1.5 + 0.15 * texels;
            assert!((encoded - expected).abs() < tolerance, "{y}: {encoded} {expected}");
        }
    }
    assert!(checked > 20);
}

pub(crate) fn wall(view: View, depth: f32) -> GBuffer {
    AnalyticScene::new([Shape::Plane { normal: -Vec3::Z, offset: -depth }]).render(&view)
}

pub(crate) fn sheet(size: f32) -> Arc<Model> {
    let corners = [(-size, -size), (size, -size), (size, size), (-size, size)];
    model(quad(corners.map(|(x, y)| Vec3::new(x, y, 0.0)), Material::default()))
}

#[test]
fn the_nearer_of_real_and_virtual_is_seen() {
    for view in [pinhole(67, 43), ortho(67, 43, 40.0)] {
        let real = wall(view, 1.0);
        let front = draw(&[at(sheet(3.0), Vec3::new(0.0, 0.0, 0.99))], &real);
        assert_eq!(front.report.pixels, 67 * 43);
        assert!(front.layer.coverage.as_slice().iter().all(|&c| c == 1.0));
        assert!(front.merged.depth_m.as_slice().iter().all(|d| (d - 0.99).abs() < 1e-6));
        for depth in [1.01, 1.0] {
            let behind = draw(&[at(sheet(3.0), Vec3::new(0.0, 0.0, depth))], &real);
            assert!(same(&behind.merged, &real), "at {depth} m");
            assert_eq!(coverage_sum(&behind), 0.0);
        }
        let nothing = GBuffer::empty(view);
        let alone = draw(&[at(sheet(3.0), Vec3::new(0.0, 0.0, 6.0))], &nothing);
        assert!(alone.report.pixels > 1000, "missing depth hides nothing");
    }
}

#[test]
fn a_box_on_a_real_floor_keeps_its_bottom_edge() {
    // The bottom face lies in the floor: only the sides may be seen, whatever the order.
    let look_down =
        Pose::new(nalgebra::Vector3::new(0.0, -0.8, 0.0), nalgebra::Vector3::x() * -0.6);
    let view = View { world_from_view: look_down, ..pinhole(160, 120) };
    let floor = Shape::Plane { normal: -Vec3::Y, offset: 0.0 };
    let (half, centre) = (Vec3::new(0.2, 0.1, 0.2), Vec3::new(0.0, -0.1, 1.2));
    let solid = Shape::Box { min: centre - half, max: centre + half };
    let real = AnalyticScene::new([floor]).render(&view);
    let expected = AnalyticScene::new([floor, solid]).render(&view);
    let got = draw(&[at(cuboid(half), centre)], &real);
    let hidden = expected.depth_m.as_slice().iter().zip(got.merged.depth_m.as_slice());
    // The depth bias hides 1.4 mm at the foot, half a pixel: at most one row of 40 pixels.
    let differ = hidden.filter(|(a, b)| (*a - *b).abs() > 1e-4).count();
    assert!(got.report.pixels > 1000 && differ <= 40, "{differ} of {}", got.report.pixels);
    // The floor is never replaced by the bottom face that lies in it.
    let floor_normals = (0..view.size().pixels()).filter(|&i| {
        got.merged.origin.as_slice()[i] == Origin::Virtual
            && got.merged.normals.y.as_slice()[i].abs() > 0.9
            && real.depth_m.as_slice()[i] - got.merged.depth_m.as_slice()[i] < 0.05
    });
    assert_eq!(floor_normals.count(), 0);
}

#[test]
fn crossing_surfaces_and_real_edges_are_anti_aliased() {
    let view = ortho(128, 128, 100.0);
    // A tilted sheet crosses a wall along a line: half of the picture is covered, with soft steps.
    let tilt = Quat::from_rotation_z(0.3) * Quat::from_rotation_y(0.5);
    let crossing = Similarity { rotation: tilt, scale: 1.0, translation: Vec3::new(0.0, 0.0, 2.0) };
    let picture = draw(&[VirtualObject::placed(sheet(5.0), crossing)], &wall(view, 2.0));
    let partial =
        |p: &Picture| p.layer.coverage.as_slice().iter().filter(|&&c| c > 0.0 && c < 1.0).count();
    // 2 mm of bias at this slope move the line by 0.37 pixel of 134: 49 square pixels
    let expected = 8192.0 - 0.002 / 0.5f64.tan() * 100.0 * 134.0;
    assert!((coverage_sum(&picture) - expected).abs() < 15.0, "{}", coverage_sum(&picture));
    assert!(partial(&picture) > 60, "{}", partial(&picture));

    // A real wall with a slanted edge, far in front of a virtual sheet, one depth a pixel.
    let mut real = GBuffer::empty(view);
    for y in 0..128 {
        for x in 0..128 {
            let left = x as f32 + 0.25 * y as f32 - 79.0;
            real.depth_m[(x, y)] = if left < 0.0 { 1.0 } else { 0.0 };
        }
    }
    let picture = draw(&[at(sheet(5.0), Vec3::new(0.0, 0.0, 2.0))], &real);
    assert!(partial(&picture) > 30, "{}", partial(&picture));
    let hard = picture.report.pixels as f64;
    assert!((coverage_sum(&picture) - hard).abs() < 0.002 * hard, "softened, not moved");
}

#[test]
fn a_floor_under_the_camera_is_clipped_in_front_of_it() {
    for half in [50.0, 3e4f32] {
        // -Y is up: a floor 1.2 m below the camera, from far behind to far ahead
        let corners = [(-half, -half), (half, -half), (half, half), (-half, half)];
        let part = quad(corners.map(|(x, z)| Vec3::new(x, 1.2, z)), Material::default());
        let view = pinhole(160, 120);
        let expected =
            AnalyticScene::new([Shape::Plane { normal: -Vec3::Y, offset: -1.2 }]).render(&view);
        let picture = draw(&[at(model(part), Vec3::ZERO)], &GBuffer::empty(view));
        for y in 65..120 {
            for x in 0..160 {
                let (got, expected) = (picture.merged.depth_m[(x, y)], expected.depth_m[(x, y)]);
                // Homogeneous rows y f + cy z of f32: cy half 2^-24 beside 1.2 f, five roundings
                let tolerance = expected * (half * 1e-7 + 1e-5);
                assert!((got - expected).abs() < tolerance, "{x} {y}: {got} {expected}");
                assert!(picture.merged.normals.at(x, y).dot(-Vec3::Y) > 0.999);
            }
        }
    }
}

#[test]
fn inside_a_box_its_walls_are_seen_from_within() {
    let room = cuboid(Vec3::new(1.0, 0.8, 1.5));
    for view in [pinhole(67, 43), ortho(67, 43, 30.0)] {
        let picture = draw(&[at(room.clone(), Vec3::new(0.1, 0.05, 0.2))], &GBuffer::empty(view));
        let picture_pixels = if view.is_perspective() { 67 * 43 } else { 60 * 43 };
        assert!(picture.report.pixels >= picture_pixels - 43, "{}", picture.report.pixels);
        assert!((picture.merged.depth_m[(33, 21)] - 1.7).abs() < 1e-5);
        for y in 0..43 {
            for x in (0..67).filter(|&x| picture.merged.origin[(x, y)] == Origin::Virtual) {
                // Inward normals of the walls, not bent towards the eye.
                let (normal, pixel) =
                    (picture.merged.normals.at(x, y), Vec2::new(x as f32, y as f32));
                assert!(normal.abs().max_element() > 1.0 - 1e-5, "{x} {y}: {normal}");
                assert!(normal.dot(view.towards_eye(pixel)) > 0.0, "{x} {y}: {normal}");
            }
        }
    }
}

#[test]
fn what_is_behind_the_camera_or_beside_it_costs_nothing_and_shows_nothing() {
    let far = [
        Vec3::new(0.0, 0.0, -2.0),
        Vec3::new(30.0, 0.0, 2.0),
        Vec3::new(0.0, -30.0, 2.0),
        Vec3::new(-30.0, 30.0, 2.0),
    ];
    for view in [pinhole(67, 43), ortho(67, 43, 40.0)] {
        let objects: Vec<_> = far.iter().map(|&p| at(sphere(0.5, 8), p)).collect();
        let real = wall(view, 1.5);
        let picture = draw(&objects, &real);
        assert_eq!(picture.report, DrawReport::default());
        assert!(same(&picture.merged, &real) && coverage_sum(&picture) == 0.0);
        // Half in, half out of the picture is drawn.
        let edge = if view.is_perspective() { 0.61 } else { 0.84 };
        let partly = draw(&[at(sphere(0.2, 8), Vec3::new(edge, 0.0, 1.0))], &real);
        assert!(partly.report.objects == 1 && partly.report.pixels > 20);
    }
}

#[test]
fn no_objects_empty_models_and_a_thousand() {
    let view = pinhole(67, 43);
    let real = wall(view, 3.0);
    assert!(same(&draw(&[], &real).merged, &real));
    let empty = Arc::new(Model::new("empty", vec![]).unwrap());
    assert!(same(&draw(&[at(empty, Vec3::Z)], &real).merged, &real));
    let (small, mut rng) = (cuboid(Vec3::splat(0.02)), Rng::new(&[3]));
    let many: Vec<_> = (0..1000)
        .map(|_| {
            let p =
                Vec3::new(rng.uniform() - 0.5, 0.6 * (rng.uniform() - 0.5), 1.0 + rng.uniform());
            at(small.clone(), p)
        })
        .collect();
    let picture = draw(&many, &real);
    assert_eq!(picture.report.objects, 1000);
    // One after the other with a depth test must give the same picture.
    let mut merged = real.clone();
    for object in &many {
        merged = draw(std::slice::from_ref(object), &merged).merged;
    }
    let closest = |buffer: &GBuffer| buffer.depth_m.as_slice().to_vec();
    let gaps = closest(&merged).into_iter().zip(closest(&picture.merged));
    // the bias between virtual surfaces exists only where they are drawn one after the other
    assert!(gaps.into_iter().all(|(a, b)| (a - b).abs() <= 1.1e-3 * a));
}

#[test]
fn coverage_of_a_disc_sums_to_its_area() {
    for (pixels_per_m, radius) in [(97.0, 0.31), (40.0, 0.2)] {
        let view = ortho(128, 96, pixels_per_m);
        let centre = Vec3::new(0.013, -0.021, 1.0);
        let picture = draw(&[at(sphere(radius, 128), centre)], &GBuffer::empty(view));
        let area = std::f64::consts::PI * f64::from(radius * pixels_per_m).powi(2);
        let error = coverage_sum(&picture) / area - 1.0;
        assert!(error.abs() < 0.01, "{error}");
    }
}

#[test]
fn normals_face_the_viewer_everywhere() {
    // A coarse sphere with smooth normals: at the silhouette they turn away from the viewer.
    for view in [moved(pinhole(160, 120)), moved(ortho(160, 120, 100.0))] {
        let in_view = view.world_from_view * nalgebra::Point3::new(0.0, 0.0, 1.0);
        let centre = Vec3::new(in_view.x as f32, in_view.y as f32, in_view.z as f32);
        let picture = draw(&[at(sphere(0.4, 5), centre)], &GBuffer::empty(view));
        assert!(picture.report.pixels > 2000);
        for y in 0..120 {
            for x in (0..160).filter(|&x| picture.merged.origin[(x, y)] == Origin::Virtual) {
                let normal = picture.merged.normals.at(x, y);
                let eye = view.towards_eye(Vec2::new(x as f32, y as f32));
                let eye = view.world_from_view_f32().transform_vector3(eye);
                assert!(normal.dot(eye) > -1e-5 && (normal.length() - 1.0).abs() < 1e-5);
            }
        }
    }
}

#[test]
fn holes_of_a_mask_show_what_is_behind() {
    let texels = vec![[255, 255, 255, 0], [255, 255, 255, 255]];
    let texture = Texture::new(2, 1, texels, [crate::scene::Wrap::ClampToEdge; 2]).unwrap();
    let texture = Some(Arc::new(texture));
    let corners =
        [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| Vec3::new(x, y, 0.0));
    let masked =
        Material { texture: texture.clone(), alpha_cutoff: Some(0.5), base_color: [1.0; 4] };
    let view = ortho(64, 64, 30.0);
    let real = wall(view, 2.0);
    let masked = draw(&[at(model(quad(corners, masked)), Vec3::Z)], &real);
    assert_eq!(masked.merged.origin[(10, 32)], Origin::Model);
    assert_eq!(masked.layer.coverage[(10, 32)], 0.0);
    assert_eq!(masked.merged.origin[(50, 32)], Origin::Virtual);
    let opaque = Material { texture, ..Default::default() };
    let opaque = draw(&[at(model(quad(corners, opaque)), Vec3::Z)], &real);
    assert_eq!(opaque.merged.origin[(10, 32)], Origin::Virtual);
}

pub(crate) fn busy_scene() -> Vec<VirtualObject> {
    let mut rng = Rng::new(&[5]);
    let models = [sphere(0.3, 12), cuboid(Vec3::splat(0.2)), sheet(0.4)];
    (0..30)
        .map(|i| {
            let axis = Vec3::new(rng.normal(), rng.normal(), rng.normal()).normalize();
            let spread = Vec3::new(rng.normal(), rng.normal(), rng.uniform() * 3.0);
            let rotation = Quat::from_axis_angle(axis, rng.uniform() * TAU);
            let pose = Similarity { rotation, scale: 0.5 + rng.uniform(), translation: spread };
            VirtualObject::placed(models[i % 3].clone(), pose)
        })
        .collect()
}

#[test]
fn any_number_of_threads_and_any_size_gives_the_same_bits() {
    for (width, height) in [(67, 43), (1, 1), (1, 50), (200, 3)] {
        for view in [pinhole(width, height), ortho(width, height, 40.0)] {
            let real = wall(view, 1.7);
            let with = |threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| draw(&busy_scene(), &real))
            };
            let (one, five) = (with(1), with(5));
            assert!(same(&one.merged, &five.merged) && one.layer == five.layer);
            assert_eq!(one.report, five.report);
            assert!(one.report.pixels > 0 || width * height < 100, "{width}x{height}");
        }
    }
    let none = draw(&busy_scene(), &GBuffer::empty(pinhole(0, 7)));
    assert_eq!(none.report, DrawReport::default());
}

/// `cargo test --release --lib time_raster -- --ignored --nocapture`
#[test]
#[ignore = "prints times"]
fn time_raster() {
    let (vga, side) = (pinhole(640, 480), ortho(256, 256, 128.0));
    for (name, stacks, view) in [
        ("figure, 640x480", 1, vga),
        ("figure, 256x256 orthographic", 1, ortho(256, 256, 600.0)),
        ("20k triangles over a fifth of 640x480", 71, vga),
        ("20k triangles over two thirds of 640x480", 71, vga),
        ("20k triangles, 256x256 orthographic", 71, side),
        ("1M triangles, 640x480", 500, vga),
        ("2 triangles over all of 640x480", 0, vga),
        ("2 triangles in the plane of a wall, 640x480", 0, vga),
        ("nothing in view, 640x480", 0, vga),
    ] {
        let (object, z) = match (stacks, name.starts_with("nothing")) {
            (0, true) => (sheet(3.0), -1.0),
            (0, false) => (sheet(3.0), if name.contains("wall") { 1.0 } else { 0.8 }),
            (1, _) => (Arc::new(crate::synth::virtual_object::model()), 1.2),
            (stacks, _) => (sphere(0.3, stacks), if name.contains("thirds") { 0.7 } else { 1.2 }),
        };
        let scene = VirtualScene::from_objects([at(object, Vec3::new(0.0, 0.0, z))]);
        let real = wall(view, if stacks > 0 { 2.0 } else { 1.0 });
        let (mut merged, mut layer) = (GBuffer::empty(view), VirtualLayer::default());
        let mut rasteriser = Rasteriser::default();
        let mut draw = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut times = [[0.0; 2]; 40];
            for [wall, cpu] in &mut times {
                let start = (std::time::Instant::now(), pool.install(thread_cpu_ms));
                pool.install(|| rasteriser.draw(&scene, &real, &mut merged, &mut layer));
                *cpu = pool.install(thread_cpu_ms) - start.1;
                *wall = start.0.elapsed().as_secs_f64() * 1e3;
            }
            [0, 1].map(|clock| {
                times.sort_by(|a, b| a[clock].total_cmp(&b[clock]));
                times[20][clock]
            })
        };
        let ([one, cpu], [two, _]) = (draw(1), draw(2));
        println!("{name}: 1 thread {one:.2} ms ({cpu:.2} ms of CPU), 2 threads {two:.2} ms");
    }
}

/// Time that this thread has run, so that other work on the machine does not count; 0 where the system
/// does not say.
fn thread_cpu_ms() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split(' ').next().and_then(|ns| ns.parse::<f64>().ok()).unwrap_or(0.0) * 1e-6
}
