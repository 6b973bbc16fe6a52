//! What each step of the light estimator gains: one pass of the pipeline over each sequence of the light
//! study, whose samples all steps see alike.
//!
//! The steps were chosen on some of the scenes; the others tell whether they hold elsewhere.

use super::light::{LightPlan, sequence_name};
use super::{Machine, SequenceStore, StudyError, each_frame, open_made};
use crate::capture::FrameSource;
use crate::config::Settings;
use crate::eval::light::LightTruth;
use crate::lighting::LightEstimator;
use crate::math::median;
use crate::output::{OutputError, atomic_write};
use crate::pipeline::Pipeline;
use crate::scene::VirtualScene;
use crate::stop::Stop;
use serde::{Deserialize, Serialize};
use std::fmt::Write as _;
use std::path::Path;

/// Scenes that the steps were chosen on.
pub const CHOSEN_ON: [&str; 4] = ["sphere", "desk", "demo", "room"];

/// Each step keeps what those before it changed. The first is the paper's solver (Gruber et al. 2015,
/// Sec. 5.2), the last the default.
const STEPS: [(&str, &[&str]); 8] = [
    (
        "least squares, as in the paper",
        &[
            "light.prior=dark",
            "light.tikhonov=0",
            "light.huber=0",
            "light.memory=0",
            "light.model_only=false",
            "light.albedo_classes=false",
            "light.balance_normals=false",
            "light.hidden_radiance=0",
        ],
    ),
    ("Tikhonov", &["light.tikhonov=0.3"]),
    ("memory, robust weights", &["light.memory=0.9", "light.huber=1.345", "light.model_only=true"]),
    ("a lamp at infinity", &["light.prior=distant-lamp", "light.tikhonov=1"]),
    ("a lamp with a place", &["light.prior=near-lamp"]),
    ("albedo of colour classes", &["light.albedo_classes=true"]),
    ("balanced normals", &["light.balance_normals=true"]),
    ("light from hidden directions", &["light.hidden_radiance=0.5"]),
];

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EstimatorStudy {
    pub machine: Machine,
    /// The command line that made it.
    pub command: String,
    pub steps: Vec<String>,
    pub runs: Vec<EstimatorRun>,
}

/// One step on one sequence: medians over the frames after the warm-up.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EstimatorRun {
    pub step: String,
    pub scene: String,
    pub light: usize,
    pub sensor_noise: bool,
    pub angle_deg: Option<f64>,
    pub relative_l2: Option<f64>,
}

/// Runs every sequence of the plan with its first preset; `progress(done, all)` counts sequences.
pub fn run(
    plan: &LightPlan,
    command: &str,
    store: &SequenceStore,
    stop: &Stop,
    progress: &dyn Fn(usize, usize),
) -> Result<EstimatorStudy, StudyError> {
    let preset = plan.presets.first().ok_or_else(|| StudyError::Options("no preset".into()))?;
    let settings = Settings::preset(preset)?;
    let steps = steps(&settings)?;
    let noises: Vec<bool> =
        [(plan.exact, false), (plan.kinect, true)].iter().filter(|n| n.0).map(|n| n.1).collect();
    let all = plan.scenes.len() * plan.lights.len() * noises.len();
    let mut runs = Vec::new();
    for scene in &plan.scenes {
        for &light in &plan.lights {
            let options = plan.sequence(scene, light, plan.warm_up + plan.frames);
            let path = store.get(&sequence_name(scene, light), &options, stop, &|_, _| {})?;
            for &sensor_noise in &noises {
                let errors = observe(&path, sensor_noise, &settings, &steps, plan.warm_up, stop)?;
                runs.extend(steps.iter().zip(errors).map(|((name, _), errors)| EstimatorRun {
                    step: (*name).to_owned(),
                    scene: scene.clone(),
                    light,
                    sensor_noise,
                    angle_deg: median(errors.iter().filter_map(|e| e.0)),
                    relative_l2: median(errors.iter().map(|e| e.1)),
                }));
                progress(runs.len() / steps.len(), all);
            }
        }
    }
    Ok(EstimatorStudy {
        machine: Machine::here(),
        command: command.to_owned(),
        steps: steps.iter().map(|(name, _)| (*name).to_owned()).collect(),
        runs,
    })
}

fn steps(settings: &Settings) -> Result<Vec<(&'static str, Settings)>, StudyError> {
    let mut settings = settings.clone();
    STEPS
        .iter()
        .map(|(name, assignments)| {
            assignments.iter().try_for_each(|a| settings.assign(a))?;
            settings.validate()?;
            Ok((*name, settings.clone()))
        })
        .collect()
}

type Errors = Vec<(Option<f64>, f64)>;

/// Angle and relative L2 of each step, in all frames after the warm-up that gave it a light.
fn observe(
    sequence: &Path,
    sensor_noise: bool,
    settings: &Settings,
    steps: &[(&str, Settings)],
    warm_up: usize,
    stop: &Stop,
) -> Result<Vec<Errors>, StudyError> {
    let truth = LightTruth::read(&sequence.join("light.json"))?;
    let mut estimators: Vec<_> =
        steps.iter().map(|(_, settings)| LightEstimator::new(&settings.light)).collect();
    let mut errors = vec![Errors::new(); steps.len()];
    let mut source = open_made(sequence, sensor_noise)?;
    let mut pipeline = Pipeline::new(settings.clone(), source.camera(), VirtualScene::default())?;
    each_frame(&mut source, &mut pipeline, stop, &mut |pipeline, outcome| {
        let (Some((surface, _)), Some(transfer)) = (pipeline.geometry(), pipeline.transfer())
        else {
            return Ok(());
        };
        for (estimator, errors) in estimators.iter_mut().zip(&mut errors) {
            // Made scenes lie around the origin, so that the pipeline's world is that of the truth.
            let estimate = estimator.estimate(pipeline.frame(), surface, transfer, None);
            let error = truth.error_of(outcome.index, &estimate);
            if let Some(error) = error.filter(|_| outcome.index >= warm_up && estimate.valid()) {
                errors.push((error.angle_deg, error.relative_l2));
            }
        }
        Ok(())
    })?;
    Ok(errors)
}

/// `study.json` and `summary.md` in `out`.
pub fn write(study: &EstimatorStudy, out: &Path) -> Result<(), StudyError> {
    std::fs::create_dir_all(out).map_err(|e| OutputError::io(out, e))?;
    atomic_write(&out.join("study.json"), |w| {
        serde_json::to_writer_pretty(&mut *w, study)?;
        writeln!(w)
    })?;
    atomic_write(&out.join("summary.md"), |w| writeln!(w, "{}", summary(study)))?;
    Ok(())
}

/// Medians over the sequences, and the largest angle, as a Markdown table.
pub fn summary(study: &EstimatorStudy) -> String {
    let chosen = |run: &&EstimatorRun| CHOSEN_ON.contains(&run.scene.as_str());
    let mut out = String::from(
        "| each step adds | chosen on, exact | others, exact | chosen on, Kinect | others, Kinect |\n\
         | --- | --- | --- | --- | --- |\n",
    );
    for step in &study.steps {
        let _ = write!(out, "| {step} |"); // a String takes everything
        for sensor_noise in [false, true] {
            for wanted in [true, false] {
                let runs: Vec<_> = study
                    .runs
                    .iter()
                    .filter(|run| run.step == *step && run.sensor_noise == sensor_noise)
                    .filter(|run| chosen(run) == wanted)
                    .collect();
                let angles = || runs.iter().filter_map(|run| run.angle_deg);
                let cell = median(angles()).map_or("-".to_owned(), |angle| {
                    let worst = angles().fold(0.0, f64::max);
                    let l2 = median(runs.iter().filter_map(|run| run.relative_l2));
                    format!("{angle:.1} ({worst:.0}), {:.2}", l2.unwrap_or(f64::NAN))
                });
                let _ = write!(out, " {cell} |");
            }
        }
        out.push('\n');
    }
    out + "\nMedian angle in degrees (the worst sequence), and median relative L2 of the coefficients.\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_step_is_the_default() {
        let settings = Settings::default();
        let steps = steps(&settings).unwrap();
        assert_eq!(steps.last().unwrap().1, settings);
        assert_ne!(steps[0].1, settings);
        for pair in steps.windows(2) {
            assert_ne!(pair[0].1, pair[1].1, "{} changes something", pair[1].0);
        }
    }

    #[test]
    fn a_small_study_has_all_runs_and_says_where_steps_were_chosen() {
        let folder = tempfile::tempdir().unwrap();
        let store = SequenceStore::new(folder.path());
        let plan = LightPlan {
            scenes: vec!["sphere".into(), "blocks".into()],
            lights: vec![1],
            presets: vec!["ours-fast".into()],
            kinect: false,
            frames: 2,
            warm_up: 0,
            width: 96,
            height: 72,
            samples: 1,
            ..LightPlan::default()
        };
        let study = run(&plan, "test", &store, &Stop::default(), &|_, _| {}).unwrap();
        assert_eq!(study.runs.len(), 2 * STEPS.len());
        let last = study.runs.iter().filter(|run| run.step == STEPS[7].0);
        assert!(last.clone().count() == 2 && last.clone().all(|run| run.angle_deg.is_some()));
        let summary = summary(&study);
        assert_eq!(summary.lines().filter(|l| l.starts_with("| ")).count(), 2 + STEPS.len());
        let row = summary.lines().nth(2).unwrap();
        assert_eq!(row.matches(" - |").count(), 2, "nothing was asked of the sensor model: {row}");
        write(&study, folder.path()).unwrap();
        let text = std::fs::read_to_string(folder.path().join("study.json")).unwrap();
        assert_eq!(serde_json::from_str::<EstimatorStudy>(&text).unwrap(), study);
    }
}
