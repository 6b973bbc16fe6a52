//! What is written comes back.

use crate::arbitrary::*;
use kinlight::capture::calibration::{CameraModel, Disparity, Distortion, Rigid, Vignetting};
use kinlight::capture::trajectory::read_tum;
use kinlight::capture::writer::{ColorFormat, DEPTH_SCALE, DepthCompression, FrameRef, TumWriter};
use kinlight::capture::{Calibration, CaptureOptions, FrameSource, open_sequence};
use kinlight::image::{Image, Size};
use kinlight::math::{Pinhole, pose_from_xyzw};
use kinlight::output::TrajectoryWriter;
use proptest::prelude::*;

fn distortion() -> impl Strategy<Value = Distortion> {
    let k = || -0.3..0.3f64;
    prop_oneof![
        Just(Distortion::None),
        (k(), k(), k(), k(), k()).prop_map(|(k1, k2, p1, p2, k3)| Distortion::Brown {
            k1,
            k2,
            p1,
            p2,
            k3
        }),
        (k(), k(), k(), k()).prop_map(|(k1, k2, k3, k4)| Distortion::KannalaBrandt {
            k1,
            k2,
            k3,
            k4
        }),
        (k(), k(), k(), k(), k(), k(), k(), k()).prop_map(|(k1, k2, p1, p2, k3, k4, k5, k6)| {
            Distortion::Rational { k1, k2, p1, p2, k3, k4, k5, k6 }
        }),
    ]
}

fn camera() -> impl Strategy<Value = CameraModel> {
    (
        1usize..4000,
        1usize..4000,
        1e-3..1e5f64,
        1e-3..1e5f64,
        -1e4..1e4f64,
        -1e4..1e4f64,
        distortion(),
    )
        .prop_map(|(width, height, fx, fy, cx, cy, distortion)| CameraModel {
            width,
            height,
            fx,
            fy,
            cx,
            cy,
            distortion,
        })
}

fn calibration() -> impl Strategy<Value = Calibration> {
    let rigid = (direction(), -10.0..10.0f64, rotation()).prop_map(|(t, metres, q)| Rigid {
        translation_m: (metres * t).to_array(),
        rotation_xyzw: [q.x, q.y, q.z, q.w],
    });
    let parts = (
        "\\PC*",
        "\\PC*",
        camera(),
        prop::option::of((camera(), rigid)),
        prop::option::of(1e-3..1e5f64),
        prop::collection::vec(any::<u16>(), 0..4),
        prop::option::of((1.0..5.0f64, -0.01..-1e-4f64)),
        prop::option::of(-0.5..0.2f64),
    );
    parts.prop_map(|(name, notes, color, depth, factor, invalid_depth, disparity, falloff)| {
        let mut out = Calibration::registered(name, color);
        out.registered = depth.is_none();
        (out.notes, out.depth_factor, out.invalid_depth) = (notes, factor, invalid_depth);
        if let Some((model, rigid)) = depth {
            (out.depth, out.color_from_depth) = (Some(model), Some(rigid));
        }
        out.disparity = disparity.map(|(c0, c1)| Disparity { c0, c1 });
        out.photometry.vignetting =
            falloff.map(|a| Vignetting { center: [0.5, 0.5], falloff: [a, 0.0, 0.01] });
        out
    })
}

proptest! {
    #[test]
    fn calibrations_come_back(written in calibration()) {
        let text = written.to_toml().unwrap();
        // what a file may not hold is refused when it is read, not changed
        match (written.check(), Calibration::from_toml(&text)) {
            (Ok(()), Ok(read)) => prop_assert_eq!(written, read),
            (Err(_), Err(_)) => {}
            (checked, read) => prop_assert!(false, "{:?} {:?}", checked, read),
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn paths_come_back(
        start_s in 0.0..2e9f64,
        steps in prop::collection::vec((1u32..1_000_000, direction(), -1e3..1e3f64, rotation()), 1..20),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trajectory.txt");
        let mut writer = TrajectoryWriter::create(&path).unwrap();
        let mut micros = (start_s * 1e6).round();
        let mut written = Vec::new();
        for (step, t, metres, q) in steps {
            micros += f64::from(step);
            let pose = pose_from_xyzw((metres * t).to_array(), [q.x, q.y, q.z, q.w]).unwrap();
            writer.push(micros / 1e6, &pose).unwrap();
            written.push((micros / 1e6, pose));
        }
        let mut warnings = Vec::new();
        let track = read_tum(&path, &mut warnings).unwrap();
        prop_assert!(warnings.is_empty(), "{warnings:?}");
        prop_assert_eq!(track.len(), written.len());
        for (time_s, pose) in written {
            // times have a microsecond, and f64 a quarter of one in a billion seconds: the nearest sample
            let time_s: f64 = format!("{time_s:.6}").parse().unwrap();
            let back = track.at(time_s, 0.0).expect("a pose at this very time");
            let apart = pose.inv_mul(&back);
            // half a unit of the last printed digit, of every number; rotation moves the translation by nothing
            prop_assert!((pose.translation.vector - back.translation.vector).norm() < 1e-9);
            prop_assert!(apart.rotation.angle() < 4e-8, "{}", apart.rotation.angle());
        }
    }

    /// Every step of a 16-bit picture, through a recording on disk.
    #[test]
    fn depth_and_colour_pictures_come_back(
        steps in prop::collection::vec(any::<u16>(), 12 * 9),
        codes in prop::collection::vec(any::<[u8; 3]>(), 12 * 9),
        small: bool,
    ) {
        let size = Size::new(12, 9);
        let depth_m = Image::from_vec(size, steps.iter().map(|&s| f32::from(s) / DEPTH_SCALE).collect());
        let color = Image::from_vec(size, codes);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("recording");
        let camera = Pinhole { width: 12, height: 9, fx: 10.0, fy: 10.0, cx: 5.5, cy: 4.0 };
        let compression = if small { DepthCompression::Small } else { DepthCompression::Fast };
        let mut writer = TumWriter::create(&path, camera, ColorFormat::Png, compression).unwrap();
        let frame = FrameRef {
            timestamp_s: 12.5,
            color: &color,
            depth_m: &depth_m,
            second_depth_m: None,
            world_from_camera: None,
        };
        writer.push(&frame).unwrap();
        prop_assert!(writer.loss().is_none());
        prop_assert_eq!(writer.finish().unwrap(), 1);
        let mut sequence = open_sequence(&path, &CaptureOptions::default()).unwrap();
        let read = sequence.next_frame().unwrap().expect("a frame");
        prop_assert_eq!(sequence.camera(), camera);
        prop_assert_eq!(read.timestamp_s, 12.5);
        prop_assert!(read.color == color);
        prop_assert!(read.depth_m == depth_m, "{:?}", read.depth_m);
    }
}
