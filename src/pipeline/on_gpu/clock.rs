//! What each stage takes.

use crate::gpu::{Commands, Gpu, GpuError, StageTimer};
use crate::timing::{Stage, StageTimes};
use std::time::{Duration, Instant};
use wgpu::SubmissionIndex;

/// The device's own clock for what is recorded and the host's for what the host does; on a device without
/// timestamps the host's for both, which then waits for the device after each stage. With the device's
/// clock nothing waits but who needs a result; as stages then overlap, their sum may exceed the frame.
pub struct StageClock {
    timer: Option<StageTimer>,
    since: Instant,
    /// Of this frame, on the host.
    tracking: Duration,
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
        Self { timer, since: Instant::now(), tracking: Duration::ZERO }
    }

    pub fn name(&self) -> &'static str {
        match self.timer {
            Some(_) => "device timestamps, host for tracking and light",
            None => "host, waiting for the device",
        }
    }

    /// A frame starts; all of its commands are recorded here.
    pub fn start<'g>(&mut self, gpu: &'g Gpu) -> Commands<'g> {
        self.since = Instant::now();
        self.tracking = Duration::ZERO;
        gpu.commands().timed(self.timer.as_ref())
    }

    /// What was recorded since the stage before is this stage.
    pub fn end_stage(
        &mut self,
        commands: &mut Commands<'_>,
        stage: Stage,
        times: &mut StageTimes,
    ) -> Result<(), GpuError> {
        if self.timer.is_none() {
            commands.flush()?;
            commands.gpu().wait()?;
            self.add_elapsed(stage, times);
        }
        Ok(())
    }

    /// As [`Self::end_stage`]; where that does not wait, the device has the commands and the result is what
    /// [`Self::wait_for`] wants.
    pub fn submit_stage(
        &mut self,
        commands: &mut Commands<'_>,
        stage: Stage,
        times: &mut StageTimes,
    ) -> Result<Option<SubmissionIndex>, GpuError> {
        if self.timer.is_some() {
            return commands.flush().map(Some);
        }
        self.end_stage(commands, stage, times)?;
        Ok(None)
    }

    /// Until the device is done with a submission. What is waited for is in the times of its passes.
    pub fn wait_for(&self, gpu: &Gpu, submission: Option<SubmissionIndex>) -> Result<(), GpuError> {
        submission.map_or(Ok(()), |submission| gpu.wait_for(submission))
    }

    /// Submits the frame's last commands, and waits for the device; `stage` is the last one.
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
                let waiting_for_input = measured.get(Stage::Input);
                times.add(Stage::Reconstruct, self.tracking.saturating_sub(waiting_for_input));
            }
        }
        Ok(())
    }

    /// Host and device in turn, from the device's Input stage to the camera's pose.
    pub fn tracking<T>(
        &mut self,
        commands: &mut Commands<'_>,
        times: &mut StageTimes,
        work: impl FnOnce(&mut Commands<'_>) -> T,
    ) -> T {
        if self.timer.is_none() {
            return self.on_host(Stage::Reconstruct, times, || work(commands));
        }
        let start = Instant::now();
        commands.measure(false);
        let result = work(commands);
        commands.measure(true);
        self.tracking = start.elapsed();
        result
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
