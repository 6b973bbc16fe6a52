//! `kinlight study estimator`.

use super::{CliError, Talk};
use clap::Args;
use std::path::PathBuf;

/// Gain of each step of the light estimator, on scenes it was and was not chosen on.
#[derive(Debug, Args)]
pub struct EstimatorStudyArgs {
    /// Folder for everything that is written.
    #[arg(long, default_value = "out/study/estimator")]
    pub out: PathBuf,
}

pub fn run(args: &EstimatorStudyArgs, talk: Talk) -> Result<(), CliError> {
    talk.say(args.out.display());
    Ok(())
}
