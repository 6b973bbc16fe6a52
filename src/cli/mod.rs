//! The command line: reads it, calls the library, says what came out.

mod args;
mod backend;
mod calibrate;
mod commands;
mod convert;
#[cfg(feature = "gpu")]
mod doctor;
mod error;
mod live;
mod objects;
#[cfg(feature = "gpu")]
mod parity;
mod pictures;
mod record;
mod report;
mod run;
mod setup;
mod stream;
mod study_composite;
mod study_estimator;
mod study_light;
mod tradeoff;

use args::{Cli, Command, Study};
use clap::Parser;
use error::CliError;
use std::process::ExitCode;

pub fn main() -> ExitCode {
    let cli = Cli::parse();
    setup::start_logging(cli.verbose);
    let talk = Talk { json: cli.json, quiet: cli.quiet };
    let result = match &cli.command {
        Command::Replay(args) => commands::replay(args, talk),
        Command::Compare(args) => commands::compare(args, talk),
        Command::Stream(args) => stream::run(args, talk),
        Command::Record(args) => record::run(args, talk),
        Command::Convert(args) => convert::run(args, talk),
        Command::Info(args) => commands::info(args, talk),
        Command::Synth(args) => commands::synth(args, talk),
        Command::Study { study: Study::Light(args) } => study_light::run(args, talk),
        Command::Study { study: Study::Composite(args) } => study_composite::run(args, talk),
        Command::Study { study: Study::Estimator(args) } => study_estimator::run(args, talk),
        Command::Tradeoff(args) => tradeoff::run(args, talk),
        Command::Calibrate { what } => calibrate::run(what, talk),
        Command::Report(args) => report::run(args, talk),
        #[cfg(feature = "gpu")]
        Command::Doctor(args) => doctor::run(args, talk),
        #[cfg(feature = "gpu")]
        Command::Parity(args) => parity::run(args, talk),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            if cli.json && !error.has_result() {
                let message = serde_json::json!({
                    "error": { "kind": error.kind(), "message": error.to_string() }
                });
                println!("{message}");
            }
            eprintln!("kinlight: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}

/// Whether the lines of `data` are a command line; nothing is run. For fuzzing, and for the test that reads
/// its corpus.
#[cfg(any(test, fuzzing))]
pub fn parses(data: &[u8]) -> bool {
    let text = String::from_utf8_lossy(data);
    match Cli::try_parse_from(std::iter::once("kinlight").chain(text.lines())) {
        Ok(cli) => !format!("{cli:?}").is_empty(),
        Err(error) => {
            assert!(!error.to_string().is_empty());
            false
        }
    }
}

/// How much is said, and in which form.
#[derive(Clone, Copy, Debug)]
pub struct Talk {
    json: bool,
    quiet: bool,
}

impl Talk {
    /// Text for people: on standard output, unless that belongs to the JSON result.
    fn say(self, text: impl std::fmt::Display) {
        if self.json || self.quiet {
            return;
        }
        println!("{text}");
    }

    fn result(self, value: &serde_json::Value) {
        if self.json {
            println!("{value}");
        }
    }

    fn progress(self, len: usize) -> indicatif::ProgressBar {
        if self.quiet || self.json {
            return indicatif::ProgressBar::hidden();
        }
        let bar = indicatif::ProgressBar::new(len as u64);
        let style = indicatif::ProgressStyle::with_template(
            "{prefix} {wide_bar} {pos}/{len} {msg} {eta_precise}",
        );
        bar.set_style(style.expect("the template is a constant"));
        bar
    }

    /// A line that changes in place, for what has no end in sight.
    fn status(self) -> indicatif::ProgressBar {
        if self.quiet || self.json {
            return indicatif::ProgressBar::hidden();
        }
        let style = indicatif::ProgressStyle::with_template("{prefix} {elapsed_precise}  {msg}");
        indicatif::ProgressBar::no_length().with_style(style.expect("the template is a constant"))
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_corpus_of_command_lines_is_parsed_without_a_panic() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus/arguments");
        if !folder.exists() {
            println!("SKIPPED: no {}", folder.display());
            return;
        }
        let (mut taken, mut refused) = (0, 0);
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            println!("{}", path.display());
            match super::parses(&std::fs::read(&path).unwrap()) {
                true => taken += 1,
                false => refused += 1,
            }
        }
        assert!(taken > 0 && refused > 0, "{taken} taken, {refused} refused");
    }
}
