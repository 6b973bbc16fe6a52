//! Broken recordings: a bad frame is a named skip, a bad list an error with file and line, never a panic.

use super::made_sequences::{INTRINSICS, Made, SIZE};
use super::*;
use crate::image::Size;

/// Five good frames in the TUM layout.
fn five() -> Made {
    let made = Made::new();
    let (mut rgb, mut depth) = (String::new(), String::new());
    for i in 0..5 {
        made.color(&format!("rgb/{i}.png"), SIZE);
        made.flat_depth(&format!("depth/{i}.png"));
        rgb += &format!("{}.0 rgb/{i}.png\n", i);
        depth += &format!("{}.0 depth/{i}.png\n", i);
    }
    made.write("rgb.txt", rgb);
    made.write("depth.txt", depth);
    made.write("intrinsics.txt", INTRINSICS);
    made
}

fn cut(made: &Made, name: &str) {
    let bytes = std::fs::read(made.path().join(name)).unwrap();
    made.write(name, &bytes[..bytes.len() / 2]);
}

fn delivered(sequence: &mut Sequence) -> Vec<usize> {
    std::iter::from_fn(|| sequence.next_frame().unwrap()).map(|f| f.index).collect()
}

#[test]
fn broken_frames_are_skipped_by_name_and_the_rest_goes_on() {
    type Break = fn(&Made);
    let cases: [(Break, &str); 8] = [
        (|m| std::fs::remove_file(m.path().join("rgb/2.png")).unwrap(), "rgb/2.png"),
        (|m| cut(m, "rgb/2.png"), "rgb/2.png"),
        (|m| cut(m, "depth/2.png"), "depth/2.png"),
        (|m| m.write("depth/2.png", ""), "depth/2.png"),
        (|m| m.color("rgb/2.png", Size::new(80, 60)), "80x60"),
        (|m| m.color("depth/2.png", SIZE), "16-bit"),
        (|m| m.write("rgb/2.png", "not a picture"), "rgb/2.png"),
        (|m| m.depth("depth/2.png", &Image::new(Size::new(3, 2), 1.0), 1000.0), "3x2"),
    ];
    for (i, (damage, word)) in cases.into_iter().enumerate() {
        let made = five();
        damage(&made);
        let mut sequence = made.open().unwrap();
        assert_eq!(delivered(&mut sequence), [0, 1, 3, 4], "case {i}");
        let [skip] = sequence.skipped() else { panic!("case {i}: {:?}", sequence.skipped()) };
        assert_eq!((skip.index, skip.name.as_str()), (2, "rgb/2.png"));
        assert!(skip.reason.contains(word), "case {i}: {}", skip.reason);
        assert!(matches!(sequence.frame(2), Err(CaptureError::Frame { frame: 2, .. })));
    }
}

#[test]
fn a_cut_jpeg_is_not_delivered_half_grey() {
    let made = five();
    made.color("rgb/2.jpg", SIZE);
    cut(&made, "rgb/2.jpg");
    std::fs::rename(made.path().join("rgb/2.jpg"), made.path().join("rgb/2.png")).unwrap();
    let mut sequence = made.open().unwrap();
    assert_eq!(delivered(&mut sequence), [0, 1, 3, 4]);
    assert!(sequence.skipped()[0].reason.contains("cut off"));
}

#[test]
fn a_broken_first_frame_does_not_hide_the_others() {
    let made = five();
    made.write("rgb/0.png", "x");
    made.write("depth/0.png", "x");
    assert_eq!(delivered(&mut made.open().unwrap()), [1, 2, 3, 4]);
    for i in 0..5 {
        cut(&made, &format!("depth/{i}.png"));
    }
    // Headers are whole, so it opens; that nothing can be read is said once.
    let mut sequence = made.open().unwrap();
    let error = sequence.next_frame().unwrap_err().to_string();
    assert!(error.contains("none of 5 frames"), "{error}");
    assert!(sequence.next_frame().unwrap().is_none());
    assert_eq!(sequence.skipped().len(), 5);
}

#[test]
fn huge_pictures_are_refused_by_their_header() {
    let made = five();
    // A PNG header of 60000 x 60000 and nothing else.
    let mut png = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\xea\x60\0\0\xea\x60\x08\x02\0\0\0".to_vec();
    png.extend(crc32(&png[12..]).to_be_bytes());
    png.extend(b"\0\0\0\x01IDATx\0\0\0\0");
    made.write("rgb/2.png", png);
    let mut sequence = made.open().unwrap();
    assert_eq!(delivered(&mut sequence), [0, 1, 3, 4]);
    let reason = &sequence.skipped()[0].reason;
    assert!(reason.contains("60000x60000"), "{reason}");
}

/// CRC of PNG chunks.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, &byte| {
        (0..8).fold(
            crc ^ u32::from(byte),
            |c, _| if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 },
        )
    })
}

#[test]
fn lists_name_file_and_line() {
    let error = |name: &str, content: &str| {
        let made = five();
        made.write(name, content);
        made.open().map(|s| s.info().pairs).unwrap_err().to_string()
    };
    for (name, content, words) in [
        ("rgb.txt", "", "rgb.txt: the list is empty"),
        ("rgb.txt", "# only\r\n\r\n# comments\r\n", "rgb.txt: the list is empty"),
        (
            "rgb.txt",
            "0.0 rgb/0.png\n1.0 ../../secret.png\n",
            "rgb.txt:2: \"../../secret.png\" points outside",
        ),
        ("depth.txt", "0.0 /etc/passwd\n", "depth.txt:1: \"/etc/passwd\" points outside"),
        ("rgb.txt", "# a\nzero rgb/0.png\n", "rgb.txt:2: \"zero\" is not a time stamp"),
        ("rgb.txt", "nan rgb/0.png\n", "rgb.txt:1: time stamp NaN"),
        ("rgb.txt", "0.0\n", "rgb.txt:1: \"0.0\" is not \"timestamp file\""),
        ("rgb.txt", "500.0 rgb/0.png\n", "make no pair"),
        ("groundtruth.txt", "1 2 3\n", "groundtruth.txt:1: 3 numbers"),
        ("groundtruth.txt", "1 2 3 x 5 6 7 8\n", "groundtruth.txt:1: \"x\" is not a number"),
        ("intrinsics.txt", "-1 1 2 3 160 120 5000\n", "focal lengths"),
        ("intrinsics.txt", "100 100 2 3 640 360 5000\n", "cannot be scaled"),
        ("intrinsics.txt", "100 100 2 3 160 120 0\n", "depth_factor"),
        // Zero, and infinite, where the pipeline computes.
        ("intrinsics.txt", "1e-300 100 2 3 160 120 5000\n", "focal lengths"),
        ("intrinsics.txt", "100 100 1e300 3 160 120 5000\n", "principal point"),
        ("intrinsics.txt", "100 100 2 3 160 120 1e-36\n", "depth_factor"),
        ("rgb.txt", "1e300 rgb/0.png\n", "rgb.txt:1: time stamp 1e300"),
    ] {
        let found = error(name, content);
        assert!(found.contains(words), "{name} {content:?}: {found}");
    }
    let made = five();
    std::fs::remove_file(made.path().join("depth.txt")).unwrap();
    assert!(made.open().unwrap_err().to_string().contains("depth.txt"));
    made.write("rgb.txt", [0xff, 0xfe, 0x00]);
    assert!(made.open().unwrap_err().to_string().contains("not text"));
}

#[cfg(unix)]
#[test]
fn links_out_of_a_recording_are_refused_unless_asked_for() {
    use std::os::unix::fs::symlink;
    let follow = CaptureOptions { follow_links: true, ..CaptureOptions::default() };
    // The linked file is a good one, so that only where it lies can be wrong.
    for name in ["rgb/2.png", "depth/2.png", "rgb", "rgb.txt", "groundtruth.txt", "intrinsics.txt"]
    {
        let (made, elsewhere) = (five(), Made::new());
        made.write("groundtruth.txt", "1 0 0 0 0 0 0 1\n");
        let (here, there) = (made.path().join(name), elsewhere.path().join("moved"));
        std::fs::rename(&here, &there).unwrap();
        symlink(&there, &here).unwrap();
        let error = made.open().map(|s| s.info().pairs).unwrap_err().to_string();
        assert!(error.contains(name) && error.contains("leads out of the recording"), "{error}");
        let mut followed = open_sequence(made.path(), &follow).unwrap();
        assert_eq!(delivered(&mut followed), [0, 1, 2, 3, 4], "{name}");

        // A link that stays inside is nobody's concern, and neither is one that is not used.
        std::fs::remove_file(&here).unwrap();
        std::fs::rename(&there, made.path().join("moved")).unwrap();
        symlink("moved", &here).unwrap_or_else(|e| panic!("{name}: {e}"));
        if name.contains('/') {
            std::fs::remove_file(&here).unwrap();
            symlink("../moved", &here).unwrap();
        }
        symlink(elsewhere.path(), made.path().join("unused")).unwrap();
        assert_eq!(delivered(&mut made.open().unwrap()), [0, 1, 2, 3, 4], "{name}");
    }

    let made = Made::new();
    let elsewhere = Made::new();
    elsewhere.write("pose.txt", "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n");
    made.color("frame-000000.color.png", SIZE);
    made.flat_depth("frame-000000.depth.png");
    symlink(elsewhere.path().join("pose.txt"), made.path().join("frame-000000.pose.txt")).unwrap();
    assert!(made.open().unwrap_err().to_string().contains("leads out"));
    assert_eq!(open_sequence(made.path(), &follow).unwrap().info().frames_with_pose, 1);

    let made = Made::new();
    made.color("color/0.png", SIZE);
    made.flat_depth("depth/0.png");
    elsewhere.write("log", "0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n");
    symlink(elsewhere.path().join("log"), made.path().join("trajectory.log")).unwrap();
    assert!(made.open().unwrap_err().to_string().contains("leads out"));
}

#[test]
fn time_stamps_out_of_order_are_sorted_and_named() {
    let made = five();
    made.write(
        "rgb.txt",
        "1.0 rgb/1.png\n0.0 rgb/0.png\n2.0 rgb/2.png\n2.0 rgb/3.png\n4.0 rgb/4.png\n",
    );
    let mut sequence = made.open().unwrap();
    let warnings = sequence.info().warnings.join("; ");
    assert!(warnings.contains("backwards, first at rgb/0.png"), "{warnings}");
    assert!(warnings.contains("first rgb/3.png"), "{warnings}");
    let times: Vec<_> =
        std::iter::from_fn(|| sequence.next_frame().unwrap()).map(|f| f.timestamp_s).collect();
    assert_eq!(times, [0.0, 1.0, 2.0, 4.0]);
    assert_eq!(sequence.name(2), "rgb/2.png");
}

#[test]
fn poses_that_are_not_rigid_are_left_out_by_name() {
    let made = five();
    made.write(
        "groundtruth.txt",
        "0 0 0 0 0 0 0 1\n1 0 0 nan 0 0 0 1\n2 0 0 0 0 0 0 3\n3 1 0 0 0 0 0 1\n4 0 0 0 0 0 0 0\n",
    );
    let sequence = made.open().unwrap();
    assert_eq!(sequence.info().frames_with_pose, 2);
    for line in ["groundtruth.txt:2", "groundtruth.txt:3", "groundtruth.txt:5", "3 of 5 frames"] {
        assert!(sequence.info().warnings.iter().any(|w| w.contains(line)), "{line}");
    }

    let made = Made::new();
    let rows = |m: &str| m.replace(';', "\n");
    for (i, pose) in [
        "1 0 0 0;0 1 0 0;0 0 1 0;0 0 0 1",
        "2 0 0 0;0 2 0 0;0 0 2 0;0 0 0 1",
        "-inf 0 0 0;0 1 0 0;0 0 1 0;0 0 0 1",
        "1 0 0 0;0 1 0 0",
        "1 0 0;0 1 0;0 0 1;0 0 0",
    ]
    .into_iter()
    .enumerate()
    {
        made.color(&format!("frame-{i:06}.color.png"), SIZE);
        made.flat_depth(&format!("frame-{i:06}.depth.png"));
        made.write(&format!("frame-{i:06}.pose.txt"), rows(pose));
    }
    let mut sequence = made.open().unwrap();
    assert_eq!((sequence.info().frames_with_pose, sequence.info().warnings.len() >= 4), (1, true));
    assert_eq!(delivered(&mut sequence), [0, 1, 2, 3, 4]);

    let made = Made::new();
    made.color("color/0.png", SIZE);
    made.flat_depth("depth/0.png");
    made.write("trajectory.log", "0 0 1\n1 0 0 0\n0 1 0 0\n");
    assert!(made.open().unwrap_err().to_string().contains("cut off"));
    made.write("trajectory.log", "99999999999 0 1\n");
    assert!(made.open().unwrap_err().to_string().contains("out of range"));
}

#[test]
fn what_is_no_recording_says_so() {
    let made = Made::new();
    assert!(made.open().unwrap_err().to_string().contains("no recording recognised"));
    assert!(open_sequence(Path::new("/no/such/folder"), &CaptureOptions::default()).is_err());
    let made = five();
    let open = |options: CaptureOptions| {
        open_sequence(made.path(), &options).map(|s| s.info().pairs).unwrap_err().to_string()
    };
    let default = CaptureOptions::default;
    assert!(open(CaptureOptions { first_frame: 5, ..default() }).contains("5..5 of 5"));
    assert!(open(CaptureOptions { depth_factor: Some(-1.0), ..default() }).contains("positive"));
    assert!(
        open(CaptureOptions { max_time_difference_s: f64::NAN, ..default() }).contains("positive")
    );
    assert!(
        open(CaptureOptions { depth_list: Some("../x".into()), ..default() }).contains("outside")
    );
    let no_lens = "name = \"f\"\nregistered = true\n[color]\nwidth = 160\nheight = 120\nfx = 100.0\nfy = 100.0\n\
        cx = 79.5\ncy = 59.5\n[photometry.vignetting]\ncenter = [0.5, 0.5]\nfalloff = [-9.0, 0.0, 0.0]\n";
    made.write("calibration.toml", no_lens);
    assert!(made.open().unwrap_err().to_string().contains("vignetting"));
    made.write("calibration.toml", "name = 3");
    assert!(made.open().unwrap_err().to_string().contains("calibration.toml"));
}
