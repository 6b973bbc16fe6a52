//! What fuzzing needs of the readers of recordings.

use super::calibration::{Calibration, CameraModel, usable_depth_factor};
use super::layout::{self, Layout};
use super::rig::Rig;
use super::{CaptureOptions, FrameSource, decode, inspect, open_sequence, trajectory};
use crate::fuzzing::{Scratch, accepted, files, parts};
use crate::image::{Image, Size};
use std::path::{Component, Path};

/// Lists and their association: the text files of a TUM, or an ICL-NUIM recording.
pub fn lists(data: &[u8], scratch: &Scratch) -> bool {
    let Some((kind, rest)) = data.split_first() else { return false };
    let (layout, folder, names): (_, _, &[&str]) = match kind {
        b'a' => (Layout::Tum, "associated", &["associations.txt", "groundtruth.txt"]),
        b'i' => (Layout::IclNuim, "icl-nuim", &["associations.txt", "x.gt.freiburg"]),
        _ => (Layout::Tum, "tum", &["rgb.txt", "depth.txt", "groundtruth.txt"]),
    };
    let folder = scratch.folder(folder);
    for (name, content) in names.iter().zip(parts(rest).chain(std::iter::repeat(&b""[..]))) {
        scratch.write(&folder.join(name), content);
    }
    let Ok(listing) = layout::list(layout, &folder, &CaptureOptions::default()) else {
        return false;
    };
    for entry in &listing.entries {
        assert!(stays_below(&folder, &entry.color) && stays_below(&folder, &entry.depth));
        assert!(entry.timestamp_s.is_finite() && entry.difference_s.is_finite());
    }
    assert!(listing.entries.windows(2).all(|w| w[0].timestamp_s <= w[1].timestamp_s));
    true
}

fn stays_below(folder: &Path, path: &Path) -> bool {
    path.starts_with(folder) && path.components().all(|c| c != Component::ParentDir)
}

/// Poses: a matrix of 7-Scenes, a Redwood log, TUM's trajectory.
pub fn poses(data: &[u8], scratch: &Scratch) -> bool {
    let Some((kind, rest)) = data.split_first() else { return false };
    let path = scratch.root().join("poses.txt");
    scratch.write(&path, rest);
    let finite = |pose: &crate::math::Pose| {
        let turn = pose.rotation.coords;
        pose.translation.vector.iter().all(|v| v.is_finite()) && (turn.norm() - 1.0).abs() < 1e-6
    };
    match kind {
        b'm' => accepted(trajectory::read_matrix(&path).map(|pose| assert!(finite(&pose)))),
        b'l' => accepted(trajectory::read_log(&path, &mut Vec::new()).map(|poses| {
            assert!(poses.iter().flatten().all(finite));
        })),
        _ => accepted(trajectory::read_tum(&path, &mut Vec::new()).map(|track| {
            for time in [0.0, 0.05, 1.0, 1e9] {
                assert!(track.at(time, trajectory::MAX_GAP_S).iter().all(finite));
            }
        })),
    }
}

/// Colour and depth pictures.
pub fn pictures(data: &[u8], _: &Scratch) -> bool {
    let color = decode::color_of(data).map(|picture| {
        assert_eq!(picture.as_slice().len(), picture.size().pixels());
    });
    let depth = decode::depth_of(data).map(|picture| {
        assert_eq!(picture.as_slice().len(), picture.size().pixels());
    });
    color.is_ok() || depth.is_ok()
}

/// Calibrations in every form, and pictures rectified and registered by them.
pub fn calibration(data: &[u8], scratch: &Scratch) -> bool {
    let Some((kind, rest)) = data.split_first() else { return false };
    let extension = match kind {
        b'y' => "yaml",
        b'j' => "json",
        b'x' => "txt",
        _ => "toml",
    };
    let path = scratch.root().join(format!("calibration.{extension}"));
    scratch.write(&path, rest);
    let Ok(calibration) = Calibration::read(&path, Some(Size::new(640, 480))) else {
        return false;
    };
    let text = calibration.to_toml().expect("a checked calibration can be written");
    Calibration::from_toml(&text).expect("and read again");
    apply(&calibration);
    true
}

/// Small pictures through all that the calibration says.
fn apply(calibration: &Calibration) {
    let small = |camera: &CameraModel| {
        [Size::new(64, 48), Size::new(48, 48), Size::new(64, 36)]
            .into_iter()
            .find(|&size| camera.scaled_to(size).is_some())
    };
    let Some(color_size) = small(&calibration.color) else { return };
    let Some(depth_size) = calibration.depth.as_ref().map_or(Some(color_size), small) else {
        return;
    };
    let factor = calibration.depth_factor.unwrap_or(1000.0);
    let rig = Rig::new(calibration, color_size, depth_size, factor, &mut Vec::new());
    let Ok(mut rig) = rig else { return };
    let stored = (0..depth_size.pixels()).map(|i| 400 + 3 * (i % 97) as u16).collect();
    let (_, depth_m) = rig
        .frame::<String>(
            || Ok(Image::new(color_size, [9, 90, 200])),
            || Ok(Image::from_vec(depth_size, stored)),
        )
        .expect("pictures of the announced sizes");
    assert!(depth_m.as_slice().iter().all(|d| d.is_finite() && *d >= 0.0));
}

/// A recording as a folder of files: opened, inspected, and every frame read.
pub fn sequence(data: &[u8], scratch: &Scratch) -> bool {
    let folder = scratch.emptied("sequence");
    for (name, content) in files(data).take(16) {
        let path = folder.join(name);
        scratch.write(&path, content);
    }
    let Ok(mut sequence) = open_sequence(&folder, &CaptureOptions::default()) else {
        return false;
    };
    assert!(usable_depth_factor(sequence.info().depth_factor));
    let size = sequence.camera().size();
    let mut delivered = 0;
    // Once more for the end, and once for the error that nothing could be read.
    let ended = (0..sequence.pairs() + 2).any(|_| match sequence.next_frame() {
        Ok(Some(frame)) => {
            assert_eq!((frame.color.size(), frame.depth_m.size()), (size, size));
            assert!(frame.depth_m.as_slice().iter().all(|d| d.is_finite() && *d >= 0.0));
            delivered += 1;
            false
        }
        Ok(None) => true,
        Err(_) => false,
    });
    assert!(ended, "{} pairs and no end", sequence.pairs());
    if let Ok(report) = inspect(&folder, &CaptureOptions::default()) {
        let _ = report.to_string();
    }
    delivered > 0
}
