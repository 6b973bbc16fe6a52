//! Runs settings over sequences: times and errors become points.

use super::super::StudyError;
use super::truth::{FrameErrors, Truth};
use super::{ErrorKind, TradePoint, Tradeoff, Variant, neighbours};
use crate::capture::{CaptureOptions, FrameSource, Sequence, open_sequence};
use crate::math::median;
use crate::pipeline::Pipeline;
use crate::scene::VirtualScene;
use crate::stop::Stop;
use crate::study::{Machine, each_frame};
use crate::timing::{Stage, StageTimes};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Every how many judged frames transfer is traced.
const TRACE_EVERY: usize = 8;

/// What a sweep runs over, and how.
pub struct Sweep<'a> {
    pub sequences: Vec<PathBuf>,
    /// Frame range and calibration, for all sequences.
    pub capture: CaptureOptions,
    /// Frames at the start of each run that are neither timed nor judged.
    pub warm_up: usize,
    /// Every variant runs this often; rounds go over all variants, so that a load that comes and
    /// goes falls on all alike.
    pub repeat: usize,
    /// The error of the front; none takes the first that there is.
    pub error: Option<ErrorKind>,
    /// Virtual objects for a sequence.
    pub scene: &'a dyn Fn(&Path, &Sequence) -> Result<VirtualScene, StudyError>,
    /// Ends the sweep with [`StudyError::Stopped`].
    pub stop: &'a Stop,
    /// `(done, all, name of the next)`
    pub progress: &'a dyn Fn(usize, usize, &str),
}

/// All runs of one variant over one sequence.
#[derive(Default)]
struct Runs {
    times: Vec<StageTimes>,
    errors: Vec<FrameErrors>,
    volume_bytes: usize,
}

impl Sweep<'_> {
    /// Measures `plan`, and then, if `refine`, the neighbours of the front. Marks the front.
    ///
    /// A variant that cannot be measured (it loses the camera) is left out with a warning.
    pub fn run(
        &self,
        plan: Vec<Variant>,
        refine: bool,
        command: String,
    ) -> Result<(Tradeoff, ErrorKind), StudyError> {
        let mut study = Tradeoff {
            machine: Machine::here(),
            command,
            sequences: self.sequences.iter().map(|p| p.display().to_string()).collect(),
            warm_up: self.warm_up,
            points: self.measure(&plan)?,
        };
        let mut kind = self.mark(&mut study)?;
        if refine {
            let on_front =
                |v: &&Variant| study.points.iter().any(|p| p.on_front && p.name == v.name);
            let near = neighbours(plan.iter().filter(on_front), &plan)?;
            study.points.extend(self.measure(&near)?);
            kind = self.mark(&mut study)?;
        }
        Ok((study, kind))
    }

    fn mark(&self, study: &mut Tradeoff) -> Result<ErrorKind, StudyError> {
        let kind = self.kind(&study.points)?;
        study.mark_front(kind);
        Ok(kind)
    }

    /// The error of the front, which at least one of `points` must have.
    fn kind(&self, points: &[TradePoint]) -> Result<ErrorKind, StudyError> {
        let first = ErrorKind::first_of(points);
        let kind = self.error.or(first).filter(|kind| points.iter().any(|p| kind.of(p).is_some()));
        kind.ok_or_else(|| {
            let wanted =
                self.error.map_or("light, composite or transfer error".to_owned(), |kind| {
                    format!("{} error", kind.name())
                });
            StudyError::Options(format!(
                "nothing to measure the {wanted} against in the frames after the warm-up of {}",
                self.sequences
                    .iter()
                    .map(|p| p.display().to_string())
                    .collect::<Vec<_>>()
                    .join(", ")
            ))
        })
    }

    fn measure(&self, variants: &[Variant]) -> Result<Vec<TradePoint>, StudyError> {
        let all = variants.len() * self.repeat;
        let mut runs: Vec<Vec<Runs>> = variants
            .iter()
            .map(|_| self.sequences.iter().map(|_| Runs::default()).collect())
            .collect();
        for round in 0..self.repeat {
            for (i, variant) in variants.iter().enumerate() {
                (self.progress)(round * variants.len() + i, all, &variant.name);
                for (path, runs) in self.sequences.iter().zip(&mut runs[i]) {
                    self.pass(path, variant, round == 0, runs)?;
                }
                if let (0, 0, Some(first)) = (round, i, point(variant, &runs[i])) {
                    self.kind(&[first])?; // before hours are spent
                }
            }
        }
        (self.progress)(all, all, "");
        let points = variants.iter().zip(&runs).filter_map(|(variant, runs)| {
            let point = point(variant, runs);
            if point.is_none() {
                log::warn!("{}: no frame after the warm-up was composed; left out", variant.name);
            }
            point
        });
        Ok(points.collect())
    }

    /// One run. Errors are taken between frames, outside all timed stages, and once: they do not
    /// change from run to run.
    fn pass(
        &self,
        path: &Path,
        variant: &Variant,
        judge: bool,
        runs: &mut Runs,
    ) -> Result<(), StudyError> {
        let mut source = open_sequence(path, &self.capture)?;
        let scene = (self.scene)(path, &source)?;
        let truth = judge.then(|| Truth::of_sequence(path)).transpose()?;
        let mut pipeline = Pipeline::new(variant.settings.clone(), source.camera(), scene)?;
        let mut seen = 0;
        each_frame(&mut source, &mut pipeline, self.stop, &mut |pipeline, outcome| {
            seen += 1;
            runs.volume_bytes = runs.volume_bytes.max(outcome.volume_bytes);
            if seen <= self.warm_up || !outcome.composed {
                return Ok(());
            }
            runs.times.push(outcome.times);
            if let Some(truth) = &truth {
                let trace = runs.errors.len().is_multiple_of(TRACE_EVERY);
                runs.errors.push(truth.errors(trace, pipeline, outcome)?);
            }
            Ok(())
        })
    }
}

/// Medians over frames, means over sequences; none where a sequence has no frame.
fn point(variant: &Variant, sequences: &[Runs]) -> Option<TradePoint> {
    if sequences.iter().any(|runs| runs.times.is_empty()) {
        return None;
    }
    let time = |of: &dyn Fn(&StageTimes) -> f64| {
        mean(sequences.iter().filter_map(|runs| median(runs.times.iter().map(of))))
    };
    let error = |of: &dyn Fn(&FrameErrors) -> Option<f64>| {
        mean(sequences.iter().filter_map(|runs| median(runs.errors.iter().filter_map(of))))
    };
    let update_ms = time(&|t| 1e3 * t.update().as_secs_f64())?;
    let mut stage_ms: BTreeMap<String, f64> = Stage::ALL
        .into_iter()
        .filter_map(|s| Some((s.name().to_owned(), time(&|t| 1e3 * t.get(s).as_secs_f64())?)))
        .collect();
    stage_ms.insert("Update".to_owned(), update_ms);
    Some(TradePoint {
        name: variant.name.clone(),
        preset: variant.preset.clone(),
        changes: variant.changes.clone(),
        stage_ms,
        update_ms,
        light_angle_deg: error(&|e| e.light?.angle_deg),
        light_relative_l2: error(&|e| Some(e.light?.relative_l2)),
        transfer_error: error(&|e| e.transfer),
        composite_error: error(&|e| e.composite),
        volume_mib: mean(sequences.iter().map(|r| r.volume_bytes as f64 / (1 << 20) as f64))?,
        on_front: false,
    })
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let values: Vec<f64> = values.collect();
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::super::plan;
    use super::*;
    use std::time::Duration;

    fn runs(ms: &[u64], angles: &[Option<f64>]) -> Runs {
        let times = ms.iter().map(|&ms| {
            let mut times = StageTimes::default();
            times.add(Stage::Surface, Duration::from_millis(ms));
            times.add(Stage::Input, Duration::from_millis(10));
            times
        });
        let errors =
            angles.iter().map(|&composite| FrameErrors { composite, ..FrameErrors::default() });
        Runs { times: times.collect(), errors: errors.collect(), volume_bytes: 3 << 20 }
    }

    #[test]
    fn a_point_is_medians_over_frames_and_means_over_sequences() {
        let variant = plan(true).unwrap().remove(0);
        let first = runs(&[20, 30, 500], &[Some(0.2), None, Some(0.4)]);
        let second = runs(&[50, 50], &[None, None]);
        let both = point(&variant, &[first, second]).unwrap();
        assert!((both.stage_ms["Surface"] - 40.0).abs() < 1e-9);
        assert!((both.update_ms - 50.0).abs() < 1e-9);
        assert_eq!(both.stage_ms["Update"], both.update_ms);
        assert_eq!(both.stage_ms["LightEst"], 0.0);
        // the sequence without truth does not count
        assert!((both.composite_error.unwrap() - 0.3).abs() < 1e-9);
        assert_eq!((both.light_angle_deg, both.volume_mib), (None, 3.0));
        assert!(point(&variant, &[runs(&[20], &[]), runs(&[], &[])]).is_none());
    }
}
