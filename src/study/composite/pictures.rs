//! Pictures of a case: input, truth, and for each preset the composed frame and how it differs.

use super::runs::LastFrame;
use crate::eval::flip::{PIXELS_PER_DEGREE, flip_map};
use crate::output::{Range, value_picture, write_color_png};
use crate::study::StudyError;
use std::path::Path;

/// FLIP values are drawn from black (equal) to white, the same in all pictures.
const FLIP_RANGE: Range = Range { black: 0.0, white: 0.5 };

/// `FRAME-input.png`, `FRAME-truth.png`, `FRAME-PRESET.png`, `FRAME-PRESET-flip.png`.
pub fn write(folder: &Path, preset: &str, last: &LastFrame) -> Result<(), StudyError> {
    let path = |what: &str| folder.join(format!("{:06}-{what}.png", last.frame));
    write_color_png(&path("input"), &last.input)?;
    write_color_png(&path("truth"), &last.truth)?;
    write_color_png(&path(preset), &last.composed)?;
    let map = flip_map(&last.truth, &last.composed, PIXELS_PER_DEGREE)?;
    write_color_png(&path(&format!("{preset}-flip")), &value_picture(&map, FLIP_RANGE))?;
    Ok(())
}
