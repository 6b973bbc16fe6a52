//! Studies: many runs over sequences whose truth is known, as records that tables, plots and the
//! report are made from.
//!
//! ```text
//! SequenceStore (made once) -> each_frame (pipeline) -> measures of eval -> a study's record -> JSON, CSV
//! ```

pub mod composite;
pub mod estimator;
pub mod light;
mod machine;
mod runs;
mod sequences;
pub mod tradeoff;

pub use machine::Machine;
pub use runs::{each_frame, open_made};
pub use sequences::SequenceStore;

#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    #[error(transparent)]
    Synth(#[from] crate::synth::SynthError),
    #[error(transparent)]
    Capture(#[from] crate::capture::CaptureError),
    #[error(transparent)]
    Pipeline(#[from] crate::pipeline::PipelineError),
    #[error(transparent)]
    Settings(#[from] crate::config::SettingsError),
    #[error(transparent)]
    Eval(#[from] crate::eval::EvalError),
    #[error(transparent)]
    Output(#[from] crate::output::OutputError),
    #[error(transparent)]
    Stopped(#[from] crate::stop::Stopped),
    #[error("{path}: {problem}")]
    File { path: String, problem: String },
    #[error("{0}")]
    Options(String),
}

impl StudyError {
    /// Of a file that a study reads.
    pub fn file(path: &std::path::Path, problem: impl ToString) -> Self {
        Self::File { path: path.display().to_string(), problem: problem.to_string() }
    }
}
