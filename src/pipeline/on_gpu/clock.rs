//! What each stage takes.

use crate::gpu::{Commands, Gpu, GpuError, StageTimer};
use crate::timing::{Stage, StageTimes};
use std::time::Instant;

/// The device's own clock for what is recorded and the host's for what the host does; on a device without
/// timestamps the host's for both, which then waits for the device after each stage.
pub struct StageClock {
    timer: Option<StageTimer>,
    since: Instant,
}

impl StageClock {
    /// The host's for software devices, too: the timestamps of Mesa's are taken when draws are flushed and
    /// not when compute passes run.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        match gpu.summary().is_software() {
            true => Ok(Self::with(None)),
            false => Ok(Self::with(StageTimer::new(gpu)?)),
        }
    }

    pub(super) fn with(timer: Option<StageTimer>) -> Self {
        Self { timer, since: Instant::now() }
    }

    pub fn name(&self) -> &'static str {
        match self.timer {
            Some(_) => "device timestamps, host for tracking and light",
            None => "host, waiting for the device",
        }
    }

    /// A frame starts.
    pub fn start(&mut self) {
        self.since = Instant::now();
    }

    pub fn begin<'g>(&self, gpu: &'g Gpu) -> Commands<'g> {
        gpu.commands().timed(self.timer.as_ref())
    }

    /// What was recorded since the stage before is this stage.
    pub fn end_stage(
        &mut self,
        commands: &mut Commands<'_>,
        stage: Stage,
        times: &mut StageTimes,
    ) -> Result<(), GpuError> {
        if self.timer.is_some() {
            return Ok(());
        }
        let gpu = commands.gpu();
        let recorded = std::mem::replace(commands, gpu.commands());
        recorded.submit()?;
        gpu.wait()?;
        self.add_elapsed(stage, times);
        Ok(())
    }

    /// Submits, and waits for the device; `stage` is the last one.
    pub fn finish(
        &mut self,
        commands: Commands<'_>,
        stage: Stage,
        times: &mut StageTimes,
    ) -> Result<(), GpuError> {
        let gpu = commands.gpu();
        commands.submit_timed(self.timer.as_mut())?;
        gpu.wait()?;
        match &mut self.timer {
            None => self.add_elapsed(stage, times),
            Some(timer) => {
                let measured = timer.take(gpu)?.unwrap_or_default();
                Stage::ALL.into_iter().for_each(|stage| times.add(stage, measured.get(stage)));
            }
        }
        Ok(())
    }

    /// Work of the host that belongs to a stage.
    pub fn on_host<T>(
        &mut self,
        stage: Stage,
        times: &mut StageTimes,
        work: impl FnOnce() -> T,
    ) -> T {
        if self.timer.is_some() {
            return times.measure(stage, work);
        }
        let result = work();
        self.add_elapsed(stage, times);
        result
    }

    fn add_elapsed(&mut self, stage: Stage, times: &mut StageTimes) {
        times.add(stage, self.since.elapsed());
        self.since = Instant::now();
    }
}
