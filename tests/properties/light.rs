//! The light that pictures are explained by.

use crate::arbitrary::*;
use glam::{DQuat, DVec3, Vec3};
use kinlight::capture::RgbdFrame;
use kinlight::geometry::{GBuffer, Origin};
use kinlight::image::{Image, Size};
use kinlight::lighting::{LightEstimator, LightParams, LightPrior};
use kinlight::math::color::srgb8_from_linear;
use kinlight::math::{Pinhole, Pose, View, sh};
use kinlight::transfer::TransferMap;
use proptest::prelude::*;

const SIZE: Size = Size::new(30, 24);
const BANDS: usize = 3;

/// Unoccluded surfaces with normals all over the sphere, 1 m away, in the light of `light` at each pixel's turn.
struct Picture {
    normals: Vec<DVec3>,
    light: Vec<f64>,
}

fn normals() -> Vec<DVec3> {
    kinlight::math::fibonacci_sphere_f64(SIZE.pixels()).collect()
}

/// Ambient light and a lamp, within what a sensor shows.
fn light() -> impl Strategy<Value = Vec<f64>> {
    (direction(), 0.2..0.5f64, 0.5..1.5f64).prop_map(|(towards, lamp, ambient)| {
        let mut light: Vec<f64> = basis(towards, BANDS).iter().map(|y| lamp * y).collect();
        light[0] += ambient;
        light
    })
}

/// The paper's solver, without prior and weights; its answer is linear in what is seen.
fn plain() -> LightParams {
    LightParams {
        prior: LightPrior::Dark,
        balance_normals: false,
        tikhonov: 0.0,
        huber: 0.0,
        ..usual()
    }
}

fn usual() -> LightParams {
    LightParams {
        hidden_radiance: 0.0,
        memory: 0.0,
        stride: 1,
        min_cosine: -1.0,
        ..LightParams::default()
    }
}

impl Picture {
    fn estimate(&self, params: &LightParams) -> Vec<f64> {
        let camera = Pinhole { width: 30, height: 24, fx: 25.0, fy: 25.0, cx: 14.5, cy: 11.5 };
        let mut surface = GBuffer::empty(View::perspective(camera, Pose::identity()));
        let n = sh::coefficients(BANDS);
        let mut coefficients = Vec::new();
        let mut color = Image::new(SIZE, [0.0f32; 3]);
        for (k, &normal) in self.normals.iter().enumerate() {
            let at = (k % SIZE.width, k / SIZE.width);
            let row = &sh::unoccluded_transfer(vec3(normal), BANDS)[..n];
            surface.depth_m[at] = 1.0;
            surface.normals.set(at.0, at.1, vec3(normal));
            surface.origin[at] = Origin::Model;
            let seen: f64 = row.iter().zip(&self.light).map(|(t, l)| f64::from(*t) * l).sum();
            color[at] = [seen as f32; 3];
            coefficients.extend(row);
        }
        let transfer = TransferMap { bands: BANDS, step: 1, grid: SIZE, coefficients };
        let codes = color.as_slice().iter().map(|c| c.map(srgb8_from_linear)).collect();
        let frame =
            RgbdFrame { color_srgb: Image::from_vec(SIZE, codes), color, ..RgbdFrame::default() };
        let estimate = LightEstimator::new(params).estimate(&frame, &surface, &transfer, None);
        assert!(estimate.valid(), "{:?}", estimate.rejection);
        estimate.light.luminance().iter().map(|&l| f64::from(l)).collect()
    }
}

/// Condition 60 of sums in f32 chunks of 64: 60 * 64 * 2^-24, and less as roundings average out.
const PLAIN: f64 = 1e-4;

fn towards(light: &[f64]) -> Vec3 {
    let light: Vec<f32> = light.iter().map(|&l| l as f32).collect();
    sh::dominant_direction(&light).unwrap()
}

fn angle_deg(a: Vec3, b: Vec3) -> f32 {
    a.cross(b).length().atan2(a.dot(b)).to_degrees()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn a_rotated_world_has_the_rotated_light(light in light(), turn in rotation()) {
        let turned = Picture {
            normals: normals().into_iter().map(|n| turn * n).collect(),
            light: rotated(&light, turn),
        };
        let found = Picture { normals: normals(), light: light.clone() }.estimate(&plain());
        prop_assert!(largest_difference(&found, &light) < PLAIN);
        prop_assert!(largest_difference(&turned.estimate(&plain()), &rotated(&light, turn)) < PLAIN);
    }

    /// x and -x, which no rotation does.
    #[test]
    fn a_mirrored_world_has_the_mirrored_light(light in light()) {
        let mirror = |v: DVec3| DVec3::new(-v.x, v.y, v.z);
        let mirrored: Vec<f64> = projected(BANDS, |w| dot(&light, &basis(mirror(w), BANDS)));
        let picture = Picture { normals: normals().into_iter().map(mirror).collect(), light: mirrored.clone() };
        prop_assert!(largest_difference(&picture.estimate(&plain()), &mirrored) < PLAIN);
    }

    /// The order of the pixels is none of the light's business. With a lamp, places are tried on part of the
    /// samples, which are others then, and positions are too: the light stays within what places tell apart.
    #[test]
    fn permuted_samples_give_the_same_light(light in light(), order in Just((0..SIZE.pixels()).collect::<Vec<_>>()).prop_shuffle()) {
        let all = normals();
        let shuffled = Picture { normals: order.iter().map(|&k| all[k]).collect(), light: light.clone() };
        let straight = Picture { normals: all, light };
        let (a, b) = (straight.estimate(&plain()), shuffled.estimate(&plain()));
        prop_assert!(largest_difference(&a, &b) < PLAIN, "{}", largest_difference(&a, &b));
        let far = LightParams { prior: LightPrior::DistantLamp, ..usual() };
        let (a, b) = (towards(&straight.estimate(&far)), towards(&shuffled.estimate(&far)));
        prop_assert!(angle_deg(a, b) < 0.1, "{} degrees", angle_deg(a, b));
    }

    /// Twice the light is twice the estimate.
    #[test]
    fn the_estimate_is_linear_in_the_light(light in light()) {
        let half: Vec<f64> = light.iter().map(|l| 0.5 * l).collect();
        for params in [plain(), usual()] {
            let whole = Picture { normals: normals(), light: light.clone() }.estimate(&params);
            let found = Picture { normals: normals(), light: half.clone() }.estimate(&params);
            let twice: Vec<f64> = found.iter().map(|l| 2.0 * l).collect();
            prop_assert!(largest_difference(&whole, &twice) < PLAIN, "{whole:?} {twice:?}");
        }
    }

    /// A lamp and ambient light are what the default looks for: it finds them wherever they are.
    #[test]
    fn a_lamp_is_found_in_any_direction(light in light(), turn in rotation()) {
        let light = rotated(&light, turn);
        let found = Picture { normals: normals(), light: light.clone() }.estimate(&usual());
        let angle = angle_deg(towards(&found), towards(&light));
        prop_assert!(angle < 3.0, "{angle} degrees");
    }
}

#[test]
fn a_quarter_turn_four_times_is_none() {
    let quarter = DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), std::f64::consts::FRAC_PI_2);
    let light: Vec<f64> = (0..9).map(|i| 0.1 * f64::from(i) - 0.3).collect();
    let turned = (0..4).fold(light.clone(), |l, _| rotated(&l, quarter));
    assert!(largest_difference(&light, &turned) < 1e-12);
}
