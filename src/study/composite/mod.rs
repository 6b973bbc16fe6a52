//! The composite study: composed frames against path-traced pictures with the object truly in the
//! scene.

mod record;

pub use record::{CompositeFrame, CompositeRun, CompositeStudy};
