//! `kinlight study composite`.

use super::study_light::to_be_continued;
use super::{CliError, Talk, args, interrupt, setup};
use clap::Args;
use kinlight::study::composite::{
    CompositeOptions, MadeOptions, run_study, summary, usual_folders,
};
use std::path::PathBuf;

/// Composed frames against path-traced truth, for each choice the program leaves open.
#[derive(Debug, Args)]
pub struct CompositeStudyArgs {
    /// Folder for everything that is written. Finished runs found there are not run again.
    #[arg(long, default_value = "out/study/composite")]
    pub out: PathBuf,
    #[arg(long, value_delimiter = ',', default_value = "ours-fast,ours")]
    pub presets: Vec<String>,
    /// "all", "presets" (none), or names of variants.
    #[arg(long, value_delimiter = ',', default_value = "all")]
    pub variants: Vec<String>,
    /// Sequence with composite/ and virtual.json (may be repeated); without, those that are at hand.
    #[arg(long, value_name = "DIR")]
    pub sequence: Vec<PathBuf>,
    /// Make no sequences.
    #[arg(long)]
    pub no_made: bool,
    /// Frames of made sequences; the last is measured.
    #[arg(long = "frames", id = "composite_frames", default_value_t = 11)]
    pub frames: usize,
    /// How many frames with truth are measured in a sequence; it is run up to the last of them.
    #[arg(long, default_value_t = 1)]
    pub measured: usize,
    /// Width and height of made sequences.
    #[arg(long, value_name = "W,H", value_parser = args::parse_size, default_value = "320,240")]
    pub size: (usize, usize),
    /// Light paths a pixel of made sequences.
    #[arg(long, default_value_t = 32)]
    pub samples: u32,
    /// Forget the runs that are finished.
    #[arg(long)]
    pub anew: bool,
    /// Worker threads; 0 takes one a core.
    #[arg(long, default_value_t = 0)]
    pub threads: usize,
}

pub fn run(args: &CompositeStudyArgs, talk: Talk) -> Result<(), CliError> {
    setup::start_threads(args.threads)?;
    let made = MadeOptions { frames: args.frames, size: args.size, samples: args.samples };
    let given = !args.sequence.is_empty();
    let options = CompositeOptions {
        out: args.out.clone(),
        presets: args.presets.clone(),
        variants: args.variants.clone(),
        made: (!args.no_made).then_some(made),
        folders: if given { args.sequence.clone() } else { usual_folders() },
        measured: args.measured,
        anew: args.anew,
        command: std::env::args().collect::<Vec<_>>().join(" "),
        stop: interrupt::stop_on_interrupt()?,
    };
    let bar = talk.progress(0);
    let study = run_study(&options, &|what, done, all| {
        bar.set_prefix(what.to_owned());
        bar.set_length(all as u64);
        bar.set_position(done as u64);
    });
    bar.finish_and_clear();
    let study = study.map_err(|error| to_be_continued(error, &args.out))?;
    talk.say(summary(&study));
    talk.say(format_args!("written to {}", args.out.display()));
    talk.result(&serde_json::json!({ "out": args.out, "study": study }));
    Ok(())
}
