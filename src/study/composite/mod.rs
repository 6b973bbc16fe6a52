//! The composite study: composed frames against path-traced pictures with the object truly in the
//! scene.
//!
//! ```text
//! cases (made, or folders) x presets x variants -> runs -> measure -> study.json, runs.csv, summary.md
//! ```

mod cases;
mod change;
mod log;
mod measure;
mod pictures;
mod record;
mod runs;
mod study;
mod tables;
#[cfg(test)]
mod tests;
mod truth;
mod variants;

pub use cases::{MadeOptions, usual_folders};
pub use change::{Change, ChangeErrors};
pub use measure::measure;
pub use record::{CompositeFrame, CompositeRun, CompositeStudy};
pub use study::{CompositeOptions, Progress, run_study};
pub use tables::summary;
pub use truth::{FrameTruth, TruthFolder};
pub use variants::{ALL as ALL_VARIANTS, LightSource, PRESET, Variant};
