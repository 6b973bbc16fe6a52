//! Every setting as a point (time, error), and the front that users choose from.
//!
//! ```text
//! plan -> sweep (pipeline, truth) -> points -> front -> its neighbours -> files, profile of the machine
//! ```

mod files;
mod front;
mod plan;
mod record;
mod sweep;
mod traced;
mod truth;

pub use front::{ErrorKind, pareto_front};
pub use plan::{Variant, neighbours, plan};
pub use record::{TradePoint, Tradeoff};
pub use sweep::Sweep;
pub use traced::TracedGeometry;
pub use truth::{FrameErrors, Truth};
