//! From the lights of a run's frames to its record.

use super::observe::Observation;
use super::plan::{Job, Kind};
use super::record::{Jitter, LightFrame, LightRun, StepResponse, StepTrace};
use crate::eval::light::{LightSegment, LightTruth, angle_deg};
use crate::math::median;
use crate::study::StudyError;
use crate::timing::{Stage, StageTimes};
use glam::Vec3;
use std::collections::BTreeMap;
use std::path::Path;

/// An estimate has settled within this relative L2 distance of its final value.
const SETTLED: f64 = 0.1;

/// The final value is the mean over this share of the frames after the switch.
const FINAL_SHARE: usize = 4;

/// What a job gave.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Outcome {
    Run(LightRun),
    Step(StepResponse),
    Jitter(Jitter),
}

/// `seen` holds the frames from the warm-up on.
pub(super) fn outcome(
    job: &Job,
    seen: &[Observation],
    truth: &LightTruth,
) -> Result<Outcome, StudyError> {
    if seen.is_empty() {
        let problem = "no frame is left after the warm-up".to_owned();
        return Err(StudyError::file(job.sequence.as_ref(), problem));
    }
    Ok(match job.kind {
        Kind::Run { light } => Outcome::Run(light_run(job, light, seen, truth)?),
        Kind::Step { switch_frame } => {
            Outcome::Step(step_response(job, switch_frame, seen, truth)?)
        }
        Kind::Jitter => Outcome::Jitter(jitter(job, seen)),
    })
}

fn segment<'a>(
    job: &Job,
    truth: &'a LightTruth,
    frame: usize,
) -> Result<&'a LightSegment, StudyError> {
    truth.at_frame(frame).ok_or_else(|| {
        let path = Path::new(&job.sequence).join("light.json");
        StudyError::file(&path, format!("it says nothing about frame {frame}"))
    })
}

fn light_run(
    job: &Job,
    light: usize,
    seen: &[Observation],
    truth: &LightTruth,
) -> Result<LightRun, StudyError> {
    let mut frames = Vec::with_capacity(seen.len());
    for s in seen.iter().filter(|s| s.valid) {
        if let Some(error) = segment(job, truth, s.frame)?.error_of(&s.light) {
            frames.push(LightFrame {
                frame: s.frame,
                direction: s.light.dominant_direction().map(|d| d.as_dvec3().to_array()),
                angle_deg: error.angle_deg,
                relative_l2: error.relative_l2,
            });
        }
    }
    Ok(LightRun {
        scene: job.options.scene.clone(),
        light,
        sensor_noise: job.sensor_noise,
        method: job.method.name.clone(),
        true_direction: segment(job, truth, seen[0].frame)?.dominant_direction,
        invalid: seen.len() - frames.len(),
        frames,
        stage_ms: stage_medians(&seen.iter().filter_map(|s| s.times).collect::<Vec<_>>()),
    })
}

fn stage_medians(times: &[StageTimes]) -> BTreeMap<String, f64> {
    let over_frames = |ms: &dyn Fn(&StageTimes) -> f64| median(times.iter().map(ms));
    let stages = Stage::ALL.into_iter().filter_map(|stage| {
        let value = over_frames(&|t| 1e3 * t.get(stage).as_secs_f64())?;
        Some((stage.name().to_owned(), value))
    });
    let update = over_frames(&|t| 1e3 * t.update().as_secs_f64());
    stages.chain(update.map(|value| ("Update".to_owned(), value))).collect()
}

/// Frames whose estimate was refused keep the last one: that is the light a user sees.
fn step_response(
    job: &Job,
    switch_frame: usize,
    seen: &[Observation],
    truth: &LightTruth,
) -> Result<StepResponse, StudyError> {
    let lights: Vec<Vec<f64>> = seen.iter().map(coefficients).collect();
    let after = seen.iter().filter(|s| s.frame >= switch_frame).count();
    let settled = mean(&lights[lights.len() - (after / FINAL_SHARE).max(1)..]);
    let mut trace = Vec::with_capacity(seen.len());
    for (s, light) in seen.iter().zip(&lights) {
        let [x, y, z] = segment(job, truth, s.frame)?.dominant_direction.map(|v| v as f32);
        let found = s.light.dominant_direction();
        trace.push(StepTrace {
            frame: s.frame,
            distance: relative_distance(light, &settled),
            angle_deg: found.and_then(|found| angle_deg(found, Vec3::new(x, y, z))),
        });
    }
    Ok(StepResponse {
        scene: job.options.scene.clone(),
        method: job.method.name.clone(),
        sensor_noise: job.sensor_noise,
        switch_frame,
        settled_after: settled_after(&trace, switch_frame),
        trace,
    })
}

/// Frames from the switch until the distance stays small; none where the last is large.
fn settled_after(trace: &[StepTrace], switch_frame: usize) -> Option<usize> {
    let after: Vec<f64> =
        trace.iter().filter(|t| t.frame >= switch_frame).map(|t| t.distance).collect();
    // What is no number has not settled.
    let unsettled = after.iter().rposition(|d| !matches!(d, d if *d <= SETTLED));
    match unsettled {
        None => (!after.is_empty()).then_some(0),
        Some(last) => (last + 1 < after.len()).then_some(last + 1),
    }
}

fn jitter(job: &Job, seen: &[Observation]) -> Jitter {
    let lights: Vec<Vec<f64>> = seen.iter().map(coefficients).collect();
    let turns: Vec<f64> = seen
        .windows(2)
        .filter_map(|pair| {
            let [a, b] = [0, 1].map(|i| pair[i].light.dominant_direction());
            angle_deg(a?, b?)
        })
        .collect();
    let changes = lights.windows(2).map(|pair| relative_distance(&pair[1], &pair[0]));
    Jitter {
        scene: job.options.scene.clone(),
        method: job.method.name.clone(),
        sensor_noise: job.sensor_noise,
        frames: seen.len(),
        median_deg: median(turns.iter().copied()).unwrap_or(0.0),
        max_deg: turns.iter().copied().fold(0.0, f64::max),
        relative_l2: median(changes).unwrap_or(0.0),
    }
}

/// Luminance of a frame's light.
fn coefficients(seen: &Observation) -> Vec<f64> {
    seen.light.luminance().into_iter().map(f64::from).collect()
}

/// Of at least one light; all have the bands of one setting.
fn mean(lights: &[Vec<f64>]) -> Vec<f64> {
    let mut sum = vec![0.0; lights[0].len()];
    for light in lights {
        sum.iter_mut().zip(light).for_each(|(s, l)| *s += l);
    }
    sum.iter().map(|s| s / lights.len() as f64).collect()
}

/// |a - b| / |b|; where b is zero, 0 for a zero a and 1 for any other.
fn relative_distance(a: &[f64], b: &[f64]) -> f64 {
    let norm = |v: &mut dyn Iterator<Item = f64>| v.map(|x| x * x).sum::<f64>().sqrt();
    let difference = norm(&mut a.iter().zip(b).map(|(a, b)| a - b));
    match norm(&mut b.iter().copied()) {
        0.0 => f64::from(difference > 0.0),
        length => difference / length,
    }
}
