//! `kinlight study light`.

use super::{CliError, Talk};
use clap::Args;
use std::path::PathBuf;

/// Light error of every preset: six scenes, four lights, with and without sensor noise.
#[derive(Debug, Args)]
pub struct LightStudyArgs {
    /// Folder for everything that is written.
    #[arg(long, default_value = "out/study/light")]
    pub out: PathBuf,
}

pub fn run(args: &LightStudyArgs, talk: Talk) -> Result<(), CliError> {
    talk.say(args.out.display());
    Ok(())
}
