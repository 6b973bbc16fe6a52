//! Everything that a run leaves behind, frame by frame.

use super::{
    FrameTiming, LightLog, LightRecord, OutputError, Panorama, TimingRecorder, TimingSummary,
    TimingsLog, TrajectoryWriter, Video, VideoStart, atomic_write, write_color_png,
    write_environment, write_ply, write_timings_json,
};
use crate::image::Image;
use crate::lighting::LightChannels;
use crate::pipeline::{Backend, BackendRecord, FrameOutcome, PipelineError};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Rows of `environment.hdr`; it is twice as wide.
const ENVIRONMENT_HEIGHT: usize = 256;

/// Frame rate of `augmented.mp4`.
const VIDEO_FRAMES_PER_S: f64 = 30.0;

/// Which files are written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutputPlan {
    pub frames: bool,
    pub light: bool,
    pub environment: bool,
    pub trajectory: bool,
    pub mesh: bool,
    pub timings: bool,
    pub video: bool,
}

impl OutputPlan {
    pub const NOTHING: Self = Self {
        frames: false,
        light: false,
        environment: false,
        trajectory: false,
        mesh: false,
        timings: false,
        video: false,
    };

    pub const ALL_BUT_VIDEO: Self = Self {
        frames: true,
        light: true,
        environment: true,
        trajectory: true,
        mesh: true,
        timings: true,
        video: false,
    };
}

/// Makes a picture of one buffer; `None` where there is none in this frame.
pub type BufferPicture =
    Box<dyn Fn(&dyn Backend) -> Result<Option<Image<[u8; 3]>>, PipelineError> + Send>;

/// Writes a run into one folder. Logs are valid after every frame; whole files appear at once.
pub struct RunWriter {
    folder: PathBuf,
    plan: OutputPlan,
    light: Option<LightLog>,
    trajectory: Option<TrajectoryWriter>,
    timings_log: Option<TimingsLog>,
    video: Option<Video>,
    buffers: Vec<(String, BufferPicture)>,
    timings: TimingRecorder,
    setting: String,
    backend: BackendRecord,
}

impl RunWriter {
    /// Makes the folder and the logs, and writes `settings.toml`, the settings called `setting`
    /// that the run starts with. `buffers` are written for every
    /// frame into a folder of their name.
    pub fn create(
        folder: &Path,
        plan: OutputPlan,
        pipeline: &dyn Backend,
        buffers: Vec<(String, BufferPicture)>,
        warm_up: usize,
        setting: &str,
    ) -> Result<Self, OutputError> {
        make_folder(folder)?;
        for name in
            buffers.iter().map(|(name, _)| name.as_str()).chain(plan.frames.then_some("frames"))
        {
            make_folder(&folder.join(name))?;
        }
        let settings = pipeline.settings().to_toml();
        atomic_write(&folder.join("settings.toml"), |out| out.write_all(settings.as_bytes()))?;
        let video = match plan.video {
            true => start_video(&folder.join("augmented.mp4"), pipeline)?,
            false => None,
        };
        let path = |name: &str| folder.join(name);
        Ok(Self {
            light: plan.light.then(|| LightLog::create(&path("light.jsonl"))).transpose()?,
            trajectory: plan
                .trajectory
                .then(|| TrajectoryWriter::create(&path("trajectory.txt")))
                .transpose()?,
            timings_log: plan
                .timings
                .then(|| TimingsLog::create(&path("timings.csv")))
                .transpose()?,
            folder: folder.to_owned(),
            plan,
            video,
            buffers,
            timings: TimingRecorder::new(warm_up),
            setting: setting.to_owned(),
            backend: pipeline.record(),
        })
    }

    /// Names the settings of the frames to come.
    pub fn set_setting(&mut self, name: &str) {
        self.setting.clear();
        self.setting.push_str(name);
    }

    /// `age`: how long a camera's frame had waited when its processing began.
    pub fn frame(
        &mut self,
        pipeline: &dyn Backend,
        outcome: &FrameOutcome,
        age: Option<Duration>,
    ) -> Result<(), OutputError> {
        self.check_folder()?;
        let name = format!("{:06}.png", outcome.index);
        if self.plan.frames {
            write_color_png(&self.folder.join("frames").join(&name), pipeline.composed())?;
        }
        for (buffer, picture) in &self.buffers {
            match picture(pipeline) {
                Ok(Some(picture)) => {
                    write_color_png(&self.folder.join(buffer).join(&name), &picture)?;
                }
                Ok(None) => {}
                Err(problem) => log::error!("no {buffer}/{name}: {problem}"),
            }
        }
        if let Some(video) = &mut self.video {
            video.push(pipeline.composed())?;
        }
        if let Some(log) = &mut self.light {
            log.push(&light_record(outcome, pipeline.settings().light.channels))?;
        }
        if let (Some(trajectory), true) = (&mut self.trajectory, outcome.composed) {
            trajectory.push(outcome.timestamp_s, &outcome.tracking.world_from_camera)?;
        }
        let timing = frame_timing(outcome, age, &self.setting);
        if let Some(log) = &mut self.timings_log {
            log.push(&timing)?;
        }
        self.timings.push(&timing);
        Ok(())
    }

    /// Writes what is known only at the end.
    pub fn finish(
        &mut self,
        pipeline: &dyn Backend,
        summary: &impl serde::Serialize,
    ) -> Result<(), OutputError> {
        self.backend = pipeline.record();
        self.check_folder()?;
        if let Some(video) = self.video.take() {
            video.finish()?;
        }
        if self.plan.mesh {
            match pipeline.mesh() {
                Ok(mesh) => write_ply(&self.folder.join("mesh.ply"), &mesh)?,
                Err(problem) => log::error!("no mesh.ply: {problem}"),
            }
        }
        if let (true, Some(light)) = (self.plan.environment, pipeline.light()) {
            let path = self.folder.join("environment.hdr");
            write_environment(&path, &light.light, Panorama::z_up(), ENVIRONMENT_HEIGHT)?;
        }
        if let (true, Some(timings)) = (self.plan.timings, self.timing_summary()) {
            write_timings_json(&self.folder.join("timings.json"), &timings)?;
        }
        let json = serde_json::to_vec_pretty(summary).expect("a summary is plain data");
        atomic_write(&self.folder.join("summary.json"), |out| out.write_all(&json))
    }

    /// A folder that was removed is not made again for the rest of its files.
    fn check_folder(&self) -> Result<(), OutputError> {
        match self.folder.is_dir() {
            true => Ok(()),
            false => Err(OutputError::content(&self.folder, "was removed during the run")),
        }
    }

    /// Stage times after warm-up; `None` before any frame.
    pub fn timing_summary(&self) -> Option<TimingSummary> {
        let mut summary = self.timings.summary()?;
        summary.backend = Some(self.backend.clone());
        Some(summary)
    }
}

fn make_folder(path: &Path) -> Result<(), OutputError> {
    std::fs::create_dir_all(path).map_err(|e| OutputError::io(path, e))
}

fn start_video(path: &Path, pipeline: &dyn Backend) -> Result<Option<Video>, OutputError> {
    match Video::start(path, pipeline.composed().size(), VIDEO_FRAMES_PER_S)? {
        VideoStart::Started(video) => Ok(Some(video)),
        VideoStart::Unavailable(reason) => {
            log::warn!("no augmented.mp4: {reason}");
            Ok(None)
        }
    }
}

fn light_record(outcome: &FrameOutcome, channels: LightChannels) -> LightRecord {
    let estimate = &outcome.light;
    let channel = |c: usize| estimate.light.coefficients.iter().map(|rgb| rgb[c]).collect();
    LightRecord {
        frame: outcome.index,
        timestamp: outcome.timestamp_s,
        bands: estimate.light.bands,
        sh: match channels {
            LightChannels::Intensity => vec![channel(0)],
            LightChannels::Rgb => (0..3).map(channel).collect(),
        },
        dominant_direction: estimate.light.dominant_direction().map(|d| d.to_array()),
        condition: estimate.condition,
        residual: estimate.residual,
        std: estimate.deviation.iter().map(|&d| f64::from(d)).collect(),
        pixels: estimate.pixels,
    }
}

fn frame_timing(outcome: &FrameOutcome, age: Option<Duration>, setting: &str) -> FrameTiming {
    FrameTiming {
        frame: outcome.index,
        timestamp_s: outcome.timestamp_s,
        duration: outcome.duration,
        age,
        stages: outcome.times,
        position_m: outcome.tracking.world_from_camera.translation.vector.into(),
        state: outcome.tracking.state,
        setting: setting.to_owned(),
    }
}
