//! `kinlight study composite`.

use super::{CliError, Talk};
use clap::Args;
use std::path::PathBuf;

/// Composed frames against path-traced truth, for each choice the program leaves open.
#[derive(Debug, Args)]
pub struct CompositeStudyArgs {
    /// Folder for everything that is written.
    #[arg(long, default_value = "out/study/composite")]
    pub out: PathBuf,
}

pub fn run(args: &CompositeStudyArgs, talk: Talk) -> Result<(), CliError> {
    talk.say(args.out.display());
    Ok(())
}
