//! `kinlight study estimator`.

use super::{CliError, Talk, interrupt, setup};
use clap::Args;
use kinlight::study::light::LightPlan;
use kinlight::study::{SequenceStore, estimator};
use serde_json::json;
use std::path::PathBuf;

/// Gain of each step of the light estimator, on scenes it was and was not chosen on.
#[derive(Debug, Args)]
pub struct EstimatorStudyArgs {
    /// Folder for everything that is written.
    #[arg(long, default_value = "out/study/estimator")]
    pub out: PathBuf,
    /// Folder of the made sequences, those of `study light`; they are made once.
    #[arg(long, value_name = "DIR", default_value = "out/study/light/sequences")]
    pub sequences: PathBuf,
    /// Settings of everything but the light.
    #[arg(long, default_value = "ours-fast")]
    pub preset: String,
    /// Worker threads; 0 takes one a core.
    #[arg(long, default_value_t = 0)]
    pub threads: usize,
}

pub fn run(args: &EstimatorStudyArgs, talk: Talk) -> Result<(), CliError> {
    if log::max_level() == log::LevelFilter::Info {
        log::set_max_level(log::LevelFilter::Warn);
    }
    setup::start_threads(args.threads)?;
    let plan = LightPlan { presets: vec![args.preset.clone()], ..LightPlan::default() };
    let store = SequenceStore::new(&args.sequences);
    let command = std::env::args().collect::<Vec<_>>().join(" ");
    let bar = talk.progress(0);
    let stop = interrupt::stop_on_interrupt()?;
    let study = estimator::run(&plan, &command, &store, &stop, &|done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
    });
    bar.finish_and_clear();
    let study = study?;
    estimator::write(&study, &args.out)?;
    talk.say(estimator::summary(&study));
    talk.say(format_args!("written to {}", args.out.display()));
    talk.result(&json!({ "out": args.out, "runs": study.runs }));
    Ok(())
}
