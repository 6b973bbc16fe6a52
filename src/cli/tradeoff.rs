//! `kinlight tradeoff`.

use super::{CliError, Talk};
use clap::Args;
use std::path::PathBuf;

/// Sweep settings, mark the Pareto front of time and error, keep it as this machine's profile.
#[derive(Debug, Args)]
pub struct TradeoffArgs {
    /// Folder for everything that is written.
    #[arg(long, default_value = "out/study/tradeoff")]
    pub out: PathBuf,
}

pub fn run(args: &TradeoffArgs, talk: Talk) -> Result<(), CliError> {
    talk.say(args.out.display());
    Ok(())
}
