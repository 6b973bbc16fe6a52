//! One setting on one case.

use super::cases::Case;
use super::measure::measure;
use super::record::{CompositeFrame, CompositeRun};
use super::variants::LightSource;
use crate::capture::{CaptureOptions, FrameSource, open_sequence};
use crate::config::Settings;
use crate::eval::light::{LightSegment, LightTruth, angle_deg, scaled_relative_l2};
use crate::image::Image;
use crate::lighting::ShLight;
use crate::math::median;
use crate::pipeline::Pipeline;
use crate::stop::Stop;
use crate::study::{StudyError, each_frame};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Everything that a result depends on: two runs with the same key give the same errors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunKey {
    pub folder: PathBuf,
    pub made: Option<crate::synth::SynthOptions>,
    pub sensor_noise: bool,
    /// Measured.
    pub frames: Vec<usize>,
    pub settings: Settings,
    pub light: LightSource,
    /// Of the program.
    pub version: String,
}

/// The pictures of the last measured frame.
pub struct LastFrame {
    pub frame: usize,
    pub input: Image<[u8; 3]>,
    pub truth: Image<[u8; 3]>,
    pub composed: Image<[u8; 3]>,
}

/// What is said about a run beside its key.
pub struct RunName<'a> {
    pub preset: &'a str,
    pub key: &'a str,
    pub words: &'a str,
    pub changes: Vec<String>,
}

/// Runs the frames of `case` up to the last measured one.
pub fn run(
    case: &Case,
    key: &RunKey,
    name: &RunName,
    stop: &Stop,
) -> Result<(CompositeRun, Option<LastFrame>), StudyError> {
    let end = key.frames.iter().max().map_or(1, |last| last + 1);
    let depth_list = case.sensor_noise.then(|| "depth_kinect.txt".to_owned());
    let options = CaptureOptions { depth_list, end_frame: Some(end), ..CaptureOptions::default() };
    let mut source = open_sequence(case.truth.folder(), &options)?;
    let light = case.truth.light()?;
    let mut pipeline = Pipeline::new(key.settings.clone(), source.camera(), case.truth.scene()?)?;
    pipeline.set_light(given_light(key, &light, 0)?);
    let (mut frames, mut update_ms, mut last) = (Vec::new(), Vec::new(), None);
    each_frame(&mut source, &mut pipeline, stop, &mut |pipeline, outcome| {
        update_ms.push(outcome.times.update().as_secs_f64() * 1e3);
        if outcome.index + 1 < end {
            pipeline.set_light(given_light(key, &light, outcome.index + 1)?);
        }
        if !key.frames.contains(&outcome.index) {
            return Ok(());
        }
        let Some(truth) = case.truth.frame(outcome.index)? else { return Ok(()) };
        let (input, composed) = (&pipeline.frame().color_srgb, pipeline.composed());
        let measured =
            measure(input, composed, &truth).map_err(|e| StudyError::file(&truth.path, e))?;
        frames.push(with_light(measured, &outcome.light.light, light.at_frame(outcome.index)));
        last = Some(LastFrame {
            frame: outcome.index,
            input: input.clone(),
            composed: composed.clone(),
            truth: truth.picture,
        });
        Ok(())
    })?;
    let run = CompositeRun {
        sequence: case.name.clone(),
        object: case.object.clone(),
        sensor_noise: case.sensor_noise,
        folder: case.truth.folder().display().to_string(),
        preset: name.preset.to_owned(),
        key: name.key.to_owned(),
        variant: name.words.to_owned(),
        changes: name.changes.clone(),
        frames,
        update_ms: median(update_ms).unwrap_or(0.0),
    };
    Ok((run, last))
}

/// The light that the frame is to be composed under, if not the estimated one. The truth is what
/// arrives; the pipeline's light is that times the albedo it assumes.
fn given_light(
    key: &RunKey,
    truth: &LightTruth,
    frame: usize,
) -> Result<Option<ShLight>, StudyError> {
    if key.light == LightSource::Estimated {
        return Ok(None);
    }
    let path = key.folder.join("light.json");
    let missing = |what: &str| StudyError::file(&path, format!("frame {frame}: {what}"));
    let segment = truth.at_frame(frame).ok_or_else(|| missing("no light is known"))?;
    let sh = match key.light {
        LightSource::TrueWithScattered => segment.sh_probe.as_ref(),
        _ => Some(&segment.sh),
    };
    let sh = sh.ok_or_else(|| missing("no sh_probe"))?;
    let albedo = f64::from(key.settings.light.mean_albedo);
    let coefficients: Vec<[f32; 3]> = sh.iter().map(|&c| [(c * albedo) as f32; 3]).collect();
    Ok(Some(ShLight { bands: coefficients.len().isqrt(), coefficients }))
}

fn with_light(
    mut frame: CompositeFrame,
    light: &ShLight,
    truth: Option<&LightSegment>,
) -> CompositeFrame {
    let Some(truth) = truth else { return frame };
    let [x, y, z] = truth.dominant_direction.map(|v| v as f32);
    let direction = light.dominant_direction();
    let angle = direction.and_then(|found| angle_deg(found, glam::Vec3::new(x, y, z)));
    frame.light_deg = angle.unwrap_or(f64::NAN);
    let estimate: Vec<f64> = light.luminance().into_iter().map(f64::from).collect();
    let arriving = truth.sh_probe.as_ref().unwrap_or(&truth.sh);
    if let Some((scale, _)) = scaled_relative_l2(&estimate, arriving).filter(|s| s.0 > 0.0) {
        frame.implied_albedo = 1.0 / scale;
    }
    frame
}
