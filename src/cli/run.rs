//! One pass of the pipeline over a source, whatever it is.

use super::args::{Buffer, ComputeArgs, Output};
use super::backend::Device;
use super::{CliError, Talk, pictures, setup};
use kinlight::budget::{BudgetSummary, Governor};
use kinlight::capture::FrameSource;
use kinlight::config::Settings;
use kinlight::eval::light::LightTruth;
use kinlight::output::{BufferPicture, OutputPlan, RunWriter, TimingSummary, stage_table};
use kinlight::pipeline::FrameOutcome;
use kinlight::replay::{ReplaySummary, replay};
use kinlight::report::RunRecord;
use kinlight::scene::VirtualScene;
use kinlight::stop::Stop;
use serde_json::json;
use std::path::Path;

/// How settings are chosen: once, or from frame to frame.
pub enum Pace<'a> {
    Preset(&'a str, Box<Settings>),
    Budget(Governor),
}

impl<'a> Pace<'a> {
    /// By the budget, where there is one.
    pub fn choose(
        preset: &'a str,
        compute: &ComputeArgs,
        device: &Device,
    ) -> Result<Self, CliError> {
        Ok(match setup::governor(compute, device)? {
            Some(governor) => Pace::Budget(governor),
            None => Pace::Preset(preset, setup::settings(preset, &compute.changes)?.into()),
        })
    }

    /// Of the run.
    pub fn name(&self) -> &str {
        match self {
            Pace::Preset(name, _) => name,
            Pace::Budget(_) => "budget",
        }
    }
}

/// All but what is left out, and no video.
pub fn plan(without: &[Output]) -> OutputPlan {
    let leave_out = |output| without.contains(&output);
    OutputPlan {
        frames: !leave_out(Output::Frames),
        light: !leave_out(Output::Light),
        environment: !leave_out(Output::Environment),
        trajectory: !leave_out(Output::Trajectory),
        mesh: !leave_out(Output::Mesh),
        timings: !leave_out(Output::Timings),
        video: false,
    }
}

/// What is computed, and where it goes.
pub struct Run<'a> {
    pub pace: Pace<'a>,
    pub plan: OutputPlan,
    pub dump: &'a [Buffer],
    pub out: &'a Path,
    pub device: &'a Device,
    /// Frames left out of the timing statistics.
    pub warm_up: usize,
    pub stop: &'a Stop,
}

/// What it is computed from.
pub struct Input<'a> {
    pub source: &'a mut dyn FrameSource,
    /// Of the recording or device, for the record.
    pub name: &'a Path,
    pub scene: VirtualScene,
    pub truth: Option<&'a LightTruth>,
}

/// What it came to.
pub struct Done {
    pub name: String,
    pub summary: ReplaySummary,
    pub timings: TimingSummary,
    pub budget: Option<BudgetSummary>,
}

impl Run<'_> {
    pub fn go(
        self,
        input: Input,
        on_frame: &mut dyn FnMut(&FrameOutcome),
    ) -> Result<Done, CliError> {
        let name = self.pace.name().to_owned();
        let (setting, settings, mut governor) = match self.pace {
            Pace::Preset(name, settings) => (name.to_owned(), *settings, None),
            Pace::Budget(governor) => {
                (governor.rung().name.clone(), governor.rung().settings.clone(), Some(governor))
            }
        };
        let mut pipeline = self.device.pipeline(settings, input.source.camera(), input.scene)?;
        let buffers = self.dump.iter().map(|&buffer| {
            let picture: BufferPicture = Box::new(move |p| pictures::of(buffer, p));
            (pictures::folder(buffer), picture)
        });
        let buffers = buffers.collect();
        let mut writer =
            RunWriter::create(self.out, self.plan, &*pipeline, buffers, self.warm_up, &setting)
                .map_err(|e| CliError::Output(e.to_string()))?;
        let summary = replay(
            input.source,
            &mut *pipeline,
            &mut writer,
            governor.as_mut(),
            input.truth,
            self.stop,
            on_frame,
        )?;
        let on_cpu_because = self.device.on_cpu_because().map(str::to_owned);
        let record = RunRecord::here(&name, input.name, pipeline.record());
        RunRecord { on_cpu_because, ..record }
            .write(self.out)
            .map_err(|e| CliError::Output(e.to_string()))?;
        Ok(Done {
            name,
            summary,
            timings: writer.timing_summary().expect("a run without frames is an error"),
            budget: governor.map(|g| g.summary()),
        })
    }
}

impl Done {
    /// For people, and as JSON.
    pub fn tell(&self, out: &Path, talk: Talk) {
        talk.say(stage_table(&[(&self.name, &self.timings)]));
        talk.say(&self.summary);
        if let Some(budget) = &self.budget {
            talk.say(budget);
        }
        talk.say(format_args!("written to {}", out.display()));
        let mut result = json!(self.summary);
        result["out"] = json!(out);
        result["timings"] = json!(self.timings);
        result["budget"] = json!(self.budget);
        talk.result(&result);
    }

    /// # Errors
    /// The run was interrupted; its result is told.
    pub fn whole(&self, out: &Path) -> Result<(), CliError> {
        if !self.summary.interrupted {
            return Ok(());
        }
        let (frames, out) = (self.summary.frames, out.display());
        let problem = format!("interrupted after {frames} frames, whose results are in {out}");
        Err(CliError::Interrupted { problem, has_result: true })
    }
}
