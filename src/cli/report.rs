//! `kinlight report`.

use super::{CliError, Talk};
use clap::Args;
use std::path::PathBuf;

/// One self-contained page of all results in a folder.
#[derive(Debug, Args)]
pub struct ReportArgs {
    /// Folder for everything that is written.
    #[arg(long, default_value = "out/report.html")]
    pub out: PathBuf,
}

pub fn run(args: &ReportArgs, talk: Talk) -> Result<(), CliError> {
    talk.say(args.out.display());
    Ok(())
}
