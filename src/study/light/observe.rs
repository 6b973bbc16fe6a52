//! The pipeline over a made sequence, as the light of each frame.

use crate::capture::FrameSource;
use crate::config::Settings;
use crate::lighting::{LightEstimate, ShLight};
use crate::pipeline::Pipeline;
use crate::scene::VirtualScene;
use crate::stop::Stop;
use crate::study::{StudyError, each_frame, open_made};
use crate::timing::StageTimes;
use std::path::Path;

/// What a method says about one frame.
#[derive(Clone, Debug)]
pub(super) struct Observation {
    pub frame: usize,
    /// The last good one where this frame gave none.
    pub light: ShLight,
    pub valid: bool,
    /// Of methods that run the pipeline.
    pub times: Option<StageTimes>,
}

impl Observation {
    /// With the light at the point that the truth is given for.
    pub fn new(
        frame: usize,
        estimate: &LightEstimate,
        at: Option<[f64; 3]>,
        times: Option<StageTimes>,
    ) -> Self {
        let at = at.map(|point| glam::DVec3::from(point).as_vec3());
        Self { frame, valid: estimate.valid(), light: estimate.field.at(at), times }
    }
}

/// Runs all frames without virtual objects; `tick` is called after each.
pub(super) fn observe(
    sequence: &Path,
    sensor_noise: bool,
    settings: &Settings,
    at: Option<[f64; 3]>,
    stop: &Stop,
    tick: &dyn Fn(),
) -> Result<Vec<Observation>, StudyError> {
    let mut source = open_made(sequence, sensor_noise)?;
    let mut pipeline = Pipeline::new(settings.clone(), source.camera(), VirtualScene::default())?;
    let mut seen = Vec::new();
    each_frame(&mut source, &mut pipeline, stop, &mut |_, outcome| {
        seen.push(Observation::new(outcome.index, &outcome.light, at, Some(outcome.times)));
        tick();
        Ok(())
    })?;
    Ok(seen)
}
