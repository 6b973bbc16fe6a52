//! How the files of a recording are named and listed; recognised, not asked for.

mod folders;
mod seven_scenes;
mod tum;

use super::association::associate;
use super::sequence::CaptureOptions;
use super::{Calibration, CaptureError, text};
use crate::files;
use crate::image::Size;
use crate::math::Pose;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Frame rate of recordings without time stamps.
pub const ASSUMED_RATE_HZ: f64 = 30.0;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Layout {
    /// TUM RGB-D benchmark: `rgb.txt`, `depth.txt`, `groundtruth.txt`.
    Tum,
    /// ICL-NUIM's TUM-compatible pack: `associations.txt`, `*.gt.freiburg`, mirrored y axis.
    IclNuim,
    /// `frame-NNNNNN.color.png`, `.depth.png`, `.pose.txt`.
    #[serde(rename = "7-scenes")]
    SevenScenes,
    /// Redwood and Open3D: `color/`, `depth/`, intrinsics as JSON, `trajectory.log`.
    Redwood,
    /// A folder of colour and a folder of depth pictures.
    Folders,
    /// One file, played by OpenNI2.
    Oni,
}

impl Layout {
    pub fn name(self) -> &'static str {
        match self {
            Self::Tum => "tum",
            Self::IclNuim => "icl-nuim",
            Self::SevenScenes => "7-scenes",
            Self::Redwood => "redwood",
            Self::Folders => "folders",
            Self::Oni => "oni",
        }
    }

    /// Depth units per metre where no calibration says otherwise.
    pub fn usual_depth_factor(self) -> f64 {
        match self {
            Self::Tum | Self::IclNuim => 5000.0,
            Self::SevenScenes | Self::Redwood | Self::Folders | Self::Oni => 1000.0,
        }
    }

    /// Recognises the layout of a folder by its files, that of a file by its name.
    pub fn detect(folder: &Path) -> Result<Self, CaptureError> {
        if folder.extension().is_some_and(|e| e.eq_ignore_ascii_case("oni")) && !folder.is_dir() {
            return Ok(Self::Oni);
        }
        let names = file_names(folder)?;
        let has = |name: &str| names.iter().any(|n| n == name);
        let lists = has("rgb.txt") || tum::ASSOCIATION_FILES.iter().any(|f| has(f));
        if lists && names.iter().any(|n| n.ends_with(".gt.freiburg")) {
            return Ok(Self::IclNuim);
        }
        if lists {
            return Ok(Self::Tum);
        }
        if names.iter().any(|n| seven_scenes::is_color(n)) {
            return Ok(Self::SevenScenes);
        }
        if folders::color_folder(folder).is_some() && folder.join("depth").is_dir() {
            let redwood = has("trajectory.log") || folders::intrinsics_file(&names).is_some();
            return Ok(if redwood { Self::Redwood } else { Self::Folders });
        }
        Err(CaptureError::file(
            folder,
            "no recording recognised: looked for rgb.txt and depth.txt, associations.txt, frame-NNNNNN.color.png, \
             and the folders color (or rgb) and depth",
        ))
    }
}

impl std::fmt::Display for Layout {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

impl std::str::FromStr for Layout {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        [Self::Tum, Self::IclNuim, Self::SevenScenes, Self::Redwood, Self::Folders, Self::Oni]
            .into_iter()
            .find(|layout| layout.name() == name)
            .ok_or_else(|| {
                format!("no layout \"{name}\": tum, icl-nuim, 7-scenes, redwood, folders, oni")
            })
    }
}

/// The files of one frame.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    pub name: String,
    pub color: PathBuf,
    pub depth: PathBuf,
    /// Of the colour picture.
    pub timestamp_s: f64,
    /// Depth time less colour time.
    pub difference_s: f64,
    pub pose: Option<Pose>,
}

/// All that a layout says about a recording, before a picture is opened.
#[derive(Clone, Debug, Default)]
pub(super) struct Listing {
    pub entries: Vec<Entry>,
    pub colors: usize,
    pub depths: usize,
    pub color_orphans: Vec<String>,
    pub depth_orphans: Vec<String>,
    /// Whether time stamps were recorded, not made from frame numbers.
    pub timed: bool,
    /// Where poses are from.
    pub poses: Option<String>,
    pub warnings: Vec<String>,
}

pub(super) fn list(
    layout: Layout,
    folder: &Path,
    options: &CaptureOptions,
) -> Result<Listing, CaptureError> {
    let mut listing = match layout {
        Layout::Tum => tum::list(folder, options),
        Layout::IclNuim => tum::list_icl_nuim(folder, options),
        Layout::SevenScenes => seven_scenes::list(folder, options),
        Layout::Redwood | Layout::Folders => folders::list(folder, options),
        // Its frames have no files of their own; `open_sequence` never lists it.
        Layout::Oni => Ok(Listing::default()),
    }?;
    if listing.entries.is_empty() {
        let (colors, depths) = (listing.colors, listing.depths);
        let found = format!("{colors} colour and {depths} depth pictures make no pair");
        return Err(CaptureError::file(folder, found));
    }
    pictures_stay_inside(folder, &listing.entries, options)?;
    if listing.poses.is_some() {
        let without = listing.entries.iter().filter(|e| e.pose.is_none()).count();
        if without > 0 {
            listing.warnings.push(format!(
                "{without} of {} frames have no recorded pose",
                listing.entries.len()
            ));
        }
    }
    Ok(listing)
}

/// The calibration that a recording's own files hold, and the file's name.
pub(super) fn own_calibration(
    layout: Layout,
    folder: &Path,
    pictures: Size,
    options: &CaptureOptions,
) -> Result<Option<(Calibration, String)>, CaptureError> {
    let names = file_names(folder)?;
    let has = |name: &str| names.iter().any(|n| n == name).then(|| name.to_owned());
    let yaml = ["camera_info.yaml", "calibration.yaml", "calibration.yml"];
    let general = has("calibration.toml").or_else(|| yaml.iter().find_map(|n| has(n)));
    let file = match layout {
        Layout::SevenScenes | Layout::Oni => general,
        Layout::Tum | Layout::IclNuim => general.or_else(|| has("intrinsics.txt")),
        Layout::Redwood | Layout::Folders => general
            .or_else(|| folders::intrinsics_file(&names))
            .or_else(|| has("intrinsics.txt"))
            .or_else(|| has("camera-intrinsics.txt")),
    };
    let Some(name) = file else {
        return match layout {
            Layout::SevenScenes => seven_scenes::calibration(folder, pictures, options),
            _ => Ok(None),
        };
    };
    let file = own(folder, folder.join(&name), options)?;
    let mut calibration = Calibration::read(&file, Some(pictures))?;
    if layout == Layout::IclNuim {
        // The picture's rows run downwards; with the y axis turned over that is a positive focal length.
        calibration.color.fy = calibration.color.fy.abs();
    }
    Ok(Some((calibration, name)))
}

/// A file of the recording. Refuses one that is elsewhere, behind a link.
fn own(folder: &Path, path: PathBuf, options: &CaptureOptions) -> Result<PathBuf, CaptureError> {
    match !options.follow_links && files::leads_out(folder, &path) {
        true => Err(linked_out(&path)),
        false => Ok(path),
    }
}

fn pictures_stay_inside(
    folder: &Path,
    entries: &[Entry],
    options: &CaptureOptions,
) -> Result<(), CaptureError> {
    if options.follow_links {
        return Ok(());
    }
    // Of thousands of pictures in a few folders, only those that are links themselves are looked up.
    let mut folders: HashMap<&Path, bool> = HashMap::new();
    for path in entries.iter().flat_map(|e| [&e.color, &e.depth]) {
        let parent = path.parent().unwrap_or(folder);
        let out = *folders.entry(parent).or_insert_with(|| files::leads_out(folder, parent));
        if out || path.is_symlink() && files::leads_out(folder, path) {
            return Err(linked_out(path));
        }
    }
    Ok(())
}

fn linked_out(path: &Path) -> CaptureError {
    CaptureError::file(path, "a link leads out of the recording; --follow-links reads it even so")
}

/// Names of a folder's plain files and folders, sorted.
fn file_names(folder: &Path) -> Result<Vec<String>, CaptureError> {
    let io = |e| CaptureError::io(folder, e);
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        // A name that is not UTF-8 is none of ours.
        if let Ok(name) = entry.map_err(io)?.file_name().into_string() {
            names.push(name);
        }
    }
    names.sort();
    Ok(names)
}

/// One picture of a list.
#[derive(Clone, Debug)]
struct Listed {
    time: f64,
    name: String,
    path: PathBuf,
}

/// Sorts by time. Of equal times the first in the list is kept; both are named.
fn in_order(mut list: Vec<Listed>, which: &str, warnings: &mut Vec<String>) -> Vec<Listed> {
    let backwards = list.windows(2).find(|w| w[1].time < w[0].time).map(|w| w[1].name.clone());
    if let Some(name) = backwards {
        warnings
            .push(format!("{which} time stamps run backwards, first at {name}: sorted by time"));
        list.sort_by(|a, b| a.time.total_cmp(&b.time));
    }
    let before = list.len();
    let mut first_double = None;
    list.dedup_by(|later, earlier| {
        let double = later.time == earlier.time;
        if double && first_double.is_none() {
            first_double = Some(later.name.clone());
        }
        double
    });
    if let Some(name) = first_double {
        let count = before - list.len();
        warnings.push(format!(
            "{count} {which} pictures repeat the time stamp of another, first {name}: left out"
        ));
    }
    list
}

/// Pairs two lists by time; poses are filled in later.
fn pair_by_time(
    colors: Vec<Listed>,
    depths: Vec<Listed>,
    options: &CaptureOptions,
) -> Result<Listing, CaptureError> {
    let mut warnings = Vec::new();
    let (color_count, depth_count) = (colors.len(), depths.len());
    let colors = in_order(colors, "colour", &mut warnings);
    let depths = in_order(depths, "depth", &mut warnings);
    let times = |list: &[Listed]| list.iter().map(|l| l.time).collect::<Vec<_>>();
    let pairs = associate(&times(&colors), &times(&depths), options.max_time_difference_s);
    let pairs = pairs.ok_or_else(|| {
        let tolerance = options.max_time_difference_s;
        CaptureError::Sequence(format!(
            "max_time_difference_s = {tolerance} pairs everything with everything; choose less"
        ))
    })?;
    let mut listing = Listing {
        colors: color_count,
        depths: depth_count,
        timed: true,
        warnings,
        color_orphans: orphans(&colors, pairs.iter().map(|p| p.0)),
        depth_orphans: orphans(&depths, pairs.iter().map(|p| p.1)),
        ..Listing::default()
    };
    listing.entries = pairs
        .into_iter()
        .map(|(i, j)| Entry {
            name: colors[i].name.clone(),
            color: colors[i].path.clone(),
            depth: depths[j].path.clone(),
            timestamp_s: colors[i].time,
            difference_s: depths[j].time - colors[i].time,
            pose: None,
        })
        .collect();
    Ok(listing)
}

fn orphans(list: &[Listed], paired: impl Iterator<Item = usize>) -> Vec<String> {
    let mut alone = vec![true; list.len()];
    paired.for_each(|i| alone[i] = false);
    list.iter().zip(alone).filter(|(_, alone)| *alone).map(|(l, _)| l.name.clone()).collect()
}

/// A list of `timestamp file` lines.
fn read_list(
    folder: &Path,
    name: &str,
    options: &CaptureOptions,
) -> Result<Vec<Listed>, CaptureError> {
    let path = files::inside(folder, name).map_err(CaptureError::Sequence)?;
    let path = own(folder, path, options)?;
    let mut list = Vec::new();
    for (number, line) in text::lines(&text::read(&path)?) {
        let problem = |p: String| CaptureError::line(&path, number, p);
        let (stamp, file) = line
            .split_once(|c: char| c.is_whitespace() || c == ',')
            .ok_or_else(|| problem(format!("\"{line}\" is not \"timestamp file\"")))?;
        list.push(listed(folder, stamp, file.trim()).map_err(problem)?);
    }
    if list.is_empty() {
        return Err(CaptureError::file(&path, "the list is empty"));
    }
    Ok(list)
}

fn listed(folder: &Path, stamp: &str, file: &str) -> Result<Listed, String> {
    let time: f64 = stamp.parse().map_err(|_| format!("\"{stamp}\" is not a time stamp"))?;
    // Nanoseconds since 1970 are 2e18; differences of what is allowed stay finite.
    if time.is_nan() || time.abs() > 1e20 {
        return Err(format!("time stamp {time:e}"));
    }
    Ok(Listed { time, name: file.to_owned(), path: files::inside(folder, file)? })
}
