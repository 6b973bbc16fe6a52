//! A time budget for each frame: which settings fit it on this machine, and which to take when
//! frames run longer or shorter than foreseen.
//!
//! ```text
//! profile (measured front) -> ladder (settings for this run) -> governor -> pipeline.reconfigure
//!                                        update times -> controller --^
//! ```
//!
//! A profile is made by `kinlight tradeoff` and lives at `$XDG_CONFIG_HOME/kinlight/profile-cpu.toml`
//! (`~/.config/kinlight/profile-cpu.toml`). Where there is none, a built-in one serves: its times are
//! those of another machine, and the controller scales them by what it measures.

mod controller;
#[cfg(test)]
mod controller_tests;
mod duration;
mod governor;
mod ladder;
mod profile;

pub use controller::{Change, Controller};
pub use duration::parse_budget;
pub use governor::{BudgetSummary, Governor, Switch};
pub use ladder::{Ladder, Rung};
pub use profile::{Profile, ProfileStep};

#[derive(Debug, thiserror::Error)]
pub enum BudgetError {
    #[error("budget '{given}': {problem}; examples: 33ms, 0.1s")]
    Budget { given: String, problem: &'static str },
    #[error("profile {path}: {problem}")]
    Profile { path: String, problem: String },
    #[error("no place for a profile: neither XDG_CONFIG_HOME nor HOME is an absolute path")]
    NoPlace,
    #[error("profile, step '{step}': {problem}")]
    Step { step: String, problem: String },
}
