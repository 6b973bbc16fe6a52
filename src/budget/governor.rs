//! A controller in charge of a pipeline.

use super::{Controller, Ladder, Rung};
use crate::pipeline::{Backend, FrameOutcome, PipelineError};
use std::time::Duration;

/// Changes that are listed; all are counted.
const MOST_LISTED: usize = 1000;

/// Keeps a run within its budget, frame by frame.
#[derive(Debug)]
pub struct Governor {
    budget_ms: f64,
    ladder: Ladder,
    controller: Controller,
    frames: usize,
    within: usize,
    warned: bool,
    changes: usize,
    switches: Vec<Switch>,
}

/// A change of settings.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Switch {
    /// The first frame with the new settings is the one after this.
    pub after_frame: usize,
    pub from: String,
    pub to: String,
    /// Update time that led to it.
    pub median_ms: f64,
}

/// How a budget was kept.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct BudgetSummary {
    pub budget_ms: f64,
    pub started_with: String,
    pub ended_with: String,
    /// Composed frames, and how many of them took no longer than the budget.
    pub frames: usize,
    pub within: usize,
    /// How often the settings changed, and the first thousand times.
    pub changes: usize,
    pub switches: Vec<Switch>,
}

impl Governor {
    pub fn new(ladder: Ladder, budget: Duration) -> Self {
        let budget_ms = 1e3 * budget.as_secs_f64();
        let start = &ladder.rungs()[ladder.start()];
        log::info!(
            "budget {budget_ms:.1} ms: starting with '{}', predicted {:.1} ms, rung {} of {}",
            start.name,
            start.predicted_ms,
            ladder.start() + 1,
            ladder.rungs().len()
        );
        let predicted = ladder.rungs().iter().map(|r| r.predicted_ms).collect();
        // while the volume fills, all auxiliary buffers are redone
        let warm_up = start.settings.surface.warm_up_updates.min(30) as usize;
        Self {
            controller: Controller::new(budget_ms, predicted, ladder.start(), warm_up),
            budget_ms,
            ladder,
            frames: 0,
            within: 0,
            warned: false,
            changes: 0,
            switches: Vec::new(),
        }
    }

    /// The settings in use; at first those to start the pipeline with.
    pub fn rung(&self) -> &Rung {
        &self.ladder.rungs()[self.controller.rung()]
    }

    /// Takes in a frame's update time and changes the pipeline's settings where that is called for;
    /// gives the name of the new ones. Frames in which nothing was composed do not count.
    pub fn after_frame(
        &mut self,
        pipeline: &mut dyn Backend,
        outcome: &FrameOutcome,
    ) -> Result<Option<&str>, PipelineError> {
        if !outcome.composed {
            return Ok(None);
        }
        // stages of the GPU overlap
        let update = outcome.times.update().min(outcome.duration);
        let update_ms = 1e3 * update.as_secs_f64();
        self.frames += 1;
        self.within += usize::from(update_ms <= self.budget_ms);
        let Some(change) = self.controller.frame(update_ms) else {
            self.warn_once();
            return Ok(None);
        };
        let name = |rung: usize| self.ladder.rungs()[rung].name.clone();
        let switch = Switch {
            after_frame: outcome.index,
            from: name(change.from),
            to: name(change.to),
            median_ms: change.median_ms,
        };
        log::info!(
            "budget {:.1} ms: after frame {}, at {:.1} ms, from '{}' to '{}'",
            self.budget_ms,
            switch.after_frame,
            switch.median_ms,
            switch.from,
            switch.to
        );
        self.changes += 1;
        if self.switches.len() < MOST_LISTED {
            self.switches.push(switch);
        }
        pipeline.reconfigure(self.rung().settings.clone())?;
        Ok(Some(&self.rung().name))
    }

    pub fn summary(&self) -> BudgetSummary {
        let rungs = self.ladder.rungs();
        BudgetSummary {
            budget_ms: self.budget_ms,
            started_with: rungs[self.ladder.start()].name.clone(),
            ended_with: self.rung().name.clone(),
            frames: self.frames,
            within: self.within,
            changes: self.changes,
            switches: self.switches.clone(),
        }
    }

    fn warn_once(&mut self) {
        if !self.warned && self.controller.exhausted() {
            self.warned = true;
            log::warn!(
                "budget {:.1} ms: even the fastest settings, '{}', take longer here",
                self.budget_ms,
                self.rung().name
            );
        }
    }
}

impl std::fmt::Display for BudgetSummary {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "budget {:.1} ms: {} of {} frames within it, {} changes of settings, ended with '{}'",
            self.budget_ms, self.within, self.frames, self.changes, self.ended_with
        )
    }
}
