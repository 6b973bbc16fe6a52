//! `kinlight tradeoff`.

use super::args::{FrameRange, ReadingArgs, parse_frames};
use super::{CliError, Talk, interrupt, objects, setup};
use clap::{Args, ValueEnum};
use kinlight::budget::Profile;
use kinlight::study::StudyError;
use kinlight::study::composite::TruthFolder;
use kinlight::study::tradeoff::{ErrorKind, Sweep, plan};
use serde_json::json;
use std::path::PathBuf;

/// Sweep settings, mark the Pareto front of time and error, keep it as this machine's profile.
///
/// Run it on an idle machine: times are medians over frames after a warm-up, on a fixed number of
/// threads. The profile is what `--budget` chooses from.
#[derive(Debug, Args)]
pub struct TradeoffArgs {
    /// Folders of recordings; times and errors are means over them.
    #[arg(default_value = "sequences/demo")]
    pub sequences: Vec<PathBuf>,
    #[command(flatten)]
    pub reading: ReadingArgs,
    /// A sixth of the settings: subsampling, few directions, samples; no neighbours of the front.
    #[arg(long)]
    pub quick: bool,
    /// Frames to process, counted from 0; B is not included.
    #[arg(long, value_name = "A..B", value_parser = parse_frames, default_value = "0..22")]
    pub frames: FrameRange,
    /// Frames at the start that are neither timed nor judged.
    #[arg(long, default_value_t = 10)]
    pub warm_up: usize,
    /// Run everything so often, in rounds.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..))]
    pub repeat: u16,
    /// Error of the front [default: the first that can be measured].
    #[arg(long, value_enum)]
    pub error: Option<ErrorArg>,
    /// Where the profile goes [default: $XDG_CONFIG_HOME/kinlight/profile-cpu.toml, ~/.config without it].
    #[arg(long, value_name = "FILE.toml")]
    pub profile: Option<PathBuf>,
    /// Worker threads; 0 takes one a core.
    #[arg(long, default_value_t = 0)]
    pub threads: usize,
    /// Folder for everything that is written.
    #[arg(long, default_value = "out/study/tradeoff")]
    pub out: PathBuf,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum ErrorArg {
    /// Relative RMSE of the composed change of light against composite/.
    Composite,
    /// Relative L2 of the transfer against traced transfer.
    Transfer,
    /// Relative L2 of the light against light.json.
    Light,
}

pub fn run(args: &TradeoffArgs, talk: Talk) -> Result<(), CliError> {
    setup::start_threads(args.threads)?;
    let mut capture = setup::capture_options(&args.reading);
    (capture.first_frame, capture.end_frame) = (args.frames.first, args.frames.end);
    let bar = talk.progress(0);
    let stop = interrupt::stop_on_interrupt()?;
    let sweep = Sweep {
        sequences: args.sequences.clone(),
        capture,
        warm_up: args.warm_up,
        repeat: usize::from(args.repeat),
        error: args.error.map(ErrorArg::kind),
        scene: &|path, source| {
            if path.join("virtual.json").exists() {
                return TruthFolder::open(path)?.scene();
            }
            objects::of_sequence(path, source, args.frames.first, 0.0, 1.0)
                .map_err(|e| StudyError::Options(e.to_string()))
        },
        stop: &stop,
        progress: &|done, all, name| {
            bar.set_length(all as u64);
            bar.set_position(done as u64);
            bar.set_message(name.to_owned());
        },
    };
    let command = std::env::args().collect::<Vec<_>>().join(" ");
    let variants = plan(args.quick)?;
    let swept = sweep.run(variants, !args.quick, command);
    bar.finish_and_clear();
    let (study, kind) = swept?;

    let write_error = |e: kinlight::output::OutputError| CliError::Output(e.to_string());
    study.write(&args.out, kind).map_err(write_error)?;
    let profile = Profile::of(&study, kind).expect("the front has points");
    let place = match &args.profile {
        Some(path) => path.clone(),
        None => Profile::default_path(&study.machine.backend)
            .map_err(|e| CliError::Output(format!("{e}; name one with --profile")))?,
    };
    profile.write(&place).map_err(write_error)?;
    talk.say(study.summary(kind));
    talk.say(format_args!("written to {}; profile: {}", args.out.display(), place.display()));
    talk.result(&json!({
        "out": args.out,
        "profile": place,
        "error": kind,
        "points": study.points.len(),
        "front": study.front(),
    }));
    Ok(())
}

impl ErrorArg {
    fn kind(self) -> ErrorKind {
        match self {
            Self::Composite => ErrorKind::Composite,
            Self::Transfer => ErrorKind::Transfer,
            Self::Light => ErrorKind::Light,
        }
    }
}
