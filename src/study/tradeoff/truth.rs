//! What is known to be true of a sequence, and how far a frame is from it.

use super::super::StudyError;
use super::traced::TracedGeometry;
use crate::eval::light::{LightError, LightTruth};
use crate::pipeline::{FrameOutcome, Pipeline};
use crate::study::composite::{Change, TruthFolder};
use std::path::Path;

/// Errors of one frame; none where there is no truth for it.
#[derive(Clone, Copy, Debug, Default)]
pub struct FrameErrors {
    pub light: Option<LightError>,
    /// Relative RMSE of the change of light on real surfaces.
    pub composite: Option<f64>,
    /// Relative L2.
    pub transfer: Option<f64>,
}

/// Whatever truth lies in a sequence's folder.
#[derive(Debug)]
pub struct Truth {
    light: Option<LightTruth>,
    composites: Option<TruthFolder>,
    geometry: TracedGeometry,
}

impl Truth {
    pub fn of_sequence(folder: &Path) -> Result<Self, StudyError> {
        let light = folder.join("light.json");
        let composites = folder.join("virtual.json").exists() && folder.join("composite").exists();
        Ok(Self {
            light: light.exists().then(|| LightTruth::read(&light)).transpose()?,
            composites: composites.then(|| TruthFolder::open(folder)).transpose()?,
            geometry: TracedGeometry::of_sequence(folder)?,
        })
    }

    /// Errors of the newest frame. Tracing takes long: `trace` says whether to do it for this one.
    pub fn errors(
        &self,
        trace: bool,
        pipeline: &Pipeline,
        outcome: &FrameOutcome,
    ) -> Result<FrameErrors, StudyError> {
        let truth = self.light.as_ref().filter(|_| outcome.light.valid());
        Ok(FrameErrors {
            light: truth.and_then(|truth| truth.error_of(outcome.index, &outcome.light)),
            composite: self.composite_error(pipeline, outcome)?,
            transfer: if trace { self.geometry.error(pipeline, outcome)? } else { None },
        })
    }

    /// None where the object changes nothing too.
    fn composite_error(
        &self,
        pipeline: &Pipeline,
        outcome: &FrameOutcome,
    ) -> Result<Option<f64>, StudyError> {
        let Some(folder) = &self.composites else { return Ok(None) };
        let Some(truth) = folder.frame(outcome.index)? else { return Ok(None) };
        let camera = &pipeline.frame().color_srgb;
        let change = Change::of(camera, &truth.picture, &truth.object)?;
        let error = change.errors(camera, pipeline.composed())?.changed_rmse;
        Ok(error.is_finite().then_some(error))
    }
}
