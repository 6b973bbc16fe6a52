//! Exit codes: which kind of mistake each error of the library is.

use kinlight::calibrate::CalibrateError;
use kinlight::replay::ReplayError;
use kinlight::stop::signals;
use kinlight::study::StudyError;
use kinlight::synth::SynthError;

/// What went wrong, by what has to be changed to put it right. The exit code (0: done):
///
/// | code | kind | |
/// | --- | --- | --- |
/// | 1 | `Run` | the pipeline itself |
/// | 1 | `Differ` | results that should agree and do not; they are printed as the result |
/// | 2 | `Usage` | arguments and settings; clap's own code, too |
/// | 3 | `Sequence` | what is read of a recording: frames, poses, truth |
/// | 4 | `Object` | models and scene files |
/// | 5 | `Output` | everything that is written, made sequences and notes of finished runs included |
/// | 6 | `Device` | cameras that cannot be opened, give nothing, or stay away |
/// | 128 + n | `Interrupted` | ended by signal n (Ctrl-C: 130) before the job was done; results until then are written |
#[derive(Debug, thiserror::Error)]
pub enum CliError {
    #[error("{0}")]
    Usage(String),
    #[error("{0}")]
    Sequence(String),
    #[error("{0}")]
    Object(String),
    #[error("{0}")]
    Output(String),
    #[error("{0}")]
    Device(String),
    #[error("{problem}")]
    Interrupted {
        problem: String,
        /// What was done until then is printed as the result.
        has_result: bool,
    },
    #[error("{0}")]
    Run(String),
    #[cfg(feature = "gpu")]
    #[error("{0}")]
    Differ(String),
}

impl CliError {
    pub fn exit_code(&self) -> u8 {
        match self {
            CliError::Run(_) => 1,
            #[cfg(feature = "gpu")]
            CliError::Differ(_) => 1,
            CliError::Usage(_) => 2,
            CliError::Sequence(_) => 3,
            CliError::Object(_) => 4,
            CliError::Output(_) => 5,
            CliError::Device(_) => 6,
            CliError::Interrupted { .. } => signals::exit_code(),
        }
    }

    /// Whether the command has printed its result all the same.
    pub fn has_result(&self) -> bool {
        match self {
            #[cfg(feature = "gpu")]
            CliError::Differ(_) => true,
            CliError::Interrupted { has_result, .. } => *has_result,
            _ => false,
        }
    }

    pub fn kind(&self) -> &'static str {
        match self {
            CliError::Run(_) => "run",
            #[cfg(feature = "gpu")]
            CliError::Differ(_) => "differ",
            CliError::Usage(_) => "usage",
            CliError::Sequence(_) => "sequence",
            CliError::Object(_) => "object",
            CliError::Output(_) => "output",
            CliError::Device(_) => "device",
            CliError::Interrupted { .. } => "interrupted",
        }
    }
}

impl From<StudyError> for CliError {
    fn from(error: StudyError) -> Self {
        let text = error.to_string();
        match error {
            StudyError::Options(_)
            | StudyError::Settings(_)
            | StudyError::Synth(SynthError::Options(_)) => Self::Usage(text),
            StudyError::Stopped(_) | StudyError::Synth(SynthError::Stopped(_)) => {
                Self::Interrupted { problem: text, has_result: false }
            }
            StudyError::Capture(_) | StudyError::Eval(_) | StudyError::File { .. } => {
                Self::Sequence(text)
            }
            StudyError::Synth(_) | StudyError::Output(_) => Self::Output(text),
            StudyError::Pipeline(_) => Self::Run(text),
        }
    }
}

impl From<CalibrateError> for CliError {
    fn from(error: CalibrateError) -> Self {
        let text = error.to_string();
        match error {
            CalibrateError::Options(_) => Self::Usage(text),
            CalibrateError::Capture(_) | CalibrateError::Data(_) => Self::Sequence(text),
            CalibrateError::Output(_) => Self::Output(text),
            #[cfg(feature = "opencv")]
            CalibrateError::OpenCv(_) => Self::Run(text),
        }
    }
}

impl From<ReplayError> for CliError {
    fn from(error: ReplayError) -> Self {
        let text = error.to_string();
        match error {
            ReplayError::Capture(_) | ReplayError::NoFrames(_) => Self::Sequence(text),
            ReplayError::Camera(_) | ReplayError::NoLiveFrames => Self::Device(text),
            ReplayError::Stopped(_) => Self::Interrupted { problem: text, has_result: false },
            ReplayError::Output(_) => Self::Output(text),
            ReplayError::Pipeline(_) => Self::Run(text),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinlight::output::OutputError;

    fn code(error: StudyError) -> u8 {
        CliError::from(error).exit_code()
    }

    #[test]
    fn a_mistake_has_one_code_whichever_study_meets_it() {
        let made_wrong = SynthError::Options("no such scene".into());
        let not_made = SynthError::File { path: "a".into(), problem: "is read-only".into() };
        assert_eq!(code(StudyError::Options("no preset".into())), 2);
        assert_eq!(code(made_wrong.into()), 2);
        assert_eq!(code(StudyError::file("light.json".as_ref(), "is cut off")), 3);
        assert_eq!(code(not_made.into()), 5);
        assert_eq!(code(OutputError::DiskFull { path: "a".into() }.into()), 5);
    }
}
