//! What is written comes back.

use super::*;
use crate::image::{Image, Size};
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

mod recorder {
    use super::*;
    use crate::capture::{CaptureOptions, FrameSource, RawFrame, open_sequence};

    fn frame(index: usize, size: Size) -> RawFrame {
        let mm = |i: usize| ((i * 37 + index * 11) % 9000) as f32 / 1000.0;
        RawFrame {
            index,
            timestamp_s: 100.0 + index as f64 / 32.0,
            color: Image::from_vec(
                size,
                (0..size.pixels()).map(|i| [(i + index) as u8; 3]).collect(),
            ),
            depth_m: Image::from_vec(size, (0..size.pixels()).map(mm).collect()),
            world_from_camera: None,
            exposure_s: None,
        }
    }

    fn started(folder: &Path) -> TumWriter {
        let options = TumOptions {
            camera: camera(),
            color: ColorFormat::Png,
            depth: DepthFormat::default(),
            calibration: Some(("a camera".into(), "of a test".into())),
        };
        TumWriter::start(folder, &options).expect("an empty folder")
    }

    #[test]
    fn frames_come_back_equal_and_in_order() {
        let folder = tempfile::tempdir().unwrap();
        let mut recorder = Recorder::new(started(folder.path()), 3).unwrap();
        for index in 0..60 {
            recorder.push(frame(index, camera().size())).unwrap();
        }
        let (writer, counts) = recorder.finish().unwrap();
        assert_eq!(counts, RecorderCounts { written: 60, dropped: 0 });
        assert!(writer.loss().is_none());
        assert_eq!(writer.finish().unwrap(), 60);

        let mut back = open_sequence(folder.path(), &CaptureOptions::default()).unwrap();
        assert_eq!(back.camera(), camera());
        assert_eq!(back.info().camera_from, "calibration.toml");
        assert!(back.info().warnings.is_empty(), "{:?}", back.info().warnings);
        for index in 0..60 {
            let (read, written) =
                (back.next_frame().unwrap().unwrap(), frame(index, camera().size()));
            assert_eq!(read.timestamp_s, written.timestamp_s);
            assert_eq!(read.color, written.color);
            assert_eq!(read.depth_m, written.depth_m, "millimetres are exact");
        }
        assert!(back.next_frame().unwrap().is_none());
    }

    #[test]
    fn a_folder_that_goes_away_is_an_error_once_and_what_is_written_stays() {
        let folder = tempfile::tempdir().unwrap();
        let mut recorder = Recorder::new(started(folder.path()), 1).unwrap();
        recorder.push(frame(0, camera().size())).unwrap();
        while recorder.counts().written == 0 {
            std::thread::yield_now();
        }
        fs::rename(folder.path().join("depth"), folder.path().join("kept")).unwrap();
        fs::write(folder.path().join("depth"), b"in the way").unwrap();
        let mut index = 1;
        let error = loop {
            if let Err(error) = recorder.push(frame(index, camera().size())) {
                break error.to_string();
            }
            index += 1;
        };
        assert!(error.contains("depth/100.031250.png"), "{error}");
        let later = recorder.push(frame(index, camera().size())).unwrap_err().to_string();
        assert!(later.contains("has ended"), "{later}");
        drop(recorder);
        fs::remove_file(folder.path().join("depth")).unwrap();
        fs::rename(folder.path().join("kept"), folder.path().join("depth")).unwrap();
        let mut back = open_sequence(folder.path(), &CaptureOptions::default()).unwrap();
        assert_eq!(back.pairs(), 1);
        assert_eq!(back.next_frame().unwrap().unwrap().depth_m, frame(0, camera().size()).depth_m);
    }

    #[test]
    fn a_camera_that_is_too_fast_loses_frames_but_no_time() {
        let folder = tempfile::tempdir().unwrap();
        let mut recorder = Recorder::new(started(folder.path()), 1).unwrap();
        let start = std::time::Instant::now();
        for index in 0..5000 {
            recorder.offer(frame(index, camera().size())).unwrap();
        }
        let offered = start.elapsed();
        let (_, counts) = recorder.finish().unwrap();
        assert_eq!(counts.written + counts.dropped, 5000);
        assert!(counts.dropped > 0 && counts.written > 0, "{counts:?} in {offered:?}");
    }

    #[test]
    fn two_frames_of_one_time_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let mut writer = started(folder.path());
        let encoder = writer.encoder();
        let (color, depth_m) =
            (Image::new(camera().size(), [0; 3]), Image::new(camera().size(), 1.0));
        let at = |timestamp_s| FrameRef {
            timestamp_s,
            color: &color,
            depth_m: &depth_m,
            second_depth_m: None,
            world_from_camera: None,
        };
        writer.add(&encoder.encode(&at(1.0)).unwrap()).unwrap();
        let error = writer.add(&encoder.encode(&at(1.0 + 1e-7)).unwrap()).unwrap_err();
        assert!(error.to_string().contains("1.000000"), "{error}");
    }
}
