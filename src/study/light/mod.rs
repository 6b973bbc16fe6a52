//! The light study (Gruber et al. 2015, Sec. 6.2): scenes of growing richness x lights on a half
//! circle, with exact depth and with a sensor's, for several methods.
//!
//! ```text
//! LightPlan -> jobs -> { sequence -> observe | observe_probe -> measure } -> RunLog -> LightStudy -> files, tables
//! ```

mod files;
mod log;
mod measure;
mod observe;
mod outlook;
mod plan;
mod record;
mod reference;
mod study;
mod summary;
mod table;

#[cfg(test)]
mod tests;

pub use files::{ENVIRONMENT_EXPOSURE, write};
pub use plan::LightPlan;
pub(in crate::study) use plan::sequence_name;
pub use record::{Jitter, LightFrame, LightRun, LightStudy, StepResponse, StepTrace};
pub use study::{LOG_FILE, Progress, run};
pub use summary::summary;

/// The paper's reference method: a grey ball in the room, as a light probe. Its runs use no depth and
/// are listed once, without sensor noise.
pub const REFERENCE: &str = "reference-sphere";

/// The same ball lit by the lamp and the environment alone, without the room's shadows and bounces.
pub const REFERENCE_ALONE: &str = "reference-sphere-alone";
