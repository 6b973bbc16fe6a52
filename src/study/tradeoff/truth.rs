//! What is known to be true of a sequence, and how far a frame is from it.

use super::super::StudyError;
use crate::eval::light::{LightError, LightTruth};
use crate::eval::picture;
use crate::image::{Image, Size};
use crate::math::color::LINEAR_FROM_SRGB8;
use crate::pipeline::{FrameOutcome, Pipeline};
use std::path::{Path, PathBuf};

/// A change of linear light below this is noise of the path tracer and of JPEG: it is not counted
/// to where the object changed the light.
const VISIBLE_CHANGE: f32 = 0.02;

/// Errors of one frame; none where there is no truth for it.
#[derive(Clone, Copy, Debug, Default)]
pub struct FrameErrors {
    pub light: Option<LightError>,
    pub composite: Option<f64>,
    pub transfer: Option<f64>,
}

/// Whatever truth lies in a sequence's folder.
#[derive(Debug)]
pub struct Truth {
    light: Option<LightTruth>,
    /// Path-traced pictures with the object truly in the scene.
    composites: PathBuf,
}

impl Truth {
    pub fn of_sequence(folder: &Path) -> Result<Self, StudyError> {
        let light = folder.join("light.json");
        Ok(Self {
            light: light.exists().then(|| LightTruth::read(&light)).transpose()?,
            composites: folder.join("composite"),
        })
    }

    /// Errors of the newest frame.
    pub fn errors(
        &self,
        pipeline: &Pipeline,
        outcome: &FrameOutcome,
    ) -> Result<FrameErrors, StudyError> {
        let segment = self.light.as_ref().and_then(|truth| truth.at_frame(outcome.index));
        let light = segment.filter(|_| outcome.light.valid());
        Ok(FrameErrors {
            light: light.and_then(|segment| segment.error_of(&outcome.light.light)),
            composite: self.composite_error(pipeline, outcome)?,
            transfer: None,
        })
    }

    fn composite_error(
        &self,
        pipeline: &Pipeline,
        outcome: &FrameOutcome,
    ) -> Result<Option<f64>, StudyError> {
        let at = |suffix: &str| self.composites.join(format!("{:.6}{suffix}", outcome.timestamp_s));
        let Some(path) = [".png", ".jpg"].map(at).into_iter().find(|p| p.exists()) else {
            return Ok(None);
        };
        let truth = read_rgb(&path)?;
        let object = read_mask(&at(".mask.png"))?;
        let camera = &pipeline.frame().color_srgb;
        Ok(Some(changed_rmse(camera, pipeline.composed(), &truth, &object)?))
    }
}

/// Relative RMSE of the change of linear light on real surfaces, where the object visibly changed it.
pub fn changed_rmse(
    camera: &Image<[u8; 3]>,
    composed: &Image<[u8; 3]>,
    truth: &Image<[u8; 3]>,
    object: &Image<bool>,
) -> Result<f64, StudyError> {
    if object.size() != camera.size() {
        return Err(crate::eval::EvalError::SizeMismatch(object.size(), camera.size()).into());
    }
    let (camera, composed, truth) = (linear(camera), linear(composed), linear(truth));
    let mut region = picture::changed(&camera, &truth, VISIBLE_CHANGE)?;
    for (inside, &object) in region.as_mut_slice().iter_mut().zip(object.as_slice()) {
        *inside &= !object;
    }
    let (estimate, truth) = (difference(&composed, &camera)?, difference(&truth, &camera)?);
    Ok(picture::relative_rmse(&estimate, &truth, &region)?)
}

fn linear(picture: &Image<[u8; 3]>) -> Image<[f32; 3]> {
    let table = &*LINEAR_FROM_SRGB8;
    let pixels = picture.as_slice().iter().map(|rgb| rgb.map(|c| table[usize::from(c)]));
    Image::from_vec(picture.size(), pixels.collect())
}

fn difference(a: &Image<[f32; 3]>, b: &Image<[f32; 3]>) -> Result<Image<[f32; 3]>, StudyError> {
    if a.size() != b.size() {
        return Err(crate::eval::EvalError::SizeMismatch(a.size(), b.size()).into());
    }
    let pixels = a.as_slice().iter().zip(b.as_slice());
    let less = |(a, b): (&[f32; 3], &[f32; 3])| std::array::from_fn(|c| a[c] - b[c]);
    Ok(Image::from_vec(a.size(), pixels.map(less).collect()))
}

fn read(path: &Path) -> Result<image::DynamicImage, StudyError> {
    let problem = |e: image::ImageError| StudyError::File {
        path: path.display().to_string(),
        problem: e.to_string(),
    };
    image::open(path).map_err(problem)
}

fn read_rgb(path: &Path) -> Result<Image<[u8; 3]>, StudyError> {
    let picture = read(path)?.into_rgb8();
    let size = Size::new(picture.width() as usize, picture.height() as usize);
    Ok(Image::from_vec(size, picture.pixels().map(|p| p.0).collect()))
}

fn read_mask(path: &Path) -> Result<Image<bool>, StudyError> {
    let picture = read(path)?.into_luma8();
    let size = Size::new(picture.width() as usize, picture.height() as usize);
    Ok(Image::from_vec(size, picture.pixels().map(|p| p.0[0] > 0).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_is_that_of_the_change_beside_the_object() {
        let size = Size::new(4, 1);
        let picture = |values: [u8; 4]| {
            Image::from_vec(size, values.into_iter().map(|v| [v; 3]).collect::<Vec<_>>())
        };
        let camera = picture([200, 200, 200, 200]);
        // shadow, a change too small to see, the object, nothing
        let truth = picture([120, 201, 10, 200]);
        let object = Image::from_vec(size, vec![false, false, true, false]);
        let error = |composed| changed_rmse(&camera, &composed, &truth, &object).unwrap();
        assert_eq!(error(truth.clone()), 0.0);
        assert_eq!(error(camera.clone()), 1.0, "no shadow at all");
        let everything_else_is_wrong = picture([120, 90, 200, 40]);
        assert_eq!(error(everything_else_is_wrong), 0.0);
        let half = error(picture([165, 200, 200, 200]));
        let light = |code: usize| f64::from(LINEAR_FROM_SRGB8[code]);
        let expected = (light(165) - light(120)) / (light(200) - light(120));
        // f32 differences of values below 1
        assert!((half - expected).abs() < 1e-6, "{half} {expected}");
    }

    #[test]
    fn pictures_of_another_size_are_refused() {
        let small = Image::new(Size::new(2, 2), [0; 3]);
        let large = Image::new(Size::new(3, 2), [0; 3]);
        let object = Image::new(Size::new(2, 2), false);
        assert!(changed_rmse(&small, &small, &large, &object).is_err());
        assert!(changed_rmse(&large, &large, &large, &object).is_err());
    }
}
