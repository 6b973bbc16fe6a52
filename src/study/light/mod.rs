//! The light study (Gruber et al. 2015, Sec. 6.2): scenes of growing richness x lights on a half
//! circle, with exact depth and with a sensor's, for several methods.

mod record;

pub use record::{Jitter, LightFrame, LightRun, LightStudy, StepResponse, StepTrace};
