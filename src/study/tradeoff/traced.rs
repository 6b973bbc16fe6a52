//! Transfer error of a frame: against the made scene itself, or, for a recording, against the surface
//! that was fused from it.

use super::super::StudyError;
use crate::eval::EvalError;
use crate::eval::transfer::{SurfaceRays, TransferErrorOptions, transfer_error};
use crate::math::View;
use crate::pipeline::{FrameOutcome, Pipeline};
use crate::synth::{OPTIONS_FILE, SynthOptions, true_world};
use crate::transfer::TransferMap;
use glam::DVec3;
use std::path::Path;

/// The shipped sequence carries no options: it is what [`SynthOptions::demo`] makes.
const DEMO: &str = "sequences/demo";

/// Points are this far apart, pixels, whatever the step of the map.
const SPACING: usize = 16;

/// What rays are traced through.
#[derive(Clone, Debug)]
pub enum TracedGeometry {
    Made(Box<SynthOptions>),
    Fused,
}

impl TracedGeometry {
    pub fn of_sequence(folder: &Path) -> Result<Self, StudyError> {
        let path = folder.join(OPTIONS_FILE);
        if path.exists() {
            let problem = |e: &dyn std::fmt::Display| StudyError::File {
                path: path.display().to_string(),
                problem: e.to_string(),
            };
            let bytes = std::fs::read(&path).map_err(|e| problem(&e))?;
            return Ok(Self::Made(serde_json::from_slice(&bytes).map_err(|e| problem(&e))?));
        }
        let is_demo = folder.canonicalize().is_ok_and(|path| path.ends_with(DEMO));
        Ok(if is_demo { Self::Made(Box::new(SynthOptions::demo())) } else { Self::Fused })
    }

    /// Relative L2 of the newest frame's transfer; none where nothing was composed or seen.
    ///
    /// In a made scene, points and normals are the true ones: errors of the geometry count as much
    /// as those of visibility. On the fused surface they are the frame's own, and visibility alone
    /// counts.
    pub fn error(
        &self,
        pipeline: &Pipeline,
        outcome: &FrameOutcome,
    ) -> Result<Option<f64>, StudyError> {
        let (Some((real, _)), Some(map)) = (pipeline.geometry(), pipeline.transfer()) else {
            return Ok(None);
        };
        let options = options(map);
        let world_from_camera = outcome.tracking.world_from_camera;
        let result = match self {
            Self::Made(made) => {
                let world = true_world(made, outcome.index)?;
                let view = View { world_from_view: world_from_camera, ..real.view };
                let hit = |point, direction| world.occluded(point, direction, f32::INFINITY);
                transfer_error(map, &world.seen_in(&view), hit, &options)
            }
            Self::Fused => {
                let rays = SurfaceRays::new(&pipeline.mesh());
                // meshes are in the recording's world, buffers near the pipeline's own origin
                let local = real.view.world_from_view.translation.vector;
                let offset = world_from_camera.translation.vector - local;
                let offset = DVec3::from_array(offset.into()).as_vec3();
                let hit = |point, direction| rays.occluded(point + offset, direction);
                transfer_error(map, real, hit, &options)
            }
        };
        match result {
            Ok(error) => Ok(Some(error.relative_l2)),
            Err(EvalError::Undefined(_)) => Ok(None),
            Err(error) => Err(error.into()),
        }
    }
}

fn options(map: &TransferMap) -> TransferErrorOptions {
    let every = (SPACING / map.step.max(1)).max(1);
    TransferErrorOptions { every, ..TransferErrorOptions::default() }
}
