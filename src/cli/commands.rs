//! One function a command.

use super::args::{
    Buffer, CompareArgs, CompareOutput, InfoArgs, Output, ReplayArgs, RunArgs, SynthArgs,
};
use super::{CliError, Talk, objects, pictures, report, setup};
use kinlight::capture::{FrameSource, inspect};
use kinlight::config::Settings;
use kinlight::eval::light::LightTruth;
use kinlight::output::{BufferPicture, OutputPlan, RunWriter, TimingSummary, stage_table};
use kinlight::pipeline::Pipeline;
use kinlight::replay::{ReplayError, ReplaySummary, replay as run_sequence};
use kinlight::report::RunRecord;
use serde_json::json;
use std::path::Path;

pub fn replay(args: &ReplayArgs, talk: Talk) -> Result<(), CliError> {
    let settings = setup::settings(&args.preset, &args.run)?;
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
    let run = Run { name: &args.preset, settings, plan, dump: &args.dump, out: &args.run.out };
    let (summary, timings) = run.go(&args.run, talk)?;
    if !leave_out(Output::Report) {
        report::write_page(&args.run.out)?;
    }
    talk.say(stage_table(&[(&args.preset, &timings)]));
    talk.say(&summary);
    talk.say(format_args!("written to {}", args.run.out.display()));
    let mut result = json!(summary);
    result["out"] = json!(args.run.out);
    result["timings"] = json!(timings);
    talk.result(&result);
    Ok(())
}

pub fn compare(args: &CompareArgs, talk: Talk) -> Result<(), CliError> {
    if args.presets.len() < 2 {
        return Err(CliError::Usage("--presets needs at least two names".into()));
    }
    setup::start_threads(args.run.threads)?;
    let mut done = Vec::new();
    for name in &args.presets {
        let settings = setup::settings(name, &args.run)?;
        let plan = OutputPlan { frames: args.frames_out, timings: true, ..OutputPlan::NOTHING };
        let out = args.run.out.join(name);
        let run = Run { name, settings, plan, dump: &[], out: &out };
        done.push((name.as_str(), run.go(&args.run, talk)?));
    }
    if !args.without.contains(&CompareOutput::Report) {
        report::write_page(&args.run.out)?;
    }
    let columns: Vec<_> = done.iter().map(|(name, (_, timings))| (*name, timings)).collect();
    talk.say(stage_table(&columns));
    for (name, (summary, _)) in &done {
        talk.say(format_args!("{name}: {summary}"));
    }
    let results = done.iter().map(|(name, (summary, timings))| {
        json!({ "preset": name, "summary": summary, "timings": timings })
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

/// One pass over a sequence with one preset.
struct Run<'a> {
    name: &'a str,
    settings: Settings,
    plan: OutputPlan,
    dump: &'a [Buffer],
    out: &'a Path,
}

impl Run<'_> {
    fn go(self, args: &RunArgs, talk: Talk) -> Result<(ReplaySummary, TimingSummary), CliError> {
        let mut source = setup::open(args)?;
        let truth = light_truth(&args.sequence)?;
        let scene = objects::scene(args, &source)?;
        let mut pipeline = Pipeline::new(self.settings, source.camera(), scene)
            .map_err(|e| CliError::Run(e.to_string()))?;
        let buffers = self.dump.iter().map(|&buffer| {
            let picture: BufferPicture = Box::new(move |p| pictures::of(buffer, p));
            (pictures::folder(buffer), picture)
        });
        let mut writer =
            RunWriter::create(self.out, self.plan, &pipeline, buffers.collect(), args.warm_up)
                .map_err(|e| CliError::Output(e.to_string()))?;

        let bar = talk.progress(source.len().unwrap_or(0));
        bar.set_prefix(self.name.to_owned());
        let summary =
            run_sequence(&mut source, &mut pipeline, &mut writer, truth.as_ref(), &mut |frame| {
                bar.set_message(format!("{:?}", frame.tracking.state));
                bar.inc(1);
            });
        bar.finish_and_clear();
        let summary = summary.map_err(by_kind)?;
        RunRecord::here(self.name, &args.sequence)
            .write(self.out)
            .map_err(|e| CliError::Output(e.to_string()))?;
        let timings = writer.timing_summary().expect("a run without frames is an error");
        Ok((summary, timings))
    }
}

fn light_truth(sequence: &Path) -> Result<Option<LightTruth>, CliError> {
    let path = sequence.join("light.json");
    if !path.exists() {
        return Ok(None);
    }
    LightTruth::read(&path).map(Some).map_err(|e| CliError::Sequence(e.to_string()))
}

fn by_kind(error: ReplayError) -> CliError {
    match error {
        ReplayError::Capture(e) => CliError::Sequence(e.to_string()),
        ReplayError::NoFrames(_) => CliError::Sequence(error.to_string()),
        ReplayError::Output(e) => CliError::Output(e.to_string()),
        ReplayError::Pipeline(e) => CliError::Run(e.to_string()),
    }
}
