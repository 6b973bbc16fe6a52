//! One function a command.

use super::args::{
    Buffer, CompareArgs, CompareOutput, InfoArgs, Output, ReplayArgs, RunArgs, SynthArgs,
};
use super::backend::Device;
use super::{CliError, Talk, objects, pictures, report, setup};
use kinlight::budget::{BudgetSummary, Governor};
use kinlight::capture::{FrameSource, inspect};
use kinlight::config::Settings;
use kinlight::eval::light::LightTruth;
use kinlight::output::{BufferPicture, OutputPlan, RunWriter, TimingSummary, stage_table};
use kinlight::pipeline::FrameOutcome;
use kinlight::replay::{ReplaySummary, replay as run_sequence};
use kinlight::report::RunRecord;
use serde_json::json;
use std::path::Path;

pub fn replay(args: &ReplayArgs, talk: Talk) -> Result<(), CliError> {
    setup::start_threads(args.run.threads)?;
    let leave_out = |output| args.without.contains(&output);
    let plan = OutputPlan {
        frames: !leave_out(Output::Frames),
        light: !leave_out(Output::Light),
        environment: !leave_out(Output::Environment),
        trajectory: !leave_out(Output::Trajectory),
        mesh: !leave_out(Output::Mesh),
        timings: !leave_out(Output::Timings),
        video: args.video,
    };
    let device = Device::choose(&args.run)?;
    let pace = match setup::governor(&args.run, &device)? {
        Some(governor) => Pace::Budget(governor),
        None => {
            Pace::Preset(&args.preset, setup::settings(&args.preset, &args.run.changes)?.into())
        }
    };
    let run = Run { pace, plan, dump: &args.dump, out: &args.run.out, device: &device };
    let done = run.go(&args.run, talk)?;
    if !leave_out(Output::Report) {
        report::write_page(&args.run.out)?;
    }
    talk.say(stage_table(&[(&done.name, &done.timings)]));
    talk.say(&done.summary);
    if let Some(budget) = &done.budget {
        talk.say(budget);
    }
    talk.say(format_args!("written to {}", args.run.out.display()));
    let mut result = json!(done.summary);
    result["out"] = json!(args.run.out);
    result["timings"] = json!(done.timings);
    result["budget"] = json!(done.budget);
    talk.result(&result);
    Ok(())
}

pub fn compare(args: &CompareArgs, talk: Talk) -> Result<(), CliError> {
    if args.presets.len() + usize::from(args.run.budget.is_some()) < 2 {
        return Err(CliError::Usage(
            "--presets needs at least two names, or one and --budget".into(),
        ));
    }
    setup::start_threads(args.run.threads)?;
    let mut paces = Vec::new();
    for name in &args.presets {
        paces.push(Pace::Preset(name, setup::settings(name, &args.run.changes)?.into()));
    }
    let device = Device::choose(&args.run)?;
    paces.extend(setup::governor(&args.run, &device)?.map(Pace::Budget));
    let mut done = Vec::new();
    for pace in paces {
        let plan = OutputPlan { frames: args.frames_out, timings: true, ..OutputPlan::NOTHING };
        let out = args.run.out.join(pace.name());
        let run = Run { pace, plan, dump: &[], out: &out, device: &device };
        done.push(run.go(&args.run, talk)?);
    }
    if !args.without.contains(&CompareOutput::Report) {
        report::write_page(&args.run.out)?;
    }
    let columns: Vec<_> = done.iter().map(|run| (run.name.as_str(), &run.timings)).collect();
    talk.say(stage_table(&columns));
    for run in &done {
        talk.say(format_args!("{}: {}", run.name, run.summary));
    }
    if let Some(budget) = done.iter().find_map(|run| run.budget.as_ref()) {
        talk.say(budget);
    }
    let results = done.iter().map(|run| {
        let mut result =
            json!({ "preset": run.name, "summary": run.summary, "timings": run.timings });
        if let Some(budget) = &run.budget {
            result["budget"] = json!(budget);
        }
        result
    });
    talk.result(&json!({ "presets": results.collect::<Vec<_>>() }));
    Ok(())
}

pub fn info(args: &InfoArgs, talk: Talk) -> Result<(), CliError> {
    let report = inspect(&args.sequence, &setup::capture_options(&args.reading))
        .map_err(|e| CliError::Sequence(e.to_string()))?;
    talk.say(&report);
    talk.result(&json!(report));
    Ok(())
}

pub fn synth(args: &SynthArgs, talk: Talk) -> Result<(), CliError> {
    let options = args.options();
    let bar = talk.progress(options.frames);
    bar.set_prefix(options.scene.clone());
    kinlight::synth::generate(&options, &args.out, &|done, total| {
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    })
    .map_err(|e| CliError::Output(e.to_string()))?;
    bar.finish_and_clear();
    talk.say(format_args!("{} written", args.out.display()));
    talk.result(&json!({ "out": args.out, "frames": options.frames }));
    Ok(())
}

/// How settings are chosen: once, or from frame to frame.
enum Pace<'a> {
    Preset(&'a str, Box<Settings>),
    Budget(Governor),
}

impl Pace<'_> {
    /// Of the run.
    fn name(&self) -> &str {
        match self {
            Pace::Preset(name, _) => name,
            Pace::Budget(_) => "budget",
        }
    }
}

/// One pass over a sequence.
struct Run<'a> {
    pace: Pace<'a>,
    plan: OutputPlan,
    dump: &'a [Buffer],
    out: &'a Path,
    device: &'a Device,
}

/// What it came to.
struct Done {
    name: String,
    summary: ReplaySummary,
    timings: TimingSummary,
    budget: Option<BudgetSummary>,
}

impl Run<'_> {
    fn go(self, args: &RunArgs, talk: Talk) -> Result<Done, CliError> {
        let mut source = setup::open(&args.source)?;
        let truth = light_truth(&args.source.sequence)?;
        let scene = objects::scene(&args.source, &source)?;
        let name = self.pace.name().to_owned();
        let (setting, settings, mut governor) = match self.pace {
            Pace::Preset(name, settings) => (name.to_owned(), *settings, None),
            Pace::Budget(governor) => {
                (governor.rung().name.clone(), governor.rung().settings.clone(), Some(governor))
            }
        };
        let mut pipeline = self.device.pipeline(settings, source.camera(), scene)?;
        let buffers = self.dump.iter().map(|&buffer| {
            let picture: BufferPicture = Box::new(move |p| pictures::of(buffer, p));
            (pictures::folder(buffer), picture)
        });
        let buffers = buffers.collect();
        let mut writer =
            RunWriter::create(self.out, self.plan, &*pipeline, buffers, args.warm_up, &setting)
                .map_err(|e| CliError::Output(e.to_string()))?;

        let bar = talk.progress(source.len().unwrap_or(0));
        bar.set_prefix(name.clone());
        let mut on_frame = |frame: &FrameOutcome| {
            bar.set_message(format!("{:?}", frame.tracking.state));
            bar.inc(1);
        };
        let summary = run_sequence(
            &mut source,
            &mut *pipeline,
            &mut writer,
            governor.as_mut(),
            truth.as_ref(),
            &mut on_frame,
        );
        bar.finish_and_clear();
        let summary = summary?;
        let on_cpu_because = self.device.on_cpu_because().map(str::to_owned);
        let record = RunRecord::here(&name, &args.source.sequence, pipeline.record());
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

fn light_truth(sequence: &Path) -> Result<Option<LightTruth>, CliError> {
    let path = sequence.join("light.json");
    if !path.exists() {
        return Ok(None);
    }
    LightTruth::read(&path).map(Some).map_err(|e| CliError::Sequence(e.to_string()))
}
