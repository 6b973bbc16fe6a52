//! TUM RGB-D lists, and ICL-NUIM's version of them.

use super::{ASSUMED_RATE_HZ, Entry, Listed, Listing, listed, own, pair_by_time, read_list};
use crate::capture::sequence::CaptureOptions;
use crate::capture::trajectory::{self, MAX_GAP_S, Trajectory};
use crate::capture::{CaptureError, text};
use crate::files;
use crate::math::Pose;
use nalgebra::{Quaternion, Translation3, UnitQuaternion};
use std::path::Path;

pub(super) const ASSOCIATION_FILES: [&str; 3] =
    ["associations.txt", "association.txt", "associate.txt"];

/// `rgb.txt` and a depth list, associated by time; where there is no `rgb.txt`, the association file.
pub(super) fn list(folder: &Path, options: &CaptureOptions) -> Result<Listing, CaptureError> {
    let mut listing = pairs(folder, options)?;
    if folder.join("groundtruth.txt").is_file() {
        let path = own(folder, folder.join("groundtruth.txt"), options)?;
        let track = trajectory::read_tum(&path, &mut listing.warnings)?;
        fill_poses(&mut listing.entries, &track, MAX_GAP_S);
        listing.poses = Some("groundtruth.txt".into());
    }
    Ok(listing)
}

/// ICL-NUIM's poses and camera belong to a left-handed world and camera: x right, y *up*, z forward,
/// hence the published `fy = -480`. Turning over the y axis of both, F = diag(1, -1, 1), gives our
/// convention: the camera has `fy = +480`, and `world_from_camera` becomes F T F, that is translation
/// `(x, -y, z)` and quaternion `(-qx, qy, -qz, qw)`. The world is then right-handed with y downwards.
pub(super) fn list_icl_nuim(
    folder: &Path,
    options: &CaptureOptions,
) -> Result<Listing, CaptureError> {
    let mut listing = pairs(folder, options)?;
    let names = super::file_names(folder)?;
    let tracks: Vec<_> = names.iter().filter(|n| n.ends_with(".gt.freiburg")).collect();
    let [track_name] = tracks.as_slice() else {
        let found = format!("{} files *.gt.freiburg; exactly one is needed", tracks.len());
        return Err(CaptureError::file(folder, found));
    };
    let path = own(folder, folder.join(track_name), options)?;
    let mut track = trajectory::read_tum(&path, &mut listing.warnings)?;
    track.map(mirrored_in_y);
    // Frames carry numbers, not seconds: the pose of a frame is that of its number or none.
    fill_poses(&mut listing.entries, &track, 0.0);
    let first = listing.entries.first().map_or(0.0, |e| e.timestamp_s);
    for entry in &mut listing.entries {
        entry.timestamp_s = (entry.timestamp_s - first) / ASSUMED_RATE_HZ;
        entry.difference_s /= ASSUMED_RATE_HZ;
    }
    listing.timed = false;
    listing.poses = Some(format!("{track_name}, y axis turned over"));
    Ok(listing)
}

fn mirrored_in_y(pose: &Pose) -> Pose {
    let (t, q) = (pose.translation.vector, pose.rotation.coords);
    let rotation = UnitQuaternion::new_normalize(Quaternion::new(q.w, -q.x, q.y, -q.z));
    Pose::from_parts(Translation3::new(t.x, -t.y, t.z), rotation)
}

fn fill_poses(entries: &mut [Entry], track: &Trajectory, max_gap: f64) {
    for entry in entries {
        entry.pose = track.at(entry.timestamp_s, max_gap);
    }
}

fn pairs(folder: &Path, options: &CaptureOptions) -> Result<Listing, CaptureError> {
    if folder.join("rgb.txt").is_file() {
        let depth_list = options.depth_list.as_deref().unwrap_or("depth.txt");
        return pair_by_time(
            read_list(folder, "rgb.txt", options)?,
            read_list(folder, depth_list, options)?,
            options,
        );
    }
    let name = match &options.depth_list {
        Some(name) => name,
        None => ASSOCIATION_FILES
            .into_iter()
            .find(|f| folder.join(f).is_file())
            .ok_or_else(|| CaptureError::file(folder, "neither rgb.txt nor associations.txt"))?,
    };
    associated(folder, name, options)
}

/// An association file: two stamps and two files a line, in either order of columns.
fn associated(
    folder: &Path,
    name: &str,
    options: &CaptureOptions,
) -> Result<Listing, CaptureError> {
    let path = files::inside(folder, name).map_err(CaptureError::Sequence)?;
    let path = own(folder, path, options)?;
    let mut listing = Listing { timed: true, ..Listing::default() };
    for (number, line) in text::lines(&text::read(&path)?) {
        let (color, depth) =
            association_line(folder, line).map_err(|p| CaptureError::line(&path, number, p))?;
        listing.entries.push(Entry {
            name: color.name,
            color: color.path,
            depth: depth.path,
            timestamp_s: color.time,
            difference_s: depth.time - color.time,
            pose: None,
        });
    }
    if listing.entries.is_empty() {
        return Err(CaptureError::file(&path, "the list is empty"));
    }
    let backwards =
        listing.entries.windows(2).filter(|w| w[1].timestamp_s <= w[0].timestamp_s).count();
    if backwards > 0 {
        listing.warnings.push(format!(
            "{}: {backwards} lines are not later than the one before: sorted by time, the first of equal times is kept",
            path.display()
        ));
        listing.entries.sort_by(|a, b| a.timestamp_s.total_cmp(&b.timestamp_s));
        listing.entries.dedup_by(|later, earlier| later.timestamp_s == earlier.timestamp_s);
    }
    listing.colors = listing.entries.len();
    listing.depths = listing.entries.len();
    Ok(listing)
}

/// Colour and depth of a line. ICL-NUIM's own files have depth first, the TUM tools write colour first:
/// the folder names tell.
fn association_line(folder: &Path, line: &str) -> Result<(Listed, Listed), String> {
    let words: Vec<_> = line.split_whitespace().collect();
    let &[stamp_a, file_a, stamp_b, file_b] = words.as_slice() else {
        return Err(format!("{} words; expected: timestamp file timestamp file", words.len()));
    };
    let (a, b) = (listed(folder, stamp_a, file_a)?, listed(folder, stamp_b, file_b)?);
    match (file_a.contains("depth"), file_b.contains("depth")) {
        (false, true) => Ok((a, b)),
        (true, false) => Ok((b, a)),
        _ => Err("cannot tell colour from depth: exactly one file must have \"depth\" in its path"
            .into()),
    }
}
