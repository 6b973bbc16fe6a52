//! A recording on disk as a source of frames.

use super::calibration::{self, Calibration, KINECT_V1, PoseOwner};
use super::layout::{self, Entry, Layout};
use super::openni::{OniOptions, OniSource};
use super::rig::Rig;
use super::{CaptureError, FrameSource, RawFrame, decode};
use crate::image::Size;
use crate::math::Pinhole;
use serde::Serialize;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// What may be said about a recording instead of being found out.
#[derive(Clone, Debug)]
pub struct CaptureOptions {
    pub layout: Option<Layout>,
    /// Another depth list than `depth.txt`; in folder layouts another folder than `depth`.
    pub depth_list: Option<String>,
    /// Depth units per metre.
    pub depth_factor: Option<f64>,
    pub calibration: Option<PathBuf>,
    /// Read files that links in the recording's folder lead out to.
    pub follow_links: bool,
    /// Colour and depth further apart are no pair.
    pub max_time_difference_s: f64,
    /// Pairs before this one are not delivered.
    pub first_frame: usize,
    /// The pair after the last delivered one.
    pub end_frame: Option<usize>,
}

impl Default for CaptureOptions {
    fn default() -> Self {
        Self {
            layout: None,
            depth_list: None,
            depth_factor: None,
            calibration: None,
            follow_links: false,
            max_time_difference_s: 0.02,
            first_frame: 0,
            end_frame: None,
        }
    }
}

/// What was found when a recording was opened.
#[derive(Clone, Debug, Serialize)]
pub struct SequenceInfo {
    pub folder: PathBuf,
    pub layout: Layout,
    pub color_pictures: usize,
    pub depth_pictures: usize,
    pub pairs: usize,
    /// Pictures without a partner.
    pub color_orphans: Vec<String>,
    pub depth_orphans: Vec<String>,
    /// Depth time less colour time; `None` where the recording has no time stamps.
    pub time_differences: Option<TimeDifferences>,
    /// Time from the first to the last pair.
    pub duration_s: f64,
    pub color_size: [usize; 2],
    pub depth_size: [usize; 2],
    /// Depth units per metre, and where the number is from.
    pub depth_factor: f64,
    pub depth_factor_from: String,
    /// The camera of delivered frames, and where it is from.
    pub camera: Pinhole,
    pub camera_from: String,
    /// Whether the recording is registered; where not, frames are registered as they are read.
    pub registered: bool,
    /// Whether frames are undistorted as they are read.
    pub undistorted: bool,
    /// Whether response, vignetting or primaries of the camera are undone as frames are read.
    pub light_corrected: bool,
    /// Where recorded poses are from.
    pub poses_from: Option<String>,
    pub frames_with_pose: usize,
    pub warnings: Vec<String>,
}

/// Distribution of depth time less colour time, milliseconds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TimeDifferences {
    pub min_ms: f64,
    pub p5_ms: f64,
    pub median_ms: f64,
    pub p95_ms: f64,
    pub max_ms: f64,
    /// Lower edge of each bin of 2 ms, and pairs in it.
    pub histogram: Vec<(f64, usize)>,
}

impl TimeDifferences {
    const BIN_MS: f64 = 2.0;

    fn of(entries: &[Entry]) -> Option<Self> {
        let mut ms: Vec<f64> = entries.iter().map(|e| e.difference_s * 1e3).collect();
        ms.sort_by(f64::total_cmp);
        let at =
            |share: f64| ms.get(((ms.len().max(1) - 1) as f64 * share).round() as usize).copied();
        let mut histogram: Vec<(f64, usize)> = Vec::new();
        for &value in &ms {
            let edge = (value / Self::BIN_MS).floor() * Self::BIN_MS;
            match histogram.last_mut() {
                Some((last, count)) if *last == edge => *count += 1,
                _ => histogram.push((edge, 1)),
            }
        }
        Some(Self {
            min_ms: at(0.0)?,
            p5_ms: at(0.05)?,
            median_ms: at(0.5)?,
            p95_ms: at(0.95)?,
            max_ms: at(1.0)?,
            histogram,
        })
    }
}

/// A frame that could not be delivered.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SkippedFrame {
    /// Position in the sequence.
    pub index: usize,
    pub name: String,
    pub reason: String,
}

/// An opened recording. Frames come rectified, registered and in metres; pictures are read when asked for.
#[derive(Debug)]
pub struct Sequence {
    entries: Vec<Entry>,
    first: usize,
    end: usize,
    next: usize,
    pictures: Pictures,
    info: SequenceInfo,
    skipped: Vec<SkippedFrame>,
    delivered: usize,
}

/// Where pictures are read from.
#[derive(Debug)]
enum Pictures {
    Files(Box<Rig>),
    Oni(Box<OniSource>),
}

/// Recognises and opens a recording. Errors concern the recording as a whole; single broken frames are
/// [skipped](FrameSource::skipped).
pub fn open_sequence(path: &Path, options: &CaptureOptions) -> Result<Sequence, CaptureError> {
    let layout = options.layout.map_or_else(|| Layout::detect(path), Ok)?;
    let tolerance = options.max_time_difference_s;
    if !(tolerance > 0.0 && tolerance.is_finite()) {
        return Err(CaptureError::Sequence(format!(
            "max_time_difference_s = {tolerance} must be positive"
        )));
    }
    if layout == Layout::Oni {
        return open_oni(path, options);
    }
    let listing = layout::list(layout, path, options)?;
    let mut warnings = listing.warnings;
    let entries = listing.entries;
    let end = end_of(entries.len(), options)?;
    let (color_size, depth_size) = picture_sizes(&entries[options.first_frame..end])?;
    let (mut calibration, camera_from) =
        find_calibration(path, layout, color_size, options, &mut warnings)?;
    if options.depth_factor.is_some() && calibration.disparity.take().is_some() {
        warnings.push(format!(
            "depth pictures are read as distances, as the depth factor says, not as disparities ({camera_from})"
        ));
    }
    let (depth_factor, depth_factor_from) = match (options.depth_factor, calibration.depth_factor) {
        _ if calibration.disparity.is_some() => (1.0, format!("disparities, {camera_from}")),
        (Some(given), _) => (given, "given".to_owned()),
        (None, Some(factor)) => (factor, camera_from.clone()),
        (None, None) => (layout.usual_depth_factor(), format!("usual for layout {layout}")),
    };
    if !calibration::usable_depth_factor(depth_factor) {
        return Err(CaptureError::Sequence(format!(
            "depth factor {depth_factor} must be positive"
        )));
    }
    if calibration.poses_of == PoseOwner::Depth && calibration.color_from_depth.is_none() {
        warnings.push("poses are the depth camera's, but its place is not known: taken for the colour camera's".into());
    }
    let rig = Rig::new(&calibration, color_size, depth_size, depth_factor, &mut warnings).map_err(
        |problem| CaptureError::file(path, format!("calibration ({camera_from}): {problem}")),
    )?;
    let first = entries[0].timestamp_s;
    let info = SequenceInfo {
        folder: path.to_owned(),
        layout,
        color_pictures: listing.colors,
        depth_pictures: listing.depths,
        pairs: entries.len(),
        color_orphans: listing.color_orphans,
        depth_orphans: listing.depth_orphans,
        time_differences: listing.timed.then(|| TimeDifferences::of(&entries)).flatten(),
        duration_s: entries[entries.len() - 1].timestamp_s - first,
        color_size: [color_size.width, color_size.height],
        depth_size: [depth_size.width, depth_size.height],
        depth_factor,
        depth_factor_from,
        camera: rig.camera,
        camera_from,
        registered: calibration.registered,
        undistorted: rig.undistorts(),
        light_corrected: rig.corrects_light(),
        poses_from: listing.poses,
        frames_with_pose: entries.iter().filter(|e| e.pose.is_some()).count(),
        warnings,
    };
    let first = options.first_frame;
    let pictures = Pictures::Files(Box::new(rig));
    Ok(Sequence::over(entries, first..end, pictures, info))
}

impl Sequence {
    /// The pairs of a range, none of them read yet.
    fn over(
        entries: Vec<Entry>,
        range: Range<usize>,
        pictures: Pictures,
        info: SequenceInfo,
    ) -> Self {
        Self {
            entries,
            first: range.start,
            end: range.end,
            next: range.start,
            pictures,
            info,
            skipped: Vec::new(),
            delivered: 0,
        }
    }
}

/// The pair after the last that is asked for.
fn end_of(pairs: usize, options: &CaptureOptions) -> Result<usize, CaptureError> {
    let (first, end) = (options.first_frame, options.end_frame.unwrap_or(pairs).min(pairs));
    if first >= end {
        return Err(CaptureError::Sequence(format!("frames {first}..{end} of {pairs} are none")));
    }
    Ok(end)
}

/// What a recording's file says of itself: its frames' times are known only when they are read, so pairs are
/// what there is at most, and the duration is nominal.
fn open_oni(path: &Path, options: &CaptureOptions) -> Result<Sequence, CaptureError> {
    let (calibration, depth_factor) = (options.calibration.clone(), options.depth_factor);
    if let Some(factor) = depth_factor.filter(|&f| !calibration::usable_depth_factor(f)) {
        return Err(CaptureError::Sequence(format!("depth factor {factor} must be positive")));
    }
    let source = OniSource::open(path, &OniOptions { calibration, depth_factor })?;
    let oni = source.info();
    let [depths, colors] = oni.counts;
    let pairs = depths.min(colors);
    let (first, end) = (options.first_frame, end_of(pairs, options)?);
    let entry = |i: usize| Entry {
        name: format!("pair {i}"),
        color: path.to_owned(),
        depth: path.to_owned(),
        timestamp_s: i as f64 / oni.rate_hz,
        difference_s: 0.0,
        pose: None,
    };
    let entries: Vec<_> = (0..pairs).map(entry).collect();
    let [depth_size, color_size] = oni.sizes.map(|s| [s.width, s.height]);
    let from = if depth_factor.is_some() { "given" } else { "as recorded" };
    let info = SequenceInfo {
        folder: path.to_owned(),
        layout: Layout::Oni,
        color_pictures: colors,
        depth_pictures: depths,
        pairs,
        color_orphans: Vec::new(),
        depth_orphans: Vec::new(),
        time_differences: None,
        duration_s: entries[pairs - 1].timestamp_s,
        color_size,
        depth_size,
        depth_factor: oni.depth_factor,
        depth_factor_from: from.into(),
        camera: oni.camera,
        camera_from: oni.camera_from.clone(),
        registered: oni.registered,
        undistorted: oni.undistorted,
        light_corrected: false,
        poses_from: None,
        frames_with_pose: 0,
        warnings: oni.notes.clone(),
    };
    let pictures = Pictures::Oni(Box::new(source));
    Ok(Sequence::over(entries, first..end, pictures, info))
}

/// Sizes of the first colour and the first depth picture whose headers can be read.
fn picture_sizes(entries: &[Entry]) -> Result<(Size, Size), CaptureError> {
    let mut first_error = None;
    let mut find = |size: &dyn Fn(&Entry) -> Result<Size, CaptureError>| {
        entries.iter().find_map(|entry| {
            size(entry).map_err(|e| first_error.get_or_insert(e).to_string()).ok()
        })
    };
    let color = find(&|e| decode::color_size(&e.color));
    let depth = find(&|e| decode::depth_size(&e.depth));
    match (color, depth, first_error) {
        (Some(color), Some(depth), _) => Ok((color, depth)),
        (_, _, Some(error)) => Err(error),
        _ => Err(CaptureError::Sequence("the sequence is empty".into())),
    }
}

/// What was given, else the recording's own, else a built-in one by name, else a nominal Kinect.
fn find_calibration(
    folder: &Path,
    layout: Layout,
    pictures: Size,
    options: &CaptureOptions,
    warnings: &mut Vec<String>,
) -> Result<(Calibration, String), CaptureError> {
    if let Some(path) = &options.calibration {
        return Ok((Calibration::read(path, Some(pictures))?, path.display().to_string()));
    }
    if let Some(own) = layout::own_calibration(layout, folder, pictures, options)? {
        return Ok(own);
    }
    // "." and "x/.." have names, too.
    let real = folder.canonicalize().map_err(|e| CaptureError::io(folder, e))?;
    if let Some(known) = calibration::built_in_for_folder(&real) {
        let from = format!("built-in {}", known.name);
        return Ok((known, from));
    }
    if layout == Layout::IclNuim {
        return Ok((
            Calibration::registered("icl_nuim", icl_nuim_camera()),
            "built-in icl_nuim".into(),
        ));
    }
    let kinect = calibration::built_in(KINECT_V1).filter(|k| k.color.scaled_to(pictures).is_some());
    let Some(kinect) = kinect else {
        let advice = "give a calibration file, or put calibration.toml into the folder";
        return Err(CaptureError::file(
            folder,
            format!("the camera of these {pictures} pictures is not known: {advice}"),
        ));
    };
    warnings.push("no calibration found: a nominal, registered Kinect v1 camera is assumed".into());
    Ok((kinect, format!("assumed {KINECT_V1}")))
}

/// As published, but for the sign of `fy`: see [`Layout::IclNuim`].
fn icl_nuim_camera() -> calibration::CameraModel {
    calibration::CameraModel {
        width: 640,
        height: 480,
        fx: 481.2,
        fy: 480.0,
        cx: 319.5,
        cy: 239.5,
        distortion: calibration::Distortion::None,
    }
}

impl Sequence {
    pub fn info(&self) -> &SequenceInfo {
        &self.info
    }

    /// Pairs in the recording; `index` of [`Self::frame`] counts them.
    pub fn pairs(&self) -> usize {
        self.entries.len()
    }

    /// Time of a frame; `None` where there is no such frame.
    pub fn timestamp_s(&self, index: usize) -> Option<f64> {
        self.entries.get(index).map(|e| e.timestamp_s)
    }

    /// Name of a frame's colour picture; empty where there is no such frame.
    pub fn name(&self, index: usize) -> &str {
        self.entries.get(index).map_or("", |e| &e.name)
    }

    /// Reads one frame, wherever the source is; does not move it.
    pub fn frame(&mut self, index: usize) -> Result<RawFrame, CaptureError> {
        let entry = self.entries.get(index).ok_or_else(|| CaptureError::Frame {
            frame: index,
            problem: format!("the sequence has {} frames", self.info.pairs),
        })?;
        let rig = match &mut self.pictures {
            Pictures::Files(rig) => rig,
            Pictures::Oni(source) => return source.frame(index),
        };
        let (color, depth_m) = rig
            .frame(
                || decode::color(&entry.color).map_err(Problem::from),
                || decode::depth(&entry.depth).map_err(Problem::from),
            )
            .map_err(|Problem(problem)| CaptureError::Frame { frame: index, problem })?;
        Ok(RawFrame {
            index,
            timestamp_s: entry.timestamp_s,
            color,
            depth_m,
            world_from_camera: entry.pose.map(|p| rig.world_from_camera(&p)),
            exposure_s: None,
        })
    }
}

/// What is wrong with one frame, in words.
struct Problem(String);

impl From<String> for Problem {
    fn from(problem: String) -> Self {
        Self(problem)
    }
}

impl From<CaptureError> for Problem {
    fn from(error: CaptureError) -> Self {
        Self(error.to_string())
    }
}

impl FrameSource for Sequence {
    fn camera(&self) -> Pinhole {
        self.info.camera
    }

    /// Frames that were asked for, counting those that may turn out to be broken.
    fn len(&self) -> Option<usize> {
        Some(self.end - self.first)
    }

    fn skipped(&self) -> &[SkippedFrame] {
        &self.skipped
    }

    /// The next frame that can be read. Broken ones are noted in [`Self::skipped`]; that all frames
    /// were broken is an error, once, at the end. So is a recording that is no longer there.
    fn next_frame(&mut self) -> Result<Option<RawFrame>, CaptureError> {
        while self.next < self.end {
            let index = self.next;
            self.next += 1;
            match self.frame(index) {
                Ok(frame) => {
                    self.delivered += 1;
                    return Ok(Some(frame));
                }
                Err(_) if !self.info.folder.exists() => {
                    self.next = self.end;
                    let gone = format!("is no longer there; frames from {index} on cannot be read");
                    return Err(CaptureError::file(&self.info.folder, gone));
                }
                Err(error) => {
                    log::warn!("skipped: {error}");
                    let reason = match error {
                        CaptureError::Frame { problem, .. } => problem,
                        other => other.to_string(),
                    };
                    let name = self.entries[index].name.clone();
                    self.skipped.push(SkippedFrame { index, name, reason });
                }
            }
        }
        if self.delivered == 0
            && let Some(first) = self.skipped.first()
        {
            self.delivered = usize::MAX; // said once
            let (count, reason) = (self.skipped.len(), &first.reason);
            return Err(CaptureError::Sequence(format!(
                "none of {count} frames can be read; the first: {reason}"
            )));
        }
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_differences_are_counted_by_2_ms() {
        let entry = |ms: f64| Entry {
            name: String::new(),
            color: PathBuf::new(),
            depth: PathBuf::new(),
            timestamp_s: 0.0,
            difference_s: ms / 1e3,
            pose: None,
        };
        let entries: Vec<_> = [-3.0, -2.5, 0.5, 1.0, 9.0].map(entry).into();
        let found = TimeDifferences::of(&entries).unwrap();
        assert_eq!(found.histogram, [(-4.0, 2), (0.0, 2), (8.0, 1)]);
        assert_eq!((found.min_ms, found.median_ms, found.max_ms), (-3.0, 0.5, 9.0));
        assert!(TimeDifferences::of(&[]).is_none());
    }
}
