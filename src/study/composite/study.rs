//! All runs of a study, and the files that it leaves.

use super::cases::{Case, MadeOptions, made};
use super::log::RunLog;
use super::record::{CompositeRun, CompositeStudy};
use super::runs::{LastFrame, RunKey, RunName, run};
use super::variants::{LightSource, PRESET, Variant, select};
use super::{pictures, tables};
use crate::config::Settings;
use crate::math::median;
use crate::output::atomic_write;
use crate::stop::Stop;
use crate::study::{Machine, SequenceStore, StudyError};
use std::path::{Path, PathBuf};

/// Frames before this one are not measured: the volume and the light have not settled.
const FIRST_MEASURED: usize = 5;

/// What a study runs.
#[derive(Clone, Debug)]
pub struct CompositeOptions {
    pub out: PathBuf,
    pub presets: Vec<String>,
    /// "all", "presets" for none, or keys of single variants.
    pub variants: Vec<String>,
    /// Sequences to make; none where that is not wanted.
    pub made: Option<MadeOptions>,
    /// Sequences with `composite/` and `virtual.json`.
    pub folders: Vec<PathBuf>,
    /// How many frames with truth are measured in a sequence, the first ones from frame 5 on; it is run
    /// up to the last of them.
    pub measured: usize,
    /// Forget what an earlier study has finished.
    pub anew: bool,
    /// The command line, for the record.
    pub command: String,
    /// Ends the study with [`StudyError::Stopped`].
    pub stop: Stop,
}

/// Told what is being done: a name, and how much of it.
pub type Progress<'a> = &'a dyn Fn(&str, usize, usize);

/// Runs the study and writes `study.json`, `runs.csv`, `summary.md` and `pictures/`.
///
/// Finished runs are kept in `runs.jsonl`; a study that was interrupted goes on after them.
pub fn run_study(
    options: &CompositeOptions,
    progress: Progress,
) -> Result<CompositeStudy, StudyError> {
    let variants = select(&options.variants).map_err(StudyError::Options)?;
    let mut presets = Vec::new();
    for name in &options.presets {
        presets.push((name.as_str(), Settings::preset(name)?));
    }
    if presets.is_empty() {
        return Err(StudyError::Options("a study needs at least one preset".into()));
    }
    if options.measured == 0 {
        return Err(StudyError::Options("at least one frame must be measured".into()));
    }
    let cases = cases(options, progress)?;
    let mut work = Work {
        log: RunLog::open(options.out.join("runs.jsonl"))?,
        pictures: options.out.join("pictures"),
        stop: &options.stop,
        runs: Vec::new(),
        progress,
        done: 0,
        all: presets.len()
            * cases.iter().map(|c| 1 + c.variants_of(&variants).len()).sum::<usize>(),
    };
    if options.anew {
        work.log.clear();
    }
    for case in &cases {
        let frames = measured_frames(case, options.measured);
        for (name, settings) in &presets {
            work.preset(case, &frames, (name, settings), case.variants_of(&variants))?;
        }
    }
    let study = CompositeStudy {
        machine: Machine::here(),
        command: options.command.clone(),
        runs: work.runs,
    };
    write(&options.out, &study)?;
    Ok(study)
}

fn cases(options: &CompositeOptions, progress: Progress) -> Result<Vec<Case>, StudyError> {
    let mut cases = Vec::new();
    for folder in &options.folders {
        cases.push(Case::folder(folder)?);
    }
    if let Some(make) = &options.made {
        let store = SequenceStore::new(options.out.join("sequences"));
        cases.extend(made(make, &store, &options.stop, progress)?);
    }
    if cases.is_empty() {
        let why =
            "nothing to study: no sequence with truth was given or found, and none is to be made";
        return Err(StudyError::Options(why.into()));
    }
    Ok(cases)
}

/// The first settled frames with truth; others only where there are no such.
fn measured_frames(case: &Case, count: usize) -> Vec<usize> {
    let mut frames = case.truth.frames().to_vec();
    frames.sort_unstable();
    let settled = frames.partition_point(|&f| f < FIRST_MEASURED);
    if settled < frames.len() {
        frames.drain(..settled);
    }
    frames.truncate(count);
    frames
}

struct Work<'a> {
    log: RunLog,
    pictures: PathBuf,
    stop: &'a Stop,
    runs: Vec<CompositeRun>,
    progress: Progress<'a>,
    /// Runs that are over, those that a preset does not need included, and all of them.
    done: usize,
    all: usize,
}

impl Work<'_> {
    fn tell(&mut self, case: &Case, preset: &str, key: &str) {
        (self.progress)(&format!("{} {preset} {key}", case.name), self.done, self.all);
        self.done += 1;
    }

    /// A preset as it is, and then its variants.
    fn preset(
        &mut self,
        case: &Case,
        frames: &[usize],
        (name, settings): (&str, &Settings),
        variants: &[Variant],
    ) -> Result<(), StudyError> {
        let key = |settings: &Settings, light: LightSource| RunKey {
            folder: case.truth.folder().to_owned(),
            made: case.made.clone(),
            sensor_noise: case.sensor_noise,
            frames: frames.to_vec(),
            settings: settings.clone(),
            light,
            version: env!("CARGO_PKG_VERSION").to_owned(),
        };
        self.tell(case, name, PRESET);
        let plain = RunName { preset: name, key: PRESET, words: name, changes: Vec::new() };
        let finished = self.once(case, key(settings, LightSource::Estimated), &plain)?;
        let albedo = median(finished.frames.iter().map(|f| f.implied_albedo));
        for variant in variants {
            self.tell(case, name, variant.key);
            let mut changed = variant.apply(settings)?;
            let mut changes: Vec<String> = variant.changes.iter().map(|c| c.to_string()).collect();
            if variant.true_albedo {
                let Some(albedo) = albedo else { continue };
                changes.push(format!("light.mean_albedo={:.4}", albedo.min(1.0)));
                changed.assign(&changes[changes.len() - 1])?;
            }
            if !variant.differs(&changed, settings) {
                continue;
            }
            let (key_, words) = (variant.key, variant.words);
            let run_name = RunName { preset: name, key: key_, words, changes };
            self.once(case, key(&changed, variant.light), &run_name)?;
        }
        Ok(())
    }

    /// Runs what has not been run yet.
    fn once(
        &mut self,
        case: &Case,
        key: RunKey,
        name: &RunName,
    ) -> Result<CompositeRun, StudyError> {
        let run = match self.log.find(&key) {
            // The same settings may answer to several names.
            Some(found) => CompositeRun {
                preset: name.preset.to_owned(),
                key: name.key.to_owned(),
                variant: name.words.to_owned(),
                changes: name.changes.clone(),
                ..found.clone()
            },
            None => {
                let (found, last) = run(case, &key, name, self.stop)?;
                if let (PRESET, Some(last)) = (name.key, last) {
                    self.keep_pictures(case, name.preset, &last)?;
                }
                self.log.push(key, found.clone())?;
                found
            }
        };
        self.runs.push(run.clone());
        Ok(run)
    }

    fn keep_pictures(&self, case: &Case, preset: &str, last: &LastFrame) -> Result<(), StudyError> {
        let depth = if case.sensor_noise { "-kinect" } else { "" };
        pictures::write(&self.pictures.join(format!("{}{depth}", case.name)), preset, last)
    }
}

fn write(out: &Path, study: &CompositeStudy) -> Result<(), StudyError> {
    let file =
        |name: &str, text: String| atomic_write(&out.join(name), |w| w.write_all(text.as_bytes()));
    let json = serde_json::to_string_pretty(study).expect("a study is plain data");
    file("study.json", json + "\n")?;
    file("runs.csv", tables::csv(study))?;
    file("summary.md", tables::summary(study))?;
    Ok(())
}
