//! Depth pictures, the volume, transfer.

use glam::{DMat3, DQuat, DVec3, Vec3};
use kinlight::capture::RgbdFrame;
use kinlight::fusion::{TsdfVolume, VolumeParams};
use kinlight::geometry::{DynGeo, DynGeoParams, GBuffer};
use kinlight::image::{Image, Size};
use kinlight::math::color::{LINEAR_FROM_SRGB8, srgb_from_linear, srgb8_from_linear};
use kinlight::math::{Pinhole, Pose, View, pose_from_xyzw};
use kinlight::scene::analytic::{AnalyticScene, Shape};
use kinlight::transfer::{
    BounceParams, ChiReading, DirectionSet, RadianceTransfer, TransferMap, TransferParams,
};
use proptest::prelude::*;

const SIZE: Size = Size::new(40, 30);

fn camera() -> Pinhole {
    Pinhole { width: 40, height: 30, fx: 33.0, fy: 33.0, cx: 19.5, cy: 14.5 }
}

fn look_at(eye: DVec3, target: DVec3) -> Pose {
    let z = (target - eye).normalize();
    let x = z.cross(DVec3::Z).normalize();
    let q = DQuat::from_mat3(&DMat3::from_cols(x, z.cross(x), z));
    pose_from_xyzw(eye.to_array(), [q.x, q.y, q.z, q.w]).unwrap()
}

fn frame(depth_m: Image<f32>) -> RgbdFrame {
    RgbdFrame { intensity: Image::new(depth_m.size(), 100.0), depth_m, ..RgbdFrame::default() }
}

fn filtered(params: &DynGeoParams, depth_m: &Image<f32>) -> Image<f32> {
    let model = GBuffer::empty(View::perspective(camera(), Pose::identity()));
    let mut out = GBuffer::empty(model.view);
    DynGeo::new(params).run(&frame(depth_m.clone()), &model, &mut out);
    out.depth_m
}

/// Depth with holes.
fn depths() -> impl Strategy<Value = Image<f32>> {
    let depth = prop_oneof![4 => 0.3..5.0f32, 1 => Just(0.0f32)];
    prop::collection::vec(depth, SIZE.pixels()).prop_map(|values| Image::from_vec(SIZE, values))
}

fn scaled(image: &Image<f32>, by: f32) -> Image<f32> {
    Image::from_vec(image.size(), image.as_slice().iter().map(|d| d * by).collect())
}

/// Each row from right to left.
fn mirrored(image: &Image<f32>) -> Image<f32> {
    let rows = (0..image.height()).flat_map(|y| image.row(y).iter().rev().copied());
    Image::from_vec(image.size(), rows.collect())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn filters_leave_constant_depth_alone(depth_m in 1e-3..1e3f32) {
        let constant = Image::new(SIZE, depth_m);
        prop_assert!(filtered(&DynGeoParams::default(), &constant) == constant);
    }

    /// Medians choose: of twice the depth they choose twice the depth, and in a mirrored picture the mirrored pixel.
    #[test]
    fn medians_commute_with_scale_and_mirror(depth_m in depths()) {
        let params = DynGeoParams::default();
        let once = filtered(&params, &depth_m);
        prop_assert!(filtered(&params, &scaled(&depth_m, 2.0)) == scaled(&once, 2.0));
        prop_assert!(filtered(&params, &mirrored(&depth_m)) == mirrored(&once));
        let given: Vec<u32> = depth_m.as_slice().iter().map(|d| d.to_bits()).collect();
        prop_assert!(once.as_slice().iter().all(|d| given.contains(&d.to_bits())));
    }

    /// Where model and sensor agree, D' is the model, and the smoothing passes find nothing to change in depth
    /// that is even in their windows.
    #[test]
    fn a_consistent_buffer_stays(depth_m in 0.5..4.0f32, off in -0.04..0.04f32) {
        let mut model = GBuffer::empty(View::perspective(camera(), Pose::identity()));
        model.depth_m.fill(depth_m);
        let mut out = GBuffer::empty(model.view);
        let sensor = Image::new(SIZE, depth_m + off);
        DynGeo::new(&DynGeoParams::default()).run(&frame(sensor), &model, &mut out);
        prop_assert!(out.depth_m == model.depth_m);
    }

    /// Frames average, in whatever order.
    #[test]
    fn the_order_of_frames_does_not_matter(
        offsets in prop::collection::vec(-0.02..0.02f32, 2..8),
        tilt in -0.4..0.4f64,
    ) {
        let view = View::perspective(camera(), look_at(DVec3::new(tilt, -1.2, 0.2), DVec3::ZERO));
        let wall = AnalyticScene::new([Shape::Plane { normal: -Vec3::Y, offset: 0.0 }]);
        let depth_m = wall.render(&view).depth_m;
        let fused = |offsets: &mut dyn Iterator<Item = &f32>| {
            let params = VolumeParams { resolution: 32, color: false, ..VolumeParams::default() };
            let mut volume = TsdfVolume::new(&params, Vec3::ZERO).unwrap();
            for by in offsets {
                let moved = depth_m.as_slice().iter().map(|d| if *d > 0.0 { d + by } else { 0.0 });
                let moved = frame(Image::from_vec(SIZE, moved.collect()));
                volume.integrate(&moved, &view).unwrap();
            }
            volume
        };
        let (a, b) = (fused(&mut offsets.iter()), fused(&mut offsets.iter().rev()));
        // each average rounds by half a step at each frame, of which the later ones keep (n - 1) / n
        let steps = 2.0 * 0.25 * (offsets.len() as f32 + 1.0);
        let bound = steps * a.truncation_m() / f32::from(i16::MAX) + 1e-7;
        let mut seen = 0;
        for k in 0..32usize.pow(3) {
            let at = [k % 32, k / 32 % 32, k / 1024];
            match (a.voxel(at), b.voxel(at)) {
                (Some(x), Some(y)) => {
                    // a voxel at the end of the band is seen free, or not at all, by some of the frames
                    let inside = x.distance_m.abs() < a.truncation_m() - 0.05;
                    prop_assert!(!inside || x.weight == y.weight);
                    prop_assert!(!inside || (x.distance_m - y.distance_m).abs() <= bound, "{x:?} {y:?}");
                    seen += usize::from(inside);
                }
                (None, None) => {}
                (x, y) => prop_assert!(x.or(y).unwrap().distance_m.abs() > a.truncation_m() - 0.05),
            }
        }
        prop_assert!(seen > 500, "{seen}");
    }

    /// More directions are nearer to each other, and each hides less beside itself.
    #[test]
    fn chi_falls_with_the_number_of_directions(n in 8usize..200, seed in 0u32..100) {
        let set = |directions, chi| DirectionSet::new(&TransferParams { directions, chi, seed, ..Default::default() }).unwrap();
        let (few, many) = (set(n, ChiReading::Neighbour), set(4 * n, ChiReading::Neighbour));
        prop_assert!(many.neighbour_angle < few.neighbour_angle && many.chi < few.chi);
        prop_assert!(few.chi > 0.0 && few.chi < 1.0);
        prop_assert!(set(n, ChiReading::Text).chi < few.chi, "half the angle");
    }

    #[test]
    fn srgb_is_monotone_and_comes_back(a in 0.0..1.0f32, b in 0.0..1.0f32) {
        let (low, high) = (a.min(b), a.max(b));
        prop_assert!(srgb_from_linear(low) <= srgb_from_linear(high));
        prop_assert!(srgb8_from_linear(low) <= srgb8_from_linear(high));
        // the nearest code is within half a step, whose slope is below 1 / (12.92 * 255) at the foot and 2.3 / 255 at the top
        prop_assert!((LINEAR_FROM_SRGB8[usize::from(srgb8_from_linear(a))] - a).abs() < 0.5 * 2.3 / 255.0);
    }
}

#[test]
fn every_code_comes_back() {
    assert!(
        (0..=255u8).all(|code| srgb8_from_linear(LINEAR_FROM_SRGB8[usize::from(code)]) == code)
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(6))]

    /// A post to the right casts the shadow of one to the left. The directions are not symmetric: many of them, and
    /// means over blocks of pixels, are, nearly.
    #[test]
    fn a_mirrored_scene_has_mirrored_transfer(x in 0.15..0.4f32, height_m in 0.2..0.6f32) {
        let scene = |x: f32| {
            let (min, max) = (Vec3::new(x - 0.1, -0.1, 0.0), Vec3::new(x + 0.1, 0.1, height_m));
            AnalyticScene::new([Shape::Plane { normal: Vec3::Z, offset: 0.0 }, Shape::Box { min, max }])
        };
        let size = Size::new(64, 48);
        let pinhole = Pinhole { width: 64, height: 48, fx: 53.0, fy: 53.0, cx: 31.5, cy: 23.5 };
        let view = View::perspective(pinhole, look_at(DVec3::new(0.0, -1.5, 1.0), DVec3::ZERO));
        let params = TransferParams { directions: 256, samples: 4, ..TransferParams::default() };
        let transferred = |x: f32| {
            let mut map = TransferMap::default();
            let mut stage = RadianceTransfer::new(&params, &BounceParams::default()).unwrap();
            stage.transfer(&scene(x).render(&view), &[], &mut map);
            map
        };
        let (a, b) = (transferred(x), transferred(-x));
        // Y is odd in x for these of the first 16
        let odd = |k: usize| [3, 4, 7, 10, 13, 15].contains(&k);
        let (mut error, mut norm) = (0.0f64, 0.0f64);
        for block in 0..8 * 6 {
            for k in 0..16 {
                let (mut p, mut q) = (0.0f64, 0.0f64);
                for (i, j) in (0..64).map(|c| (block % 8 * 8 + c % 8, block / 8 * 8 + c / 8)) {
                    p += f64::from(a.at(i, j)[k]);
                    q += f64::from(b.at(size.width - 1 - i, j)[k]) * if odd(k) { -1.0 } else { 1.0 };
                }
                error += (p - q).powi(2);
                norm += p.powi(2);
            }
        }
        prop_assert!((error / norm).sqrt() < 0.03, "{}", (error / norm).sqrt());
    }
}
