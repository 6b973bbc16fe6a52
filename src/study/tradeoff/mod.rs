//! Every setting as a point (time, error), and the front that users choose from.

mod record;

pub use record::{TradePoint, Tradeoff};
