//! One pass of the pipeline over a sequence, for measuring.

use super::StudyError;
use crate::capture::{CaptureOptions, FrameSource, Sequence, open_sequence};
use crate::pipeline::{FrameOutcome, Pipeline};
use crate::stop::Stop;
use crate::timing::{Stage, StageTimes};
use std::path::Path;
use std::time::Instant;

/// Opens a made sequence, with exact depth or that of the sensor model.
pub fn open_made(path: &Path, sensor_noise: bool) -> Result<Sequence, StudyError> {
    let depth_list = sensor_noise.then(|| "depth_kinect.txt".to_owned());
    Ok(open_sequence(path, &CaptureOptions { depth_list, ..CaptureOptions::default() })?)
}

/// Runs every frame of `source` and shows each result. A run that is asked to stop is an error: half of one says
/// nothing.
pub fn each_frame(
    source: &mut Sequence,
    pipeline: &mut Pipeline,
    stop: &Stop,
    on_frame: &mut dyn FnMut(&mut Pipeline, &FrameOutcome) -> Result<(), StudyError>,
) -> Result<(), StudyError> {
    loop {
        stop.check()?;
        let start = Instant::now();
        let Some(raw) = source.next_frame()? else { return Ok(()) };
        let mut times = StageTimes::default();
        times.add(Stage::Input, start.elapsed());
        let outcome = pipeline.process(raw, times)?;
        on_frame(pipeline, &outcome)?;
    }
}
