//! Virtual geometry: what is redone, and the bounce.

use super::test_support::*;
use super::*;
use crate::geometry::{GBuffer, Origin};
use crate::image::Image;
use crate::scene::analytic::{AnalyticScene, Shape};
use glam::{Vec2, Vec3};

/// Main and auxiliary buffers of a scene, before and after something virtual came into it.
struct Insertion {
    real: (GBuffer, Vec<GBuffer>),
    merged: (GBuffer, Vec<GBuffer>),
}

impl Insertion {
    fn new(scene: &AnalyticScene, object: Shape) -> Self {
        let mut with_object = scene.clone();
        with_object.shapes.push(object);
        let (view, views) = (camera(134, 86), auxiliary_views(96));
        let real = scene.render(&view);
        let real_auxiliary: Vec<_> = views.iter().map(|v| scene.render(v)).collect();
        let merged = paint_virtual(&real, with_object.render(&view));
        let merged_auxiliary = (views.iter().zip(&real_auxiliary))
            .map(|(v, before)| paint_virtual(before, with_object.render(v)))
            .collect();
        Self { real: (real, real_auxiliary), merged: (merged, merged_auxiliary) }
    }

    fn ball() -> Self {
        let centre = Vec3::new(0.15, -0.5, 0.1);
        Self::new(&desk(), Shape::Sphere { centre, radius: 0.08 })
    }

    fn real(&self) -> Buffers<'_> {
        (&self.real.0, &self.real.1)
    }

    fn merged(&self) -> Buffers<'_> {
        (&self.merged.0, &self.merged.1)
    }

    /// The surface point of a pixel in world axes; the origin where there is none.
    fn point(&self, x: usize, y: usize) -> Vec3 {
        let main = &self.merged.0;
        let in_view = main.view.unproject(Vec2::new(x as f32, y as f32), main.depth_m[(x, y)]);
        main.view.world_from_view_f32().transform_point3(in_view)
    }

    /// Real transfer, then transfer with virtual objects, and the bounce.
    fn run(
        &self,
        stage: &mut RadianceTransfer,
        radiance: Option<Radiance>,
    ) -> (TransferMap, IndirectMap) {
        let (mut real, mut out) = (TransferMap::default(), TransferMap::default());
        let mut indirect = IndirectMap { rgb: vec![[f32::NAN; 3]; 5], ..IndirectMap::default() };
        stage.transfer(self.real().0, self.real().1, &mut real);
        let buffers = (self.real(), self.merged());
        stage.transfer_and_bounce(buffers.0, buffers.1, radiance, &real, &mut out, &mut indirect);
        (out, indirect)
    }

    /// The bounce with the same radiance everywhere.
    fn bounce(&self, stage: &mut RadianceTransfer, radiance: [f32; 3]) -> IndirectMap {
        let main = Image::new(self.merged.0.size(), radiance);
        let auxiliary: Vec<_> =
            self.merged.1.iter().map(|b| Image::new(b.size(), radiance)).collect();
        self.run(stage, Some((&main, &auxiliary))).1
    }
}

/// |Y| is at most (7 / 4 pi)^(1/2) < 0.75 in 4 bands, and shares make up 1. So each of the three sums, of what real,
/// merged and changed directions hide, is below 0.75 and rounds at most 32 times by half a unit, 2^-25 of 1.
const ROUNDING: f32 = 3.0 * 32.0 / (1 << 25) as f32;

fn difference(a: &TransferMap, b: &TransferMap) -> f32 {
    let pairs = a.coefficients.iter().zip(&b.coefficients);
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

fn sum(map: &IndirectMap) -> Vec3 {
    map.rgb.iter().map(|&c| Vec3::from(c)).sum()
}

#[test]
fn only_what_virtual_pixels_reach_is_redone_and_all_else_keeps_its_bits() {
    let scene = Insertion::ball();
    for (step, radius_m) in [(1, 0.2), (2, 0.5), (4, 1.0), (3, 5.0)] {
        let params = TransferParams { subsampling: step, radius_m, ..TransferParams::default() };
        let mut stage = stage(&params);
        let mut real = TransferMap::default();
        stage.transfer(scene.real().0, scene.real().1, &mut real);
        let whole = transferred(&params, scene.merged().0, scene.merged().1);
        assert_ne!(real, whole);
        let (mut out, mut indirect) = (TransferMap::default(), IndirectMap::default());
        let buffers = (scene.real(), scene.merged());
        stage.transfer_and_bounce(buffers.0, buffers.1, None, &real, &mut out, &mut indirect);
        assert!(indirect.rgb.iter().all(|c| *c == [0.0; 3]));
        assert!(difference(&out, &whole) < ROUNDING, "step {step}: {}", difference(&out, &whole));
        // Marked values show what was copied.
        let mut marked = real.clone();
        marked.coefficients.fill(7.0);
        stage.transfer_and_bounce(buffers.0, buffers.1, None, &marked, &mut out, &mut indirect);
        let copied = out.coefficients.chunks(16).filter(|c| c[0] == 7.0).count();
        if radius_m < 0.4 {
            assert!(copied * 3 > out.grid.pixels(), "{copied} of {}", out.grid.pixels());
        }
        for (k, c) in out.coefficients.chunks(16).enumerate().filter(|(_, c)| c[0] == 7.0) {
            assert!(c.iter().all(|&v| v == 7.0));
            let range = k * 16..k * 16 + 16;
            assert_eq!(real.coefficients[range.clone()], whole.coefficients[range]);
        }
    }
}

#[test]
fn without_virtual_pixels_all_stays_as_it_was() {
    let mut scene = Insertion::ball();
    scene.merged = scene.real.clone();
    let mut stage = stage(&TransferParams::default());
    let mut real = TransferMap::default();
    stage.transfer(scene.real().0, scene.real().1, &mut real);
    assert_eq!(scene.run(&mut stage, None).0, real);
    let bounce = scene.bounce(&mut stage, [1.0; 3]);
    assert_eq!(bounce.rgb.len(), bounce.grid.pixels());
    assert!(bounce.rgb.iter().all(|c| *c == [0.0; 3]));
}

#[test]
fn a_map_of_other_settings_is_not_trusted() {
    let scene = Insertion::ball();
    let mut stage = stage(&TransferParams::default());
    let other = transferred(
        &TransferParams { subsampling: 2, ..TransferParams::default() },
        scene.real().0,
        scene.real().1,
    );
    let (mut out, mut indirect) = (TransferMap::default(), IndirectMap::default());
    let buffers = (scene.real(), scene.merged());
    stage.transfer_and_bounce(buffers.0, buffers.1, None, &other, &mut out, &mut indirect);
    let whole = transferred(stage.params(), scene.merged().0, scene.merged().1);
    assert!(difference(&out, &whole) < ROUNDING);
}

/// Every point, direction, sample and view by itself, and nothing left out: the definitions of the module
/// [`super::bounce`] and of Eq. 7 and 8 in plain f64, apart from the transfer's kernels.
fn bounce_of_point(
    set: &DirectionSet,
    buffers: Buffers,
    radiance: &[&Image<[f32; 3]>],
    cell: (usize, usize),
    pixel: (usize, usize),
) -> Option<Vec3> {
    let views: Vec<_> = std::iter::once(buffers.0).chain(buffers.1).collect();
    let bias_m = f64::from(TransferParams::default().bias_m);
    let surface = |b: &GBuffer, (u, v): (usize, usize)| {
        let in_view = b.view.unproject(Vec2::new(u as f32, v as f32), b.depth_m[(u, v)]);
        b.view.world_from_view_f32().transform_point3(in_view).as_dvec3()
    };
    let main = views[0];
    if main.depth_m[pixel] <= 0.0 {
        return None;
    }
    let n = main.normals.at(pixel.0, pixel.1).as_dvec3();
    let x = surface(main, pixel) + bias_m * n;
    let on_virtual = main.origin[pixel] == Origin::Virtual;
    let (mut light, mut sum) = (Vec3::ZERO, 0.0);
    for (k, w) in set.directions.iter().map(|w| w.as_dvec3()).enumerate() {
        let cosine = n.dot(w);
        if cosine <= 0.0 {
            continue;
        }
        sum += cosine as f32;
        let mut best = (-2.0, None);
        for sample in 0..set.samples {
            let y = x + f64::from(set.distance_m(k, sample, cell.0, cell.1)) * w;
            for (at, b) in views.iter().enumerate() {
                let in_view = b.view.world_from_view_f32().inverse().transform_point3(y.as_vec3());
                let (scale, centre) = b.view.scale_and_centre();
                let z = if b.view.is_perspective() { in_view.z } else { 1.0 };
                let seen = (in_view.truncate() * scale / z + centre + 0.5).floor();
                let size = b.size();
                let inside = seen.cmpge(Vec2::ZERO).all()
                    && seen.cmplt(Vec2::new(size.width as f32, size.height as f32)).all();
                if z <= 0.0 || !inside {
                    continue;
                }
                let at_pixel = (seen.x as usize, seen.y as usize);
                let limit = limits::limit_m(b, at_pixel, bias_m as f32);
                if in_view.z <= limit {
                    continue;
                }
                // s lies on the sample's own ray into the view, at the limit's depth.
                let depth = limit - bias_m as f32;
                let s = if b.view.is_perspective() {
                    in_view * (depth / in_view.z)
                } else {
                    in_view.with_z(depth)
                };
                let t = b.view.world_from_view_f32().transform_point3(s).as_dvec3() - x;
                let fit = t.dot(w) / t.length().max(1e-20);
                if t.dot(n) > 0.0 && fit > best.0 {
                    best = (fit, Some((at, at_pixel)));
                }
            }
        }
        let chi = f64::from(set.chi);
        let hidden = ((best.0 - (1.0 - chi)) / chi).clamp(0.0, 1.0);
        let Some((at, hit)) = best.1.filter(|_| hidden > 0.0) else { continue };
        let b = views[at];
        let faces = b.normals.at(hit.0, hit.1).as_dvec3().dot(x - surface(b, hit)) > 0.0;
        if faces && (on_virtual || b.origin[hit] == Origin::Virtual) {
            light += (hidden * cosine) as f32 * Vec3::from(radiance[at][hit]);
        }
    }
    Some(light / sum)
}

#[test]
fn the_bounce_is_what_every_sample_by_itself_gives() {
    let scene = Insertion::ball();
    for step in [1, 4] {
        let params = TransferParams { subsampling: step, ..TransferParams::default() };
        let mut stage = stage(&params);
        let mut rng = crate::math::random::Rng::new(&[5]);
        let mut noise = |b: &GBuffer| {
            let pixels = (0..b.size().pixels()).map(|_| [rng.uniform(); 3]).collect();
            Image::from_vec(b.size(), pixels)
        };
        let main = noise(&scene.merged.0);
        let auxiliary: Vec<_> = scene.merged.1.iter().map(&mut noise).collect();
        let found = scene.run(&mut stage, Some((&main, &auxiliary))).1;
        let radiance: Vec<_> = std::iter::once(&main).chain(&auxiliary).collect();
        let (mut wrong, mut lit) = (0, 0);
        for j in 0..found.grid.height {
            for i in 0..found.grid.width {
                let pixel = found.pixel(i, j, scene.merged.0.size());
                let set = stage.direction_set();
                let expected = bounce_of_point(set, scene.merged(), &radiance, (i, j), pixel);
                let (expected, found) =
                    (expected.unwrap_or(Vec3::ZERO), Vec3::from(found.at(i, j)));
                lit += usize::from(found.x > 0.0);
                wrong += usize::from((expected - found).abs().max_element() > 1e-4);
            }
        }
        println!("step {step}: {lit} points are lit, {wrong} differ");
        // Samples that fall on the border of two pixels, and surfaces that fit equally well.
        assert!(lit > 100 / step && wrong * 50 < lit, "{wrong} of {lit}");
    }
}

#[test]
fn the_bounce_leaves_the_transfer_as_it_is() {
    let scene = Insertion::ball();
    let mut stage = stage(&TransferParams::default());
    let main = Image::new(scene.merged.0.size(), [1.0; 3]);
    let auxiliary: Vec<_> = scene.merged.1.iter().map(|b| Image::new(b.size(), [1.0; 3])).collect();
    let (alone, dark) = scene.run(&mut stage, None);
    let (together, lit) = scene.run(&mut stage, Some((&main, &auxiliary)));
    assert_eq!(alone, together);
    assert!(sum(&dark) == Vec3::ZERO && sum(&lit).x > 1.0);
}

#[test]
fn real_surfaces_take_light_from_virtual_ones_alone() {
    let scene = Insertion::ball();
    let mut stage = stage(&TransferParams::default());
    let on = |k: usize, map: &IndirectMap| {
        let (i, j) = (k % map.grid.width, k / map.grid.width);
        scene.merged.0.origin[map.pixel(i, j, scene.merged.0.size())]
    };
    // Real pixels leave green light, virtual ones red.
    let colours = |buffer: &GBuffer| {
        let colour = |o: &Origin| match o {
            Origin::Virtual => [1.0, 0.0, 0.0],
            _ => [0.0, 1.0, 0.0],
        };
        let pixels = buffer.origin.as_slice().iter().map(colour).collect();
        Image::from_vec(buffer.size(), pixels)
    };
    let auxiliary: Vec<_> = scene.merged.1.iter().map(colours).collect();
    let out = scene.run(&mut stage, Some((&colours(&scene.merged.0), &auxiliary))).1;
    let (mut floor, mut ball) = (Vec3::ZERO, Vec3::ZERO);
    for (k, c) in out.rgb.iter().enumerate() {
        match on(k, &out) {
            Origin::Virtual => ball += Vec3::from(*c),
            _ => floor += Vec3::from(*c),
        }
    }
    assert!(floor.x > 1.0 && floor.y == 0.0, "{floor}");
    assert!(ball.y > 1.0, "{ball}");
    // A convex ball does not light itself, but for the coarse rims of the side views.
    assert!(ball.x < 0.05 * ball.y, "{ball}");
}

/// Eq. 12 as printed would keep surfaces behind x alone, and lose the light of the first wall here.
#[test]
fn surfaces_that_face_away_send_no_light() {
    let wall = Shape::Box { min: Vec3::new(-0.6, 0.2, 0.0), max: Vec3::new(0.6, 0.3, 0.5) };
    let mut scene = Insertion::new(&AnalyticScene::new([FLOOR]), wall);
    let mut stage = stage(&TransferParams::default());
    // Light on the floor before the wall, whose whole surface faces along +y or -y.
    let mut lit_with_normal = |normal: Vec3| {
        for buffer in std::iter::once(&mut scene.merged.0).chain(&mut scene.merged.1) {
            for k in 0..buffer.origin.as_slice().len() {
                if buffer.origin.as_slice()[k] == Origin::Virtual {
                    let width = buffer.size().width;
                    buffer.normals.set(k % width, k / width, normal);
                }
            }
        }
        let map = scene.bounce(&mut stage, [1.0; 3]);
        let floor = (0..map.rgb.len()).filter(|k| {
            let p = scene.point(k % map.grid.width, k / map.grid.width);
            p.z.abs() < 1e-3 && p.y < 0.15
        });
        floor.map(|k| map.rgb[k][0]).sum::<f32>()
    };
    let towards = lit_with_normal(-Vec3::Y);
    assert!(towards > 10.0, "{towards}");
    assert_eq!(lit_with_normal(Vec3::Y), 0.0);
}

#[test]
fn the_bounce_is_linear_bounded_and_can_be_switched_off() {
    let scene = Insertion::ball();
    let with = |enabled, strength| {
        let params = TransferParams::default();
        RadianceTransfer::new(&params, &BounceParams { enabled, strength }).unwrap()
    };
    let one = scene.bounce(&mut with(true, 1.0), [1.0, 0.5, 0.0]);
    for [r, g, b] in &one.rgb {
        // However near the surfaces are: 1 / d^2 is gone.
        assert!((0.0..=1.0 + 1e-6).contains(r) && (g - 0.5 * r).abs() < 1e-6 && *b == 0.0);
    }
    let two = scene.bounce(&mut with(true, 2.0), [1.0, 0.5, 0.0]);
    assert!(one.rgb.iter().zip(&two.rgb).all(|(a, b)| (2.0 * a[0] - b[0]).abs() < 1e-6));
    assert_eq!(sum(&scene.bounce(&mut with(false, 1.0), [1.0; 3])), Vec3::ZERO);
    let error = RadianceTransfer::new(
        &TransferParams::default(),
        &BounceParams { enabled: true, strength: f32::NAN },
    );
    assert!(error.unwrap_err().to_string().contains("bounce.strength"));
}

/// Hiding surfaces that shine like the light itself leave no trace: what the transfer takes away,
/// the bounce brings back. In a corner all surfaces that hide show their faces.
#[test]
fn bounce_and_transfer_make_up_a_furnace() {
    let corner = AnalyticScene::new(AnalyticScene::corner().shapes[..3].to_vec());
    let far = Shape::Sphere { centre: Vec3::new(50.0, 50.0, 50.0), radius: 0.1 };
    let mut scene = Insertion::new(&corner, far);
    for buffer in std::iter::once(&mut scene.merged.0).chain(&mut scene.merged.1) {
        buffer.origin.fill(Origin::Virtual);
    }
    let mut stage = stage(&TransferParams::default());
    let map = transferred(stage.params(), scene.merged().0, scene.merged().1);
    let bounce = scene.bounce(&mut stage, [1.0; 3]);
    let (mut hidden, mut returned, mut worst, mut count) = (0.0, 0.0, 0.0f64, 0.0);
    for (c, b) in map.coefficients.chunks(16).zip(&bounce.rgb).filter(|(c, _)| c[0] > 0.0) {
        let (h, r) = (f64::from(1.0 - furnace(c)), f64::from(b[0]));
        (hidden, returned, count) = (hidden + h, returned + r, count + 1.0);
        worst = worst.max((h - r).abs());
    }
    println!(
        "hidden {hidden:.1}, returned {returned:.1} at {count} points, off by {worst:.3} at most"
    );
    assert!(hidden / count > 0.02);
    // f32 sums of up to 20 terms; the back of a pixel's plane may face away
    assert!(worst < 0.01, "{worst}");
}

/// A floor beside a virtual wall that shines with radiance 1, against the closed form of an upright
/// rectangle.
#[test]
fn a_shining_wall_lights_the_floor_by_its_form_factor() {
    let wall = Shape::Box { min: Vec3::new(-0.6, 0.2, 0.0), max: Vec3::new(0.6, 0.3, 0.5) };
    let scene = Insertion::new(&AnalyticScene::new([FLOOR]), wall);
    let params = TransferParams { directions: 64, samples: 16, ..TransferParams::default() };
    let bounce = scene.bounce(&mut stage(&params), [1.0; 3]);
    let map = transferred(&params, scene.merged().0, scene.merged().1);
    // To a rectangle of width a and height b whose corner is the nearest point of the floor's edge,
    // at a distance c.
    let corner = |a: f64, b: f64, c: f64| {
        let root = (c * c + b * b).sqrt();
        ((a / c).atan() - c / root * (a / root).atan()) / (2.0 * std::f64::consts::PI)
    };
    let (mut found, mut hidden, mut expected) = (0.0, 0.0, 0.0);
    for (k, c) in bounce.rgb.iter().enumerate() {
        let (i, j) = (k % bounce.grid.width, k / bounce.grid.width);
        let p = scene.point(i, j);
        if p.z.abs() < 1e-3 && (-0.2..0.15).contains(&p.y) && p.x.abs() < 0.4 {
            let (x, distance) = (f64::from(p.x), f64::from(0.2 - p.y));
            expected += corner(0.6 - x, 0.5, distance) + corner(0.6 + x, 0.5, distance);
            found += f64::from(c[0]);
            hidden += f64::from(1.0 - furnace(map.at(i, j)));
        }
    }
    println!("floor beside a wall: bounce {found:.1}, hidden {hidden:.1}, exact {expected:.1}");
    // Measured 0.91: samples skip what lies between two of them. Fewer directions or more samples
    // come nearer (a cone of 13 degrees, samples 6 cm apart).
    assert!((0.85..1.0).contains(&(hidden / expected)), "{hidden} against {expected}");
    // Measured 0.67: where the best fit is the top or the back of the wall, that faces away.
    assert!((0.6..1.0).contains(&(found / expected)), "{found} against {expected}");
}
