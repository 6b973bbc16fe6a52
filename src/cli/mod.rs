//! The command line: reads it, calls the library, says what came out.

mod args;
mod backend;
mod calibrate;
mod commands;
mod convert;
mod doctor;
mod error;
mod interrupt;
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
use kinlight::stop::signals;
use std::io::{ErrorKind, Write};
use std::process::ExitCode;
use std::sync::OnceLock;

pub fn main() -> ExitCode {
    signals::limits_are_errors();
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
        Command::Doctor(args) => doctor::run(args, talk),
        Command::DoctorProbe(args) => doctor::probe(args),
        #[cfg(feature = "gpu")]
        Command::Parity(args) => parity::run(args, talk),
    };
    let result = result.and_then(|()| match UNTOLD.get() {
        Some(error) => Err(CliError::Output(format!("standard output: cannot write: {error}"))),
        None => Ok(()),
    });
    let Err(error) = result else { return ExitCode::SUCCESS };
    if cli.json && !error.has_result() {
        let message = serde_json::json!({
            "error": { "kind": error.kind(), "message": error.to_string() }
        });
        print(message);
    }
    // Where nobody can be told, the exit code is left.
    let _ = writeln!(std::io::stderr(), "kinlight: {error}");
    if matches!(error, CliError::Interrupted { .. }) {
        signals::die();
    }
    ExitCode::from(error.exit_code())
}

/// Why the first of the lines that standard output did not take was not taken.
static UNTOLD: OnceLock<std::io::Error> = OnceLock::new();

/// A line on standard output. A reader that has gone (`| head`) wants no more, and that is no mistake.
fn print(text: impl std::fmt::Display) {
    if let Err(error) = writeln!(std::io::stdout(), "{text}")
        && error.kind() != ErrorKind::BrokenPipe
    {
        let _ = UNTOLD.set(error); // the first one counts
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
        print(text);
    }

    fn result(self, value: &serde_json::Value) {
        if self.json {
            print(value);
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
