//! What `kinlight info` says about a recording.

use super::plausibility::{Extent, PoseCheck, check_poses, extent};
use super::sequence::{CaptureOptions, SequenceInfo, SkippedFrame, open_sequence};
use super::{CaptureError, RawFrame};
use serde::Serialize;
use std::fmt::{Display, Formatter, Result as Written};
use std::path::Path;

/// Frames looked at, counted from the first: enough motion to tell readings of the poses apart,
/// enough overlap to compare.
const GAPS: [usize; 7] = [0, 1, 5, 10, 20, 30, 60];

#[derive(Clone, Debug, Serialize)]
pub struct SequenceReport {
    pub info: SequenceInfo,
    /// Of the frames looked at, those that could not be read.
    pub skipped: Vec<SkippedFrame>,
    pub frames_looked_at: Vec<usize>,
    pub extent: Option<Extent>,
    pub poses: Option<PoseCheck>,
    /// Likely mistakes, in words.
    pub findings: Vec<String>,
}

/// Opens a recording, reads a few of its frames and judges what it found.
pub fn inspect(path: &Path, options: &CaptureOptions) -> Result<SequenceReport, CaptureError> {
    let mut sequence = open_sequence(path, options)?;
    let info = sequence.info().clone();
    let end = options.end_frame.unwrap_or(info.pairs).min(info.pairs);
    let mut skipped = Vec::new();
    let mut frames: Vec<RawFrame> = Vec::new();
    for index in GAPS.map(|gap| options.first_frame + gap).into_iter().filter(|&i| i < end) {
        match sequence.frame(index) {
            Ok(frame) => frames.push(frame),
            Err(error) => skipped.push(SkippedFrame {
                index,
                name: sequence.name(index).to_owned(),
                reason: error.to_string(),
            }),
        }
    }
    let extent = extent(&info.camera, &frames);
    let poses = check_poses(&info.camera, &frames, info.depth_factor);
    let mut findings = info.warnings.clone();
    match &extent {
        Some(extent) => findings.extend(extent.factor_mistake(info.depth_factor)),
        None => findings.push("no frame has any depth".into()),
    }
    if let Some(better) = poses.as_ref().and_then(|p| p.better.as_ref()) {
        findings.push(format!("poses and depth agree clearly better if read so: {better}"));
    }
    let frames_looked_at = frames.iter().map(|f| f.index).collect();
    Ok(SequenceReport { info, skipped, frames_looked_at, extent, poses, findings })
}

impl Display for SequenceReport {
    fn fmt(&self, f: &mut Formatter<'_>) -> Written {
        write!(f, "{}", self.info)?;
        if let Some(e) = &self.extent {
            writeln!(
                f,
                "extent        {:.2} .. {:.2} .. {:.2} m (5, 50, 95 %), {:.0} % valid, {:.0} % in a cube of 2 m",
                e.depth_p5_m,
                e.depth_median_m,
                e.depth_p95_m,
                100.0 * e.valid_share,
                100.0 * e.in_2m_cube_share
            )?;
        }
        if let Some(p) = &self.poses {
            for (a, b, r) in &p.pairs {
                let (mm, overlap) = (1e3 * r.median_m, 100.0 * r.overlap);
                writeln!(
                    f,
                    "reprojection  frame {a} in {b}: {mm:.1} mm median, {overlap:.0} % overlap"
                )?;
            }
            let best = p.alternatives.iter().min_by(|a, b| a.1.total_cmp(&b.1));
            if let Some((name, relative)) = best {
                let (used, other) = (100.0 * p.as_recorded, 100.0 * relative);
                writeln!(
                    f,
                    "poses         {used:.2} % of depth as recorded; next best {other:.2} %: {name}"
                )?;
            }
        }
        for skip in &self.skipped {
            writeln!(f, "skipped       frame {} ({}): {}", skip.index, skip.name, skip.reason)?;
        }
        for finding in &self.findings {
            writeln!(f, "note          {finding}")?;
        }
        Ok(())
    }
}

impl Display for SequenceInfo {
    fn fmt(&self, f: &mut Formatter<'_>) -> Written {
        let orphans =
            |names: &[String]| names.first().map_or(String::new(), |n| format!(" (first: {n})"));
        let of_size = |s: [usize; 2]| format!("{}x{}", s[0], s[1]);
        writeln!(f, "sequence      {}", self.folder.display())?;
        writeln!(f, "layout        {}", self.layout)?;
        let (color, depth) = (of_size(self.color_size), of_size(self.depth_size));
        writeln!(
            f,
            "pictures      {} colour {color}, {} depth {depth}",
            self.color_pictures, self.depth_pictures
        )?;
        let (alone_c, alone_d) = (orphans(&self.color_orphans), orphans(&self.depth_orphans));
        let (count_c, count_d) = (self.color_orphans.len(), self.depth_orphans.len());
        writeln!(
            f,
            "pairs         {} in {:.2} s; alone: {count_c} colour{alone_c}, {count_d} depth{alone_d}",
            self.pairs, self.duration_s
        )?;
        match &self.time_differences {
            Some(t) => {
                let values = [t.min_ms, t.p5_ms, t.median_ms, t.p95_ms, t.max_ms];
                let [a, b, c, d, e] = values.map(|v| format!("{v:.1}"));
                writeln!(
                    f,
                    "depth - colour {a} .. {b} .. {c} .. {d} .. {e} ms (min, 5, 50, 95 %, max)"
                )?;
                for (edge, count) in &t.histogram {
                    writeln!(f, "              {edge:>6} ms {count:>6}")?;
                }
            }
            None => writeln!(f, "times         none recorded, 30 frames a second assumed")?,
        }
        writeln!(f, "depth factor  {} per metre ({})", self.depth_factor, self.depth_factor_from)?;
        let c = &self.camera;
        writeln!(
            f,
            "camera        {}x{} fx {} fy {} cx {} cy {} ({})",
            c.width, c.height, c.fx, c.fy, c.cx, c.cy, self.camera_from
        )?;
        let registered =
            if self.registered { "yes" } else { "no: frames are registered as they are read" };
        writeln!(f, "registered    {registered}")?;
        writeln!(
            f,
            "lens          {}",
            if self.undistorted { "undistorted as frames are read" } else { "no distortion" }
        )?;
        match &self.poses_from {
            Some(from) => writeln!(
                f,
                "poses         {} of {} frames, from {from}",
                self.frames_with_pose, self.pairs
            ),
            None => writeln!(f, "poses         none recorded"),
        }
    }
}
