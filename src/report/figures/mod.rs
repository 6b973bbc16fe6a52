//! Each plot as an SVG text that stands alone: its style follows the reader's light or dark mode, and
//! every mark says its values when pointed at.

mod angle_boxes;
mod canvas;
mod colors;
mod environment_dots;
mod pareto;
mod stage_bars;
mod step_curves;

pub use angle_boxes::angle_boxes;
pub use environment_dots::environment_dots;
pub use pareto::{ErrorMeasure, pareto};
pub use stage_bars::{BarScale, stage_bars};
pub use step_curves::step_curves;

pub(super) use colors::{class_of, stage_class};
pub(super) use pareto::front;
