//! Transfer error of a frame: against the made scene itself, or, for a recording, against the surface
//! that was fused from it.

use super::super::StudyError;
use crate::eval::EvalError;
use crate::eval::transfer::{SurfaceRays, TransferErrorOptions, transfer_error};
use crate::geometry::GBuffer;
use crate::math::View;
use crate::pipeline::{FrameOutcome, Pipeline};
use crate::synth::{OPTIONS_FILE, SynthOptions, true_world};
use crate::transfer::TransferMap;
use glam::DVec3;
use std::path::Path;

/// The shipped sequence carries no options: it is what [`SynthOptions::demo`] makes.
const DEMO: &str = "sequences/demo";

/// Points are this far apart, pixels: no multiple of a step, so that grid points and pixels between them
/// count as they come.
const SPACING: usize = 15;

/// Rays are this long, the default reach of the transfer stage. Unlimited ones count walls outside the volume
/// in the first place, which no setting finds; then whatever darkens most looks best.
const RAY_LENGTH_M: f32 = 0.8;

/// Errors are taken over as many bands for every setting: what a setting leaves out is an error.
const BANDS: usize = 5;

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
            let text = crate::files::read_text(&path).map_err(|e| StudyError::file(&path, e))?;
            let options = serde_json::from_str(&text).map_err(|e| StudyError::file(&path, e))?;
            return Ok(Self::Made(options));
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
        let map = &at_every_pixel(map, real);
        let options = TransferErrorOptions { every: SPACING, ..TransferErrorOptions::default() };
        let world_from_camera = outcome.tracking.world_from_camera;
        let result = match self {
            Self::Made(made) => {
                let world = true_world(made, outcome.index)?;
                let view = View { world_from_view: world_from_camera, ..real.view };
                let hit = |point, direction| world.occluded(point, direction, RAY_LENGTH_M);
                transfer_error(map, &world.seen_in(&view), hit, &options)
            }
            Self::Fused => {
                let rays = SurfaceRays::new(&pipeline.mesh());
                // meshes are in the recording's world, buffers near the pipeline's own origin
                let local = real.view.world_from_view.translation.vector;
                let offset = world_from_camera.translation.vector - local;
                let offset = DVec3::from_array(offset.into()).as_vec3();
                let hit = |point, direction| rays.occluded(point + offset, direction, RAY_LENGTH_M);
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

/// The transfer that each pixel is lit with: that of the nearest of the grid points around it that lie on the
/// same surface, as up-sampling has it.
fn at_every_pixel(map: &TransferMap, surface: &GBuffer) -> TransferMap {
    let size = surface.size();
    let mut out = TransferMap { bands: BANDS, step: 1, grid: size, coefficients: Vec::new() };
    out.coefficients.reserve(size.pixels() * BANDS * BANDS);
    for y in 0..size.height {
        for x in 0..size.width {
            let (i, j) = grid_point(map, surface, x, y);
            let row = map.at(i, j);
            let known = row.len().min(BANDS * BANDS);
            out.coefficients.extend_from_slice(&row[..known]);
            out.coefficients.resize(out.coefficients.len() + BANDS * BANDS - known, 0.0);
        }
    }
    out
}

/// The least unlike of the nearest 3x3 grid points: pixels away, plus differences of depth and normal in
/// units that separate surfaces.
fn grid_point(map: &TransferMap, surface: &GBuffer, x: usize, y: usize) -> (usize, usize) {
    const DEPTH_SHARE: f32 = 0.01;
    const NORMAL: f32 = 0.1;
    let around = |centre: usize, count: usize| centre.saturating_sub(1)..(centre + 2).min(count);
    let (depth, normal) = (surface.depth_m[(x, y)], surface.normals.at(x, y));
    let unlike = |i: usize, j: usize| {
        let (u, v) = map.pixel(i, j, surface.size());
        let away = (u.abs_diff(x).pow(2) + v.abs_diff(y).pow(2)) as f32 / map.step.pow(2) as f32;
        let deeper = (surface.depth_m[(u, v)] - depth).abs() / (DEPTH_SHARE * depth.max(1e-3));
        let turned = (1.0 - surface.normals.at(u, v).dot(normal)) / NORMAL;
        let sum = away + deeper + turned;
        if sum.is_finite() { sum } else { f32::MAX }
    };
    let (width, height) = (map.grid.width, map.grid.height);
    let all = around((y / map.step).min(height - 1), height)
        .flat_map(|j| around((x / map.step).min(width - 1), width).map(move |i| (i, j)));
    all.min_by(|&a, &b| unlike(a.0, a.1).total_cmp(&unlike(b.0, b.1))).expect("a grid has points")
}
