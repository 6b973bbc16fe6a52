//! 7-Scenes: `frame-NNNNNN.color.png`, `frame-NNNNNN.depth.png`, `frame-NNNNNN.pose.txt` in one folder.

use super::{ASSUMED_RATE_HZ, Entry, Listing, file_names, own};
use crate::capture::calibration::{Calibration, SEVEN_SCENES, built_in};
use crate::capture::sequence::CaptureOptions;
use crate::capture::{CaptureError, trajectory};
use crate::image::Size;
use std::collections::BTreeMap;
use std::path::Path;

pub(super) fn is_color(name: &str) -> bool {
    matches!(parts(name), Some((_, "color.png" | "color.jpg")))
}

/// Frame number and the rest of the name.
fn parts(name: &str) -> Option<(u64, &str)> {
    let (digits, rest) = name.strip_prefix("frame-")?.split_once('.')?;
    let number = digits.bytes().all(|b| b.is_ascii_digit()).then(|| digits.parse().ok())??;
    Some((number, rest))
}

pub(super) fn list(folder: &Path, options: &CaptureOptions) -> Result<Listing, CaptureError> {
    if let Some(name) = &options.depth_list {
        let problem = format!("depth_list \"{name}\": 7-scenes recordings have no lists");
        return Err(CaptureError::Sequence(problem));
    }
    let names = file_names(folder)?;
    let (mut colors, mut depths) = (BTreeMap::new(), BTreeMap::new());
    for name in &names {
        match parts(name) {
            Some((number, "color.png" | "color.jpg")) => drop(colors.insert(number, name)),
            Some((number, "depth.png")) => drop(depths.insert(number, name)),
            _ => {}
        }
    }
    let alone = |of: &BTreeMap<u64, &String>, other: &BTreeMap<u64, &String>| {
        of.iter().filter(|(n, _)| !other.contains_key(n)).map(|(_, name)| (*name).clone()).collect()
    };
    let mut listing = Listing {
        colors: colors.len(),
        depths: depths.len(),
        color_orphans: alone(&colors, &depths),
        depth_orphans: alone(&depths, &colors),
        ..Listing::default()
    };
    let first = colors.keys().next().copied().unwrap_or(0);
    for (number, name) in &colors {
        let Some(depth) = depths.get(number) else { continue };
        let pose = folder.join(depth.replace("depth.png", "pose.txt"));
        let pose = match pose.is_file() {
            true => Some(trajectory::read_matrix(&own(folder, pose, options)?)),
            false => None,
        };
        if pose.is_some() {
            listing.poses = Some("frame-*.pose.txt".into());
        }
        let pose = pose.and_then(|read| {
            read.map_err(|e| listing.warnings.push(format!("{e}; the frame has no pose"))).ok()
        });
        listing.entries.push(Entry {
            name: (*name).clone(),
            color: folder.join(name),
            depth: folder.join(depth),
            timestamp_s: (number - first) as f64 / ASSUMED_RATE_HZ,
            difference_s: 0.0,
            pose,
        });
    }
    Ok(listing)
}

/// Colour and depth of 7-Scenes are not registered: the built-in estimate of the colour camera, with the
/// recording's own depth camera where it is given.
pub(super) fn calibration(
    folder: &Path,
    pictures: Size,
    options: &CaptureOptions,
) -> Result<Option<(Calibration, String)>, CaptureError> {
    let Some(mut calibration) = built_in(SEVEN_SCENES) else { return Ok(None) };
    let mut source = format!("built-in {SEVEN_SCENES} (estimate)");
    let file = folder.join("camera-intrinsics.txt");
    if file.is_file() {
        let given = Calibration::read(&own(folder, file, options)?, Some(pictures))?.color;
        calibration.depth = Some(given);
        source += ", depth camera from camera-intrinsics.txt";
    }
    Ok(Some((calibration, source)))
}
