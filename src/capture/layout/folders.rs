//! A folder of colour and a folder of depth pictures, as Redwood, Open3D and many scripts leave them.

use super::{ASSUMED_RATE_HZ, Entry, Listed, Listing, file_names, own, pair_by_time};
use crate::capture::sequence::CaptureOptions;
use crate::capture::{CaptureError, trajectory};
use crate::files;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The colour folder, by its usual names.
pub(super) fn color_folder(folder: &Path) -> Option<PathBuf> {
    ["color", "rgb", "image"].iter().map(|n| folder.join(n)).find(|p| p.is_dir())
}

pub(super) fn intrinsics_file(names: &[String]) -> Option<String> {
    let is = |n: &&String| {
        n.ends_with(".json") && (n.contains("intrinsic") || n.as_str() == "camera_primesense.json")
    };
    names.iter().find(is).cloned()
}

pub(super) fn list(folder: &Path, options: &CaptureOptions) -> Result<Listing, CaptureError> {
    let color = color_folder(folder)
        .ok_or_else(|| CaptureError::file(folder, "no folder color, rgb or image"))?;
    let depth_name = options.depth_list.as_deref().unwrap_or("depth");
    let depth = files::inside(folder, depth_name).map_err(CaptureError::Sequence)?;
    let (colors, depths) = (pictures(&color)?, pictures(&depth)?);
    let mut listing = match (stamped(&colors), stamped(&depths)) {
        (Some(colors), Some(depths)) => pair_by_time(colors, depths, options)?,
        _ => pair_by_number(&colors, &depths)?,
    };
    let log = folder.join("trajectory.log");
    if log.is_file() {
        let poses = trajectory::read_log(&own(folder, log, options)?, &mut listing.warnings)?;
        // A log counts colour pictures, whatever numbers they carry.
        let position: BTreeMap<_, _> =
            colors.iter().enumerate().map(|(i, (_, p))| (p, i)).collect();
        for entry in &mut listing.entries {
            let index = position.get(&entry.color);
            entry.pose = index.and_then(|&i| poses.get(i).copied().flatten());
        }
        listing.poses = Some("trajectory.log".into());
    }
    Ok(listing)
}

/// Names and paths of a folder's pictures, in order of their numbers.
fn pictures(folder: &Path) -> Result<Vec<(String, PathBuf)>, CaptureError> {
    let is_picture = |name: &String| {
        let lower = name.to_lowercase();
        [".png", ".jpg", ".jpeg"].iter().any(|end| lower.ends_with(end))
    };
    let mut names: Vec<_> = file_names(folder)?.into_iter().filter(is_picture).collect();
    names.sort_by_cached_key(|name| (number(name), name.clone()));
    Ok(names.into_iter().map(|name| (name.clone(), folder.join(name))).collect())
}

fn stem(name: &str) -> &str {
    name.rsplit_once('.').map_or(name, |(stem, _)| stem)
}

/// The frame number in a name: of "NNN-TTT" (Redwood's number and time) the first, else the last.
fn number(name: &str) -> Option<u64> {
    let stem = stem(name);
    let mut runs = stem.split(|c: char| !c.is_ascii_digit()).filter(|run| !run.is_empty());
    let redwood = stem.bytes().all(|b| b.is_ascii_digit() || b == b'-');
    let run = if redwood { runs.next() } else { runs.next_back() };
    run?.parse().ok()
}

/// Files named by their time stamp, as the TUM tools name them: `1305031102.175304.png`.
fn stamped(pictures: &[(String, PathBuf)]) -> Option<Vec<Listed>> {
    let time = |(name, path): &(String, PathBuf)| {
        let (seconds, fraction) = stem(name).split_once('.')?;
        let digits = |s: &str| !s.is_empty() && s.bytes().all(|b| b.is_ascii_digit());
        let time = (digits(seconds) && digits(fraction)).then(|| stem(name).parse().ok())??;
        Some(Listed { time, name: name.clone(), path: path.clone() })
    };
    (!pictures.is_empty()).then(|| pictures.iter().map(time).collect())?
}

fn pair_by_number(
    colors: &[(String, PathBuf)],
    depths: &[(String, PathBuf)],
) -> Result<Listing, CaptureError> {
    let mut listing = Listing { colors: colors.len(), depths: depths.len(), ..Listing::default() };
    let mut waiting = numbered(depths)?;
    let colors = numbered(colors)?;
    let first = colors.keys().next().copied().unwrap_or(0);
    for (number, (name, color)) in colors {
        let Some((_, depth)) = waiting.remove(&number) else {
            listing.color_orphans.push(name.clone());
            continue;
        };
        listing.entries.push(Entry {
            name: name.clone(),
            color: color.clone(),
            depth: depth.clone(),
            timestamp_s: (number - first) as f64 / ASSUMED_RATE_HZ,
            difference_s: 0.0,
            pose: None,
        });
    }
    listing.depth_orphans = waiting.into_values().map(|(name, _)| name.clone()).collect();
    Ok(listing)
}

fn numbered(
    pictures: &[(String, PathBuf)],
) -> Result<BTreeMap<u64, &(String, PathBuf)>, CaptureError> {
    let mut out = BTreeMap::new();
    for picture in pictures {
        let number = number(&picture.0)
            .ok_or_else(|| CaptureError::file(&picture.1, "the name has no frame number"))?;
        if let Some((other, _)) = out.insert(number, picture) {
            let problem = format!("has the same frame number as {other}");
            return Err(CaptureError::file(&picture.1, problem));
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frame_numbers_of_usual_names() {
        assert_eq!(number("00042.jpg"), Some(42));
        assert_eq!(number("000007-000000233567.png"), Some(7));
        assert_eq!(number("cam2_frame000123.png"), Some(123));
        assert_eq!(number("color.png"), None);
        assert_eq!(number("99999999999999999999999.png"), None);
    }
}
