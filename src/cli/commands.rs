//! One function a command.

use super::args::{
    CompareArgs, CompareOutput, InfoArgs, Output, ReplayArgs, SourceArgs, SynthArgs,
};
use super::backend::Device;
use super::run::{Done, Input, Pace, Run};
use super::{CliError, Talk, interrupt, objects, report, run, setup};
use kinlight::capture::{FrameSource, inspect};
use kinlight::eval::light::LightTruth;
use kinlight::output::{OutputPlan, stage_table};
use kinlight::pipeline::FrameOutcome;
use kinlight::synth::SynthError;
use serde_json::json;
use std::path::Path;

pub fn replay(args: &ReplayArgs, talk: Talk) -> Result<(), CliError> {
    setup::start_threads(args.run.compute.threads)?;
    let plan = OutputPlan { video: args.video, ..run::plan(&args.without) };
    let compute = &args.run.compute;
    let device = Device::choose(compute)?;
    let pace = Pace::choose(&args.preset, compute, &device)?;
    let (dump, warm_up) = (&args.dump, compute.warm_up);
    let stop = interrupt::stop_on_interrupt()?;
    let run = Run { pace, plan, dump, out: &compute.out, device: &device, warm_up, stop: &stop };
    let done = over_sequence(run, &args.run.source, talk)?;
    if !args.without.contains(&Output::Report) {
        report::write_page(&compute.out)?;
    }
    done.tell(&compute.out, talk);
    done.whole(&compute.out)
}

pub fn compare(args: &CompareArgs, talk: Talk) -> Result<(), CliError> {
    if args.presets.len() + usize::from(args.run.compute.budget.is_some()) < 2 {
        return Err(CliError::Usage(
            "--presets needs at least two names, or one and --budget".into(),
        ));
    }
    setup::start_threads(args.run.compute.threads)?;
    let mut paces = Vec::new();
    for name in &args.presets {
        paces.push(Pace::Preset(name, setup::settings(name, &args.run.compute.changes)?.into()));
    }
    let device = Device::choose(&args.run.compute)?;
    paces.extend(setup::governor(&args.run.compute, &device)?.map(Pace::Budget));
    let stop = interrupt::stop_on_interrupt()?;
    let (wanted, mut done) = (paces.len(), Vec::<Done>::new());
    for pace in paces {
        if stop.is_asked() && !done.is_empty() {
            break;
        }
        let plan = OutputPlan { frames: args.frames_out, timings: true, ..OutputPlan::NOTHING };
        let out = args.run.compute.out.join(pace.name());
        let warm_up = args.run.compute.warm_up;
        let run = Run { pace, plan, dump: &[], out: &out, device: &device, warm_up, stop: &stop };
        match over_sequence(run, &args.run.source, talk) {
            Err(CliError::Interrupted { .. }) if !done.is_empty() => break,
            result => done.push(result?),
        }
    }
    if !args.without.contains(&CompareOutput::Report) {
        report::write_page(&args.run.compute.out)?;
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
    if stop.is_asked() {
        let runs = done.iter().filter(|run| !run.summary.interrupted).count();
        let problem = format!("interrupted after {runs} of {wanted} runs");
        return Err(CliError::Interrupted { problem, has_result: true });
    }
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
    let stop = interrupt::stop_on_interrupt()?;
    let made = kinlight::synth::generate_until(&stop, &options, &args.out, &|done, total| {
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    });
    bar.finish_and_clear();
    made.map_err(|error| match error {
        SynthError::Stopped(_) => CliError::Interrupted {
            problem: format!("{error}: {} holds the frames until then", args.out.display()),
            has_result: false,
        },
        other => CliError::Output(other.to_string()),
    })?;
    talk.say(format_args!("{} written", args.out.display()));
    talk.result(&json!({ "out": args.out, "frames": options.frames }));
    Ok(())
}

/// With a bar that fills.
fn over_sequence(run: Run, args: &SourceArgs, talk: Talk) -> Result<Done, CliError> {
    let mut source = setup::open(args)?;
    let truth = light_truth(&args.sequence)?;
    let first = args.frames.map_or(0, |frames| frames.first);
    let scene = objects::scene(&args.object, Some(&args.sequence), first, &source)?;
    let bar = talk.progress(source.len().unwrap_or(0));
    bar.set_prefix(run.pace.name().to_owned());
    let done = run.go(
        Input { source: &mut source, name: &args.sequence, scene, truth: truth.as_ref() },
        &mut |frame: &FrameOutcome| {
            bar.set_message(format!("{:?}", frame.tracking.state));
            bar.inc(1);
        },
    );
    bar.finish_and_clear();
    done
}

pub fn light_truth(sequence: &Path) -> Result<Option<LightTruth>, CliError> {
    let path = sequence.join("light.json");
    if !path.exists() {
        return Ok(None);
    }
    LightTruth::read(&path).map(Some).map_err(|e| CliError::Sequence(e.to_string()))
}
