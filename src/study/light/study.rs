//! Making the sequences and running every method on them.

use super::log::RunLog;
use super::measure::{Outcome, outcome};
use super::observe::{Observation, observe};
use super::outlook::Outlook;
use super::plan::{Job, LightPlan};
use super::record::LightStudy;
use super::reference::observe_probe;
use crate::eval::light::LightTruth;
use crate::stop::Stop;
use crate::study::{Machine, SequenceStore, StudyError};
use std::cell::RefCell;
use std::collections::HashSet;
use std::path::Path;

/// Finished runs, in the study's folder.
pub const LOG_FILE: &str = "runs.jsonl";

/// The kind of work that making sequences is.
const MAKING: &str = "sequences";

/// How far a study is.
#[derive(Clone, Debug)]
pub struct Progress<'a> {
    pub doing: &'a str,
    /// Of all work, 0 to 1.
    pub share: f64,
    /// A guess until each method has run once.
    pub left_s: f64,
}

/// Runs what is not in `out/runs.jsonl` yet, and keeps it there. `command` is only noted down.
///
/// # Errors
/// A plan out of range, a folder that cannot be written, [`StudyError::Stopped`] once `stop` is asked, and what sequences and runs may fail with.
pub fn run(
    plan: &LightPlan,
    command: &str,
    store: &SequenceStore,
    out: &Path,
    stop: &Stop,
    progress: &dyn Fn(&Progress),
) -> Result<LightStudy, StudyError> {
    plan.check()?;
    let methods = plan.methods()?;
    let jobs = plan.jobs(&methods);
    let mut session = Session {
        warm_up: plan.warm_up,
        store,
        log: RunLog::open(&out.join(LOG_FILE))?,
        outlook: RefCell::new(Outlook::new(plan.width * plan.height)),
        stop,
        progress,
    };
    session.expect(&jobs)?;
    let mut study = LightStudy {
        machine: Machine::here(),
        command: command.to_owned(),
        scenes: plan.scenes.clone(),
        methods: methods.iter().map(|m| m.name.clone()).collect(),
        frames_per_run: plan.frames,
        warm_up: plan.warm_up,
        runs: Vec::new(),
        steps: Vec::new(),
        jitter: Vec::new(),
    };
    for job in &jobs {
        match session.result(job)? {
            Outcome::Run(run) => study.runs.push(run),
            Outcome::Step(step) => study.steps.push(step),
            Outcome::Jitter(jitter) => study.jitter.push(jitter),
        }
    }
    Ok(study)
}

struct Session<'a> {
    warm_up: usize,
    store: &'a SequenceStore,
    log: RunLog,
    outlook: RefCell<Outlook>,
    stop: &'a Stop,
    progress: &'a dyn Fn(&Progress),
}

impl Session<'_> {
    /// Counts the work that is to be done.
    fn expect(&self, jobs: &[Job]) -> Result<(), StudyError> {
        let mut sequences = HashSet::new();
        for job in jobs {
            if self.log.get(&RunLog::key(job, self.warm_up)?).is_some() {
                continue;
            }
            let mut outlook = self.outlook.borrow_mut();
            outlook.expect(&job.method.name, self.frames(job));
            let first = sequences.insert(&job.sequence);
            if first && !self.store.has(&job.sequence, &job.options) {
                outlook.expect(MAKING, job.options.frames);
            }
        }
        self.tell("starting");
        Ok(())
    }

    /// Frames that a job looks at: light probes need no warm-up.
    fn frames(&self, job: &Job) -> usize {
        match job.method.probe {
            Some(_) => job.options.frames - self.warm_up,
            None => job.options.frames,
        }
    }

    fn result(&mut self, job: &Job) -> Result<Outcome, StudyError> {
        let key = RunLog::key(job, self.warm_up)?;
        if self.log.get(&key).is_none() {
            let result = self.work(job)?;
            self.log.push(&key, result)?;
        }
        Ok(self.log.get(&key).expect("it is there now").clone())
    }

    fn work(&self, job: &Job) -> Result<Outcome, StudyError> {
        self.outlook.borrow_mut().start();
        let sequence = self.store.get(&job.sequence, &job.options, self.stop, &|_, _| {
            self.outlook.borrow_mut().tick(MAKING);
            self.tell(&format!("making {}", job.sequence));
        })?;
        let truth = LightTruth::read(&sequence.join("light.json"))?;
        let method = job.method;
        let depth = if job.sensor_noise { "Kinect depth" } else { "exact depth" };
        let doing = format!("{} on {}, {depth}", method.name, job.sequence);
        let tick = || {
            self.outlook.borrow_mut().tick(&method.name);
            self.tell(&doing);
        };
        let seen: Vec<Observation> = match method.probe {
            Some(probe) => {
                let frames = self.warm_up..job.options.frames;
                observe_probe(probe, &job.options, &method.settings, frames, self.stop, &tick)?
            }
            None => {
                let (settings, at) = (&method.settings, truth.center);
                let seen = observe(&sequence, job.sensor_noise, settings, at, self.stop, &tick)?;
                seen.into_iter().filter(|s| s.frame >= self.warm_up).collect()
            }
        };
        outcome(job, &seen, &truth)
    }

    fn tell(&self, doing: &str) {
        let outlook = self.outlook.borrow();
        (self.progress)(&Progress { doing, share: outlook.share(), left_s: outlook.left_s() });
    }
}
