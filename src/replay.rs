//! A whole sequence through the pipeline, and what it amounts to.

use crate::budget::Governor;
use crate::capture::live::LiveSummary;
use crate::capture::{CaptureError, FrameSource, RawFrame, SkippedFrame};
use crate::eval::light::LightTruth;
use crate::eval::trajectory;
use crate::math::Distribution;
use crate::output::{OutputError, RunWriter};
use crate::pipeline::{Backend, BackendRecord, FrameOutcome, PipelineError};
use crate::stop::{Stop, Stopped};
use crate::timing::{Stage, StageTimes};
use poses::{FramePoses, RunPoses};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

mod poses;

#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    #[error(transparent)]
    Capture(#[from] CaptureError),
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    #[error(transparent)]
    Output(#[from] OutputError),
    /// Of a camera that is running.
    #[error("{0}")]
    Camera(CaptureError),
    #[error("no frame could be read; the first was skipped because {0}")]
    NoFrames(String),
    #[error("the camera gave no frame")]
    NoLiveFrames,
    #[error("{0} before the first frame")]
    Stopped(Stopped),
}

/// What a run amounts to. Lengths in metres, angles in degrees.
#[derive(Clone, Debug, serde::Serialize)]
pub struct ReplaySummary {
    pub frames: usize,
    /// The run was asked to stop before the recording's end.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub interrupted: bool,
    pub skipped: Vec<SkippedFrame>,
    /// What became of a camera's frames; not for recordings.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub live: Option<LiveSummary>,
    /// Frames in each tracking state.
    pub states: BTreeMap<String, usize>,
    /// Share of frames that were tracked well enough to be fused.
    pub tracked_share: f64,
    /// Against the poses of the recording, where it has them; ATE after rigid alignment.
    /// Of a camera that a recording plays: over at most 4096 frames, evenly over the run.
    pub absolute_error: Option<trajectory::AbsoluteError>,
    pub relative_error: Option<trajectory::RelativeError>,
    /// Against the recording's light.json, where it has one.
    pub light_error: Option<LightErrors>,
    pub volume_bytes: usize,
    pub backend: BackendRecord,
}

/// Distribution over the frames with a valid light.
#[derive(Clone, Debug, serde::Serialize)]
pub struct LightErrors {
    pub frames: usize,
    /// Angle between the estimated and the true dominant direction.
    pub median_deg: f64,
    pub p95_deg: f64,
    pub max_deg: f64,
    /// Relative L2 of the SH coefficients after the best common scale.
    pub median_relative_l2: f64,
}

/// Counts and errors, gathered while frames go by.
#[derive(Debug)]
struct Tally {
    frames: usize,
    fused: usize,
    states: BTreeMap<String, usize>,
    poses: RunPoses,
    angles_deg: Distribution,
    relative_l2: Distribution,
    volume_bytes: usize,
}

/// Runs every frame of `source`; `writer` gets each result, `on_frame` may look at it. A `governor`
/// changes the settings between frames to keep its budget. Once `stop` is asked, the frame in work is the last.
///
/// Where an error or `stop` ends the run early, the mesh, the summary and what else is written at the end are
/// written for the frames until then.
pub fn replay(
    source: &mut dyn FrameSource,
    pipeline: &mut dyn Backend,
    writer: &mut RunWriter,
    governor: Option<&mut Governor>,
    truth: Option<&LightTruth>,
    stop: &Stop,
    on_frame: &mut dyn FnMut(&FrameOutcome),
) -> Result<ReplaySummary, ReplayError> {
    let mut tally = Tally::new(source.len().is_none());
    let ended = every_frame(source, pipeline, writer, governor, stop, &mut |outcome| {
        tally.add(outcome, truth);
        on_frame(outcome);
    });
    if tally.frames == 0 {
        if ended? == Ended::Early {
            return Err(ReplayError::Stopped(Stopped));
        }
        if source.live().is_some() {
            return Err(ReplayError::NoLiveFrames);
        }
        let reason = source.skipped().first().map_or("it is empty", |s| &s.reason);
        return Err(ReplayError::NoFrames(reason.to_owned()));
    }
    let interrupted = matches!(ended, Ok(Ended::Early));
    let summary = tally.summary(source, pipeline.record(), interrupted);
    let finished = writer.finish(pipeline, &summary);
    // What ended the run comes before what may follow from it: a full disk takes no mesh either.
    ended?;
    finished?;
    pipeline.check()?;
    Ok(summary)
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ended {
    /// With the source.
    Whole,
    /// It was asked to stop.
    Early,
}

fn every_frame(
    source: &mut dyn FrameSource,
    pipeline: &mut dyn Backend,
    writer: &mut RunWriter,
    mut governor: Option<&mut Governor>,
    stop: &Stop,
    on_frame: &mut dyn FnMut(&FrameOutcome),
) -> Result<Ended, ReplayError> {
    while !stop.is_asked() {
        let Some((raw, times)) = next_frame(source)? else { return Ok(Ended::Whole) };
        let age = source.arrival().map(|arrival| arrival.age);
        let outcome = pipeline.process(raw, times)?;
        writer.frame(pipeline, &outcome, age)?;
        on_frame(&outcome);
        if let Some(governor) = &mut governor
            && let Some(setting) = governor.after_frame(pipeline, &outcome)?
        {
            writer.set_setting(setting);
        }
    }
    Ok(Ended::Early)
}

/// With the time of reading it, but not that of waiting for a camera.
fn next_frame(source: &mut dyn FrameSource) -> Result<Option<(RawFrame, StageTimes)>, ReplayError> {
    let start = Instant::now();
    let raw = match source.next_frame() {
        Ok(Some(raw)) => raw,
        Ok(None) => return Ok(None),
        Err(error) if source.live().is_some() => return Err(ReplayError::Camera(error)),
        Err(error) => return Err(error.into()),
    };
    let waited = source.arrival().map_or(Duration::ZERO, |arrival| arrival.waited);
    let mut times = StageTimes::default();
    times.add(Stage::Input, start.elapsed().saturating_sub(waited));
    Ok(Some((raw, times)))
}

impl Tally {
    /// `endless`: nobody knows for how long it will go on.
    fn new(endless: bool) -> Self {
        Self {
            frames: 0,
            fused: 0,
            states: BTreeMap::new(),
            poses: RunPoses::new(endless),
            angles_deg: Distribution::new(),
            relative_l2: Distribution::new(),
            volume_bytes: 0,
        }
    }

    fn add(&mut self, outcome: &FrameOutcome, truth: Option<&LightTruth>) {
        self.frames += 1;
        self.fused += usize::from(outcome.tracking.may_fuse());
        *self.states.entry(format!("{:?}", outcome.tracking.state)).or_default() += 1;
        self.volume_bytes = self.volume_bytes.max(outcome.volume_bytes);
        self.poses.push(FramePoses {
            timestamp_s: outcome.timestamp_s,
            estimated: outcome.composed.then_some(outcome.tracking.world_from_camera),
            recorded: outcome.recorded_pose,
        });
        if !outcome.light.valid() {
            return;
        }
        if let Some(error) = truth.and_then(|t| t.error_of(outcome.index, &outcome.light)) {
            if let Some(angle_deg) = error.angle_deg {
                self.angles_deg.push(angle_deg);
            }
            self.relative_l2.push(error.relative_l2);
        }
    }

    fn summary(
        self,
        source: &dyn FrameSource,
        backend: BackendRecord,
        interrupted: bool,
    ) -> ReplaySummary {
        let (absolute_error, relative_error) = self.poses.errors();
        let light_error = self.light_errors();
        ReplaySummary {
            frames: self.frames,
            interrupted,
            skipped: source.skipped().to_vec(),
            live: source.live(),
            tracked_share: self.fused as f64 / self.frames as f64,
            states: self.states,
            absolute_error,
            relative_error,
            light_error,
            volume_bytes: self.volume_bytes,
            backend,
        }
    }

    fn light_errors(&self) -> Option<LightErrors> {
        Some(LightErrors {
            frames: self.angles_deg.count(),
            median_deg: self.angles_deg.median()?,
            p95_deg: self.angles_deg.quantile(0.95)?,
            max_deg: self.angles_deg.largest()?,
            median_relative_l2: self.relative_l2.median()?,
        })
    }
}

impl std::fmt::Display for ReplaySummary {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let states: Vec<String> =
            self.states.iter().map(|(state, n)| format!("{state} {n}")).collect();
        writeln!(
            f,
            "{} frames{}, {:.1} % tracked ({}), {} skipped",
            self.frames,
            if self.interrupted { " until it was interrupted" } else { "" },
            100.0 * self.tracked_share,
            states.join(", "),
            self.skipped.len()
        )?;
        if let Some(live) = &self.live {
            writeln!(f, "camera: {}", live.counts)?;
        }
        if let Some(e) = &self.absolute_error {
            writeln!(
                f,
                "trajectory: ATE RMSE {:.2} cm over {} of {} recorded poses (rigid alignment){}",
                100.0 * e.translation_m.rmse,
                e.matched,
                e.reference,
                if e.degeneracy.is_some() { ", the path is too straight to say much" } else { "" }
            )?;
        }
        if let Some(e) = &self.light_error {
            writeln!(
                f,
                "light: dominant direction off by {:.1} degrees (median), {:.1} (95 %), over {} frames",
                e.median_deg, e.p95_deg, e.frames
            )?;
        }
        writeln!(f, "volume: {:.0} MiB", self.volume_bytes as f64 / (1 << 20) as f64)?;
        write!(f, "backend: {}", self.backend)
    }
}
