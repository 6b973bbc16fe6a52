//! All measures of one composed frame.

use super::change::{Change, linear};
use super::record::CompositeFrame;
use super::truth::FrameTruth;
use crate::eval::EvalError;
use crate::eval::flip::flip;
use crate::eval::picture::{psnr_db, relative_rmse, ssim};
use crate::image::Image;

/// Measures `composed`, made from the camera picture `input`, against the truth. What concerns the
/// light is left undefined.
pub fn measure(
    input: &Image<[u8; 3]>,
    composed: &Image<[u8; 3]>,
    truth: &FrameTruth,
) -> Result<CompositeFrame, EvalError> {
    let change = Change::of(input, &truth.picture, &truth.object)?;
    let errors = change.errors(input, composed)?;
    let on_object = relative_rmse(&linear(composed), &linear(&truth.picture), &truth.object);
    Ok(CompositeFrame {
        frame: truth.frame,
        psnr_db: psnr_db(composed, &truth.picture)?,
        ssim: ssim(composed, &truth.picture)?,
        flip: flip(&truth.picture, composed)?,
        changed_rmse: errors.changed_rmse,
        object_rmse: match on_object {
            Err(EvalError::Undefined(_)) => f64::NAN,
            result => result?,
        },
        shadow_found: errors.shadow_found,
        spill: errors.spill,
        noise_rmse: change.noise_rmse(),
        changed_pixels: change.pixels(),
        light_deg: f64::NAN,
        implied_albedo: f64::NAN,
    })
}
