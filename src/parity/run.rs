//! Whole runs: both pipelines over the same frames, each on its own results of the frames before.

use super::stages::codes;
use super::tolerances::*;
use crate::gpu::parity::Difference;
use crate::image::Image;
use crate::lighting::LightEstimate;
use crate::math::{Pose, median};
use crate::pipeline::FrameOutcome;

/// Differences of each frame.
#[derive(Debug, Default)]
pub struct WholeRun {
    position_mm: Series,
    rotation_deg: Series,
    light_deg: Series,
    picture_percent: Series,
    judgement: Series,
}

#[derive(Debug, Default)]
struct Series(Vec<(usize, f64)>);

/// One quantity over all frames.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Summary {
    pub quantity: &'static str,
    pub unit: &'static str,
    pub frames: usize,
    #[serde(serialize_with = "super::report::finite_or_text")]
    pub mean: f64,
    #[serde(serialize_with = "super::report::finite_or_text")]
    pub median: f64,
    #[serde(serialize_with = "super::report::finite_or_text")]
    pub largest: f64,
    /// Where that is.
    pub frame: usize,
    /// Frames beyond the tolerance.
    pub beyond: usize,
    pub tolerance: f64,
    pub reason: &'static str,
    pub within: bool,
}

impl WholeRun {
    /// One frame of both, and the pictures that they composed.
    pub fn add(
        &mut self,
        [cpu, gpu]: [&FrameOutcome; 2],
        [cpu_picture, gpu_picture]: [&Image<[u8; 3]>; 2],
    ) {
        let frame = cpu.index;
        let poses = [cpu, gpu].map(|outcome| outcome.tracking.world_from_camera);
        let (mm, degrees) = pose_difference(&poses[0], &poses[1]);
        self.position_mm.0.push((frame, mm));
        self.rotation_deg.0.push((frame, degrees));
        let judged = |o: &FrameOutcome| (o.tracking.state, o.composed, o.light.valid());
        self.judgement.0.push((frame, f64::from(u8::from(judged(cpu) != judged(gpu)))));
        if cpu.composed && gpu.composed {
            self.light_deg.0.push((frame, light_difference_deg(&cpu.light, &gpu.light)));
        }
        let [cpu, gpu] = [cpu_picture, gpu_picture].map(codes);
        if !cpu.is_empty() {
            let share = Difference::of(&cpu, &gpu, 1.0).share_beyond();
            self.picture_percent.0.push((frame, 100.0 * share));
        }
    }

    /// Every quantity, judged by its worst frame or by all together. `software` is the kind of device.
    pub fn summaries(&self, software: bool) -> Vec<Summary> {
        use JudgedBy::{Mean, Worst};
        let all = [
            (&RUN_POSITION, &self.position_mm, Worst),
            (&RUN_ROTATION, &self.rotation_deg, Worst),
            (&RUN_LIGHT, &self.light_deg, Worst),
            (&RUN_PICTURES, &self.picture_percent, Mean),
            (&RUN_PICTURE, &self.picture_percent, Worst),
            (&RUN_JUDGEMENT, &self.judgement, Worst),
        ];
        all.into_iter()
            .filter_map(|(tolerance, series, by)| series.summary(tolerance, by, software))
            .collect()
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum JudgedBy {
    Worst,
    Mean,
}

impl Series {
    /// None without frames.
    fn summary(&self, tolerance: &Tolerance, by: JudgedBy, software: bool) -> Option<Summary> {
        let values = || self.0.iter().map(|&(_, value)| value);
        // the first of equal ones
        let &(frame, largest) = self.0.iter().rev().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let limit = tolerance.limit(software).largest;
        let mean = values().sum::<f64>() / self.0.len() as f64;
        let judged = if by == JudgedBy::Mean { mean } else { largest };
        Some(Summary {
            quantity: tolerance.quantity,
            unit: tolerance.unit,
            frames: self.0.len(),
            mean,
            median: median(values())?,
            largest,
            frame,
            beyond: values().filter(|&value| beyond(value, limit)).count(),
            tolerance: limit,
            reason: tolerance.reason,
            within: !beyond(judged, limit),
        })
    }
}

/// What is no number is beyond every limit.
fn beyond(value: f64, limit: f64) -> bool {
    value.is_nan() || value > limit
}

/// Millimetres, degrees.
pub fn pose_difference(a: &Pose, b: &Pose) -> (f64, f64) {
    let difference = a.inverse() * b;
    (1e3 * difference.translation.vector.norm(), difference.rotation.angle().to_degrees())
}

/// Between the dominant directions; infinite where just one light has one.
pub fn light_difference_deg(a: &LightEstimate, b: &LightEstimate) -> f64 {
    match [a, b].map(|estimate| estimate.light.dominant_direction()) {
        [Some(a), Some(b)] => {
            let (a, b) = (a.as_dvec3(), b.as_dvec3());
            a.cross(b).length().atan2(a.dot(b)).to_degrees()
        }
        [None, None] => 0.0,
        _ => f64::INFINITY,
    }
}
