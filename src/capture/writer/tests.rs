//! What is written comes back.

use super::*;
use crate::image::{Image, Size};
use crate::math::Pose;
use std::fs;

fn camera() -> Pinhole {
    Pinhole { width: 7, height: 5, fx: 6.5, fy: 6.0, cx: 3.0, cy: 2.0 }
}

fn writer(folder: &Path) -> TumWriter {
    TumWriter::create(folder, camera(), ColorFormat::Png, DepthCompression::Small)
        .expect("an empty folder")
}

#[test]
fn pictures_and_lists_come_back() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let size = Size::new(7, 5);
    let color = Image::from_vec(size, (0..35u8).map(|i| [i, 2 * i, 7 * i]).collect());
    let depth_m = Image::from_vec(size, (0..35).map(|i| i as f32 * 0.25).collect());
    let pose = crate::math::pose_from_xyzw([1.0, -2.0, 0.5], [0.5, -0.5, 0.5, 0.5])
        .expect("a unit quaternion");
    let mut out = writer(folder.path());
    for i in 0..3 {
        out.push(&FrameRef {
            timestamp_s: 1000.0 + f64::from(i) / 30.0,
            color: &color,
            depth_m: &depth_m,
            second_depth_m: None,
            world_from_camera: Some(&pose),
        })
        .expect("room on the disk");
    }
    assert_eq!(out.finish().expect("a synced disk"), 3);

    let read = |name: &str| fs::read_to_string(folder.path().join(name)).expect(name);
    assert_eq!(read("rgb.txt").lines().nth(2), Some("1000.033333 rgb/1000.033333.png"));
    assert_eq!(
        read("associations.txt").lines().nth(3),
        Some("1000.066667 rgb/1000.066667.png 1000.066667 depth/1000.066667.png")
    );
    assert_eq!(read("intrinsics.txt").lines().nth(1), Some("6.5 6.0 3.0 2.0 7 5 5000"));
    assert!(read("groundtruth.txt").contains("1000.000000 1.00000000 -2.00000000 0.5"));
    let back = image::open(folder.path().join("rgb/1000.000000.png")).expect("a PNG");
    assert_eq!(back.into_rgb8().into_raw(), color.as_slice().as_flattened());
    let back = image::open(folder.path().join("depth/1000.000000.png")).expect("a PNG");
    let steps: Vec<u16> =
        depth_m.as_slice().iter().map(|&d| DepthFormat::default().steps(d)).collect();
    assert_eq!(back.into_luma16().into_raw(), steps);
    let left = fs::read_dir(folder.path().join("rgb")).expect("a folder").count();
    assert_eq!(left, 3, "no temporary file stays");
}

#[test]
fn second_depth_has_a_folder_and_list_of_its_own() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut out = writer(folder.path()).with_second_depth("depth_noisy").expect("a folder");
    let size = Size::new(7, 5);
    let (color, depth_m) = (Image::new(size, [9; 3]), Image::new(size, 2.0));
    let second = Image::new(size, 2.1);
    let mut frame = FrameRef {
        timestamp_s: 7.5,
        color: &color,
        depth_m: &depth_m,
        second_depth_m: Some(&second),
        world_from_camera: None,
    };
    out.push(&frame).expect("room on the disk");
    frame.second_depth_m = None;
    assert!(out.push(&frame).is_err(), "a frame without its second depth");
    let list = fs::read_to_string(folder.path().join("depth_noisy.txt")).expect("a list");
    assert_eq!(list.lines().nth(1), Some("7.500000 depth_noisy/7.500000.png"));
    let back = image::open(folder.path().join("depth_noisy/7.500000.png")).expect("a PNG");
    assert!(back.into_luma16().into_raw().iter().all(|&d| d == 10_500));
    assert!(!folder.path().join("groundtruth.txt").exists());
}

#[test]
fn refuses_wrong_sizes_and_used_folders() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut out = writer(folder.path());
    let color = Image::new(Size::new(7, 4), [0; 3]);
    let depth_m = Image::new(Size::new(7, 5), 1.0);
    let error = out
        .push(&FrameRef {
            timestamp_s: 0.0,
            color: &color,
            depth_m: &depth_m,
            second_depth_m: None,
            world_from_camera: None,
        })
        .expect_err("the sizes differ");
    assert!(error.to_string().contains("7x4"), "{error}");
    let second =
        TumWriter::create(folder.path(), camera(), ColorFormat::Png, DepthCompression::Fast);
    assert!(second.is_err());
}
