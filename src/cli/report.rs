//! `kinlight report`, and the page that a run leaves.

use super::{CliError, Talk};
use clap::Args;
use kinlight::report::{Problem, Sources, write_report};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Name of the page in a run's folder.
const PAGE: &str = "report.html";

/// One self-contained page of all results in some folders.
#[derive(Debug, Args)]
pub struct ReportArgs {
    /// Folders with results of replay, compare, study and tradeoff.
    #[arg(default_value = "out")]
    pub folders: Vec<PathBuf>,
    /// File to write.
    #[arg(long, default_value = "out/report.html")]
    pub out: PathBuf,
}

pub fn run(args: &ReportArgs, talk: Talk) -> Result<(), CliError> {
    let sources = Sources::find(&args.folders);
    let missing = sources.missing();
    if sources.is_empty() {
        return Err(CliError::Run(nothing_found(&sources, &missing)));
    }
    let unread = write_report(&sources, &args.out).map_err(|e| CliError::Output(e.to_string()))?;
    let problems: Vec<&Problem> = sources.problems.iter().chain(&unread).collect();
    talk.say(format_args!(
        "{}: {} runs, {} light studies, {} composite studies, {} sweeps",
        args.out.display(),
        sources.runs.len(),
        sources.light.len(),
        sources.composite.len(),
        sources.tradeoff.len()
    ));
    for (what, command) in &missing {
        talk.say(format_args!("not there: {what}; `{command}` makes it"));
    }
    if !problems.is_empty() {
        let problems = problem_lines(problems);
        return Err(CliError::Run(format!(
            "{} is written, but not with these files:{problems}",
            args.out.display()
        )));
    }
    let missing: Vec<_> =
        missing.iter().map(|(what, command)| json!({ "what": what, "command": command })).collect();
    talk.result(&json!({
        "out": args.out,
        "runs": sources.runs.iter().map(|r| &r.name).collect::<Vec<_>>(),
        "light_studies": sources.light.len(),
        "composite_studies": sources.composite.len(),
        "tradeoffs": sources.tradeoff.len(),
        "missing": missing,
    }));
    Ok(())
}

/// The page of everything in `folder`, in that folder. Files of others that are broken there are
/// named and no reason to fail.
pub fn write_page(folder: &Path) -> Result<(), CliError> {
    let sources = Sources::find(&[folder.to_owned()]);
    let unread =
        write_report(&sources, &folder.join(PAGE)).map_err(|e| CliError::Output(e.to_string()))?;
    for problem in sources.problems.iter().chain(&unread) {
        log::warn!("{PAGE}: left out {problem}");
    }
    Ok(())
}

fn nothing_found(sources: &Sources, missing: &[(&str, &str)]) -> String {
    let commands: Vec<&str> = missing.iter().map(|(_, command)| *command).collect();
    let commands = commands.join(", ");
    format!("nothing to report: run one of {commands} first{}", problem_lines(&sources.problems))
}

fn problem_lines<'a>(problems: impl IntoIterator<Item = &'a Problem>) -> String {
    problems.into_iter().map(|problem| format!("\n  {problem}")).collect()
}
